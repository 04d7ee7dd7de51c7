"""Current: how the water moves, and what of that AUVs cannot make good.

Components are along the grid's x and y, in m/s; there is none along z. The current of a slot is
that in its middle, in the cell where the AUV is when the slot begins. A move costs what its speed
through the water costs, and holding a cell what holding against the current costs. An AUV
whose move is impossible, by `vehicle.max_speed_m_per_s` or for want of energy, holds its cell; one
that cannot do so drifts a cell along the axis in which the current is stronger, but not out of the
grid: there it lies aground. A stranded AUV lies on the bottom, and one in a dock is moored.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from pydantic import Field

from iout_marl.core.current import MAX_SLOTS, MAX_VELOCITIES, Frames, Wander
from iout_marl.core.grid import Floats, Grid
from iout_marl.core.pace import Pace
from iout_marl.parts.base import Part
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import NonNegative, Plausible, Positive, invalid
from iout_marl.whole import short

#: Speeds of currents: tidal races are the fastest.
Speed = Annotated[NonNegative, Plausible(0, 5, "m/s", slips=(1e-2, 1e-3))]
#: A direction clockwise from +y, towards +x.
Direction = Annotated[float, Field(ge=0, lt=360)]
Period = Annotated[Positive, Plausible(0.01, 1e4, "h")]

#: Steps along x and y by which the water carries an AUV away, in the order of `World`.
DRIFTS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))


class Current(Part):
    """The water's velocity in every cell and slot.

    Attributes:
        flows: whether the water moves at all. Where it does not a world asks nothing else.
    """

    flows: bool = True

    def frames(self, scenario: Scenario) -> Frames:
        """The velocities, see `Frames`."""
        raise NotImplementedError

    def wander(self, scenario: Scenario) -> Wander | None:  # noqa: ARG002
        """What chance adds to it, by the normal numbers that it `draws`; None for nothing."""
        return None

    def strongest_m_per_s(self, scenario: Scenario, frames: Frames) -> float:
        """A speed that the current exceeds in no cell and no slot; `frames` are its own."""
        wander = self.wander(scenario)
        added = 0.0 if wander is None else wander.most_m_per_s * 2**0.5
        return frames.strongest_m_per_s() + added

    def check(self, scenario: Scenario) -> None:
        if not self.flows:
            return
        vehicle, kind = scenario.vehicle.part, scenario.current.kind
        if not vehicle.is_limited and vehicle.max_speed_m_per_s is None:
            raise invalid(
                ("current",),
                f"{kind!r} would change nothing: vehicle {scenario.vehicle.kind!r} counts no "
                "energy and has no vehicle.max_speed_m_per_s",
                beside=("vehicle",),
            )
        check_size(1, scenario)
        frames = self.frames(scenario)
        check_size(len(frames.velocity_m_per_s), scenario)
        self._check_can_hold(scenario, frames)

    def _check_can_hold(self, scenario: Scenario, frames: Frames) -> None:
        """Refuse a current that is too strong for the vehicle everywhere and at all times."""
        limit = scenario.vehicle.part.max_speed_m_per_s
        if limit is None:
            return
        cells, starts = Grid.from_scenario(scenario).all_coordinates(), scenario.starts()
        if self.wander(scenario) is not None:
            return  # it may be weaker at any time
        # What keeps its depth can be carried anywhere else.
        stays_deep = not scenario.auvs.motion.part.axes_moved[2]
        within = np.isin(cells[:, 2], starts[:, 2]) if stays_deep else np.ones(len(cells), bool)
        weakest = np.inf
        for slot in frames.slots():
            speeds = np.linalg.norm(frames.field(slot)[within], axis=-1)
            weakest = min(weakest, float(speeds.min()))
            if weakest <= limit:
                return
        raise invalid(
            ("vehicle", "max_speed_m_per_s"),
            f"{limit:g} m/s is too little to hold against the current anywhere: it is "
            f"{weakest:.3g} m/s at least",
            beside=("current",),
        )

    def check_stated(self, scenario: Scenario) -> None:
        if not isinstance(self.flows, bool):
            raise self.fault(f"flows must be True or False, not {short(self.flows)}")
        if not self.flows:
            return
        frames = self.frames(scenario)
        if not isinstance(frames, Frames):
            raise self.fault(f"frames must return Frames, not {short(frames)}")
        velocity = np.asarray(frames.velocity_m_per_s)
        cells = Grid.from_scenario(scenario).num_cells
        if velocity.ndim != 3 or velocity.shape[1:] != (cells, 2) or velocity.dtype.kind != "f":
            raise self.fault(
                f"velocity_m_per_s must be floats of shape (frames, cells, 2) = (…, {cells}, 2), "
                f"not {velocity.dtype} of shape {velocity.shape}"
            )
        if not np.isfinite(velocity).all():
            raise self.fault("velocity_m_per_s must be finite")
        if frames.is_steady:
            return
        frame, weight = np.asarray(frames.frame), np.asarray(frames.weight)
        shape = (scenario.num_slots,)
        if frame.shape != shape or weight.shape != shape or frame.dtype.kind not in "iu":
            raise self.fault(
                f"frame and weight must be whole numbers and numbers for each slot, {shape}, not "
                f"{frame.dtype} of shape {frame.shape} and {weight.dtype} of shape {weight.shape}"
            )
        if not ((frame >= 0) & (frame <= len(velocity) - 2)).all():
            raise self.fault(f"frame must be from 0 to {len(velocity) - 2}: the next one follows")
        if not ((weight >= 0) & (weight <= 1)).all():
            raise self.fault("weight must be from 0 to 1")

    def what_it_adds(self, scenario: Scenario) -> str:
        """Why AUVs can do something by it that they could not do in still water; "" for nothing.

        An AUV that cannot make its move good holds its cell or drifts: so both must be moves that
        it could choose, each of a slot.
        """
        if not self.flows:
            return ""
        motion, kind = scenario.auvs.motion.part, scenario.auvs.motion.kind
        if not motion.can_rest:
            return (
                "an AUV that cannot make its move good against the current stays where it is, "
                f"which motion {kind!r} does not let it do otherwise"
            )
        if not self._may_drift(scenario):
            return ""
        steps, pace = [tuple(step) for step in motion.steps], Pace.from_scenario(scenario)
        for drift in DRIFTS:
            i = steps.index(drift) if drift in steps else None
            if i is None or pace.slots[i] > 1 or pace.cells[i] > 1:
                return "an AUV may drift to a cell to which no move of one slot leads"
        return ""

    def can_only_remove(self, scenario: Scenario) -> bool:
        """Whether all that AUVs can do they could do in still water."""
        return not self.what_it_adds(scenario)

    def _may_drift(self, scenario: Scenario) -> bool:
        """Whether an AUV may be unable to hold its cell, for want of speed or of energy."""
        limit = scenario.vehicle.part.max_speed_m_per_s
        if scenario.vehicle.part.is_limited or limit is None:
            return True
        return self.strongest_m_per_s(scenario, self.frames(scenario)) > limit


currents: Registry[type[Current]] = Registry("current", Current)


def check_size(num_frames: int, scenario: Scenario) -> None:
    """Refuse tables of so many frames that no machine has the memory."""
    grid = Grid.from_scenario(scenario)
    if num_frames * grid.num_codes > MAX_VELOCITIES:
        raise invalid(
            ("current",),
            f"{scenario.current.kind!r} would make tables of {num_frames:,} × {grid.num_codes:,} "
            f"velocities (frames × codes of cells); at most {MAX_VELOCITIES:,}",
            beside=("grid", "cells") if num_frames == 1 else ("episode", "duration_s"),
        )


def toward(speed_m_per_s: Any, toward_deg: float) -> Floats:
    """(…, 2) velocities along x and y, of speeds in a direction clockwise from +y."""
    angle = np.radians(toward_deg)
    velocity: Floats = np.multiply.outer(
        np.asarray(speed_m_per_s, dtype=np.float64), np.array([np.sin(angle), np.cos(angle)])
    )
    return velocity


def positions_m(scenario: Scenario) -> Floats:
    """(cells, 3) metres from the centre of cell (1, 1, 1) along x, y and z, of every cell."""
    grid = Grid.from_scenario(scenario)
    return grid.all_coordinates().astype(np.float64) * np.array(grid.edges_m)


def middles_s(scenario: Scenario) -> Floats:
    """`Scenario.slot_middles_s`, of an episode for whose slots there is room."""
    if scenario.num_slots > MAX_SLOTS:
        raise invalid(
            ("current",),
            f"{scenario.current.kind!r} changes over {scenario.num_slots:,} slots; at most "
            f"{MAX_SLOTS:,}",
            beside=("episode", "duration_s"),
        )
    return scenario.slot_middles_s
