"""One episode in full: where the AUVs went, whom they charged and heard, and how ages went."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.policies import AnyPolicy
from iout_marl.replay.recorder import record_policy
from iout_marl.replay.recording import Recording
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.scenario.spacing import Spacing


@dataclass(frozen=True)
class Trajectory:
    """One episode; cells, AUVs and nodes are counted from 1.

    Attributes:
        grid: cells along x, y and z.
        spacing_m: edge of a cell in m, or its edges along x, y and z.
        nodes: (nodes, 3) cells.
        path: (slots + 1, auvs, 3) cells, the starts first.
        charged: (slots, auvs) node charged; 0 for nobody, or where the slot left no time for it.
        heard: (slots, auvs) node asked for its packet; 0 likewise.
        delivered: (slots, auvs) whether the packet arrived.
        ages: (slots, nodes) ages after each slot; whole where packets are a slot old.
        polled: (slots, auvs) lists of the nodes polled beside, in the order of their packets; None
            where the scenario has nobody polled.
        polled_delivered: whether their packets arrived, likewise.
        docks: (docks, 3) cells in which AUVs are recharged; None where there are none.
    """

    grid: list[int]
    spacing_m: float | list[float]
    nodes: list[list[int]]
    path: list[list[list[int]]]
    charged: list[list[int]]
    heard: list[list[int]]
    delivered: list[list[bool]]
    ages: list[list[float]]
    polled: list[list[list[int]]] | None = None
    polled_delivered: list[list[list[bool]]] | None = None
    docks: list[list[int]] | None = None

    @classmethod
    def from_recording(cls, recording: Recording) -> Trajectory:
        """The episode without energies and reasons."""
        only_charged = recording.splits_slot & (recording.beta == 1)
        return cls(
            grid=list(recording.grid),
            spacing_m=_as_json(recording.spacing_m),
            nodes=recording.nodes.tolist(),
            path=recording.path.tolist(),
            charged=recording.charged.tolist(),
            heard=np.where(only_charged, 0, recording.heard).tolist(),
            delivered=recording.delivered.tolist(),
            ages=_ages(recording.ages[1:]),
            docks=None if recording.docks is None else recording.docks.tolist(),
            **({} if not recording.polled.shape[2] else _polled(recording)),
        )

    def to_json(self) -> dict[str, Any]:
        """The episode as JSON has it; `Trajectory(**…)` reads it back."""
        data = asdict(self)
        return {name: data[name] for name in data if data[name] is not None}

    def polls(self) -> Iterator[tuple[int, int, int, bool]]:
        """Of nodes polled beside: slot from 1, AUV from 0, node, whether the packet arrived."""
        rows = zip(self.polled or (), self.polled_delivered or (), strict=True)
        for slot, (nodes, arrivals) in enumerate(rows, start=1):
            for auv, pair in enumerate(zip(nodes, arrivals, strict=True)):
                for node, arrived in zip(*pair, strict=True):
                    yield slot, auv, node, arrived


def _ages(ages: npt.NDArray[np.float64]) -> list[list[float]]:
    """Ages to a thousandth of a slot."""
    is_whole = (ages == ages.round()).all()
    return (ages.astype(int) if is_whole else ages.round(3)).tolist()


def _polled(recording: Recording) -> dict[str, Any]:
    named, arrived = recording.polled, recording.polled_delivered
    places = [[named[slot, auv] > 0 for auv in range(named.shape[1])] for slot in range(len(named))]
    return {
        name: [
            [values[slot, auv][there].tolist() for auv, there in enumerate(row)]
            for slot, row in enumerate(places)
        ]
        for name, values in (("polled", named), ("polled_delivered", arrived))
    }


def _as_json(spacing_m: Spacing) -> float | list[float]:
    return list(spacing_m) if isinstance(spacing_m, tuple) else spacing_m


def record_episode(
    scenario: AnyScenario,
    policy: AnyPolicy,
    seed: int = 0,
    *,
    overrides: Overrides = None,
) -> Trajectory:
    """Play one episode, the first of those of `evaluate`, and keep it all.

    Args:
        scenario, policy, seed, overrides: as for `evaluate`.

    Raises:
        InputError, TypeError: as `evaluate` does.
    """
    return Trajectory.from_recording(record_policy(scenario, policy, seed, overrides=overrides))
