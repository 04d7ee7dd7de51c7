"""How an AUV's observation writes positions, ages, energies, counts and times."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from iout_marl.core.grid import Grid
from iout_marl.core.limits import FARTHEST_M, UPLINK_W, bounded
from iout_marl.core.link import Link
from iout_marl.core.ranges import Ranges
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array, lookup, reverse_axes
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Plausible, Positive
from iout_marl.scenario.parts import PartOf
from iout_marl.scenario.parts import Settings as PartSettings


class Representation(Part):
    """What an AUV sees, and how it is written: here as it is, in cells, slots and joules.

    Attributes:
        reference_energy_j: that of an uplink over half the grid's diagonal, or as far as uplinks
            reach, in J: the reference for stored energies.
    """

    class Settings(PartSettings):
        #: Append the positions of the nodes, for layouts that change.
        node_positions: bool = False
        #: Append the share of the episode that is over.
        time: bool = False
        #: Append where the other AUVs are, relative to the own position, the nearest first.
        other_auvs: bool = True
        #: Append which AUV this is, as M entries of which one is 1.
        agent_index: bool = False
        #: Distance up to which an AUV knows a node's age and energy; those of a node farther away
        #: are what they were when it last was near or delivered to this AUV, and how many slots
        #: ago that was is appended. null: everything is known to all.
        view_range_m: Annotated[Positive, Plausible(0, 1e7, "m")] | None = None
        #: Entries of one's own, appended after all others.
        entries: Annotated[
            tuple[Annotated[PartSettings, PartOf("observation entry", is_word=True)], ...],
            Field(strict=False, max_length=100),
        ] = ()
        #: Where the mask of sensible actions is handed out, if at all.
        action_mask: Literal["none", "info", "observation"] = "none"

        hash_defaults: ClassVar[dict[str, Any]] = {
            "agent_index": False,
            "entries": [],
            "other_auvs": True,
            "view_range_m": None,
        }

    settings: Settings
    #: Whether observations are node tables, see `iout_marl.core.table`.
    is_table: ClassVar[bool] = False

    @property
    def is_by_rows(self) -> bool:
        """Whether environments hand out the rows of a node table, and not a vector."""
        return False

    @property
    def sees_others(self) -> bool:
        return bool(self.settings.other_auvs)

    def kinds(self, scenario: Scenario) -> list[str]:
        """The kinds of the entries of an observation, without those of one's own."""
        seen = self.settings
        kinds = {
            "position": True,
            "ages": True,
            "energies": True,
            "node_positions": seen.node_positions,
            "time": seen.time,
            "other_auvs": seen.other_auvs and scenario.num_auvs > 1,
            "unseen_for": seen.view_range_m is not None,
            "agent_index": seen.agent_index,
        }
        return [kind for kind, is_in in kinds.items() if is_in]

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario, grid, link, backend = world.scenario, world.grid, world.link, world.backend
        self.reference_energy_j = _reference_energy_j(grid, link)
        self._num_nodes, self._num_slots = scenario.num_nodes, scenario.num_slots
        #: x, y and z by code, one after the other; where each begins, to go with the cells
        #: of AUVs and nodes, or of pairs of AUVs.
        self._coordinates = backend.floats(grid.coordinate_table().T.reshape(-1) + 1)
        axes = backend.integers(np.arange(3) * grid.num_codes)
        self._axes = {2: axes[:, None, None], 3: axes[:, None, None, None]}
        self._size = np.array(grid.shape, dtype=np.float64)
        self._least_age, self._maximum_age = scenario.age.least, float(scenario.age.maximum)
        # All AUVs at the node, charging it alone through the whole episode.
        best_slot_j = link.most_harvested_w * scenario.slot_s
        most_j = best_slot_j * scenario.num_slots * scenario.num_auvs
        self._most_j = scenario.storage.part.most_j(most_j)

    def in_cells(self, cell: Array) -> Array:
        """x, y and z of cells by code, counted from 1: (…, 3)."""
        places = self._axes[cell.ndim] + reverse_axes(self.xp, cell)
        return reverse_axes(self.xp, lookup(self.xp, self._coordinates, places))

    def positions(self, cell: Array) -> Array:
        """x, y and z of cells by code: (…, 3)."""
        return self.in_cells(cell)

    def position_ranges(self) -> Ranges:
        """Ranges of one cell."""
        return Ranges(np.ones(3), self._size, self._size)

    def steps(self, steps: Array) -> Array:
        """Differences of positions in cells, (…, 3)."""
        return steps

    def step_ranges(self) -> Ranges:
        """Ranges of one difference."""
        far = np.maximum(self._size - 1, 1)
        return Ranges(-far, far, far)

    def ages(self, age: Array) -> Array:
        """Ages in slots."""
        return age

    def age_ranges(self) -> Ranges:
        """Ranges of one age for each node."""
        return Ranges.uniform(
            self._num_nodes, self._least_age, self._maximum_age, self._maximum_age
        )

    def energies(self, energy_j: Array) -> Array:
        """Stored energies in J."""
        return energy_j

    def energy_ranges(self) -> Ranges:
        """Ranges of one energy for each node."""
        return Ranges.uniform(self._num_nodes, 0, self._most_j, self.reference_energy_j)

    def counts(self, deliveries: Array) -> Array:
        """Numbers of deliveries."""
        return deliveries

    def count_ranges(self) -> Ranges:
        """Ranges of one number for each node; K nodes share the deliveries."""
        slots = self._num_slots
        return Ranges.uniform(self._num_nodes, 0, slots, slots / self._num_nodes)

    def durations(self, slots: Array) -> Array:
        """Numbers of slots."""
        return slots

    def duration_ranges(self) -> Ranges:
        """Ranges of one duration for each node."""
        return Ranges.uniform(self._num_nodes, 0, self._num_slots, self._num_slots)

    def waits(self, slots: Array, most_slots: int) -> Array:  # noqa: ARG002
        """Numbers of slots, up to so many."""
        return slots

    def wait_ranges(self, count: int, most_slots: int) -> Ranges:
        """Ranges of so many waits."""
        return Ranges.uniform(count, 0, most_slots, most_slots)

    def time(self, slot: Array) -> Array:
        """The share of the episode that is over: (envs,) slots to (envs, 1)."""
        return self.xp.astype(slot, self.world.backend.dtype)[:, None] / self._num_slots


representations: Registry[type[Representation]] = Registry("observation", Representation)


def _reference_energy_j(grid: Grid, link: Link) -> float:
    """Energy of an uplink over half the grid's diagonal: the yardstick for stored energy."""
    half_diagonal_m = 0.5 * float(grid.metres(grid.shape))
    reference_energy_j = link.reference_uplink_j(min(half_diagonal_m, FARTHEST_M))
    # Divisors must be no less than numbers are, nor more.
    return float(bounded(reference_energy_j, *UPLINK_W))
