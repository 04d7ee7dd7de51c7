"""One episode in full: where the AUVs went, whom they charged and heard, and how ages went."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from iout_marl.evaluation import play
from iout_marl.policies import AnyPolicy, policy_for
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.world import World


@dataclass(frozen=True)
class Trajectory:
    """One episode; cells, AUVs and nodes are counted from 1.

    Attributes:
        grid: cells along x, y and z.
        spacing_m: edge of a cell in m.
        nodes: (nodes, 3) cells.
        path: (slots + 1, auvs, 3) cells, the starts first.
        charged: (slots, auvs) node charged; 0 where the slot left no time for it.
        heard: (slots, auvs) node asked for its packet; 0 where there was no time for it.
        delivered: (slots, auvs) whether the packet arrived.
        ages: (slots, nodes) ages after each slot.
    """

    grid: list[int]
    spacing_m: float
    nodes: list[list[int]]
    path: list[list[list[int]]]
    charged: list[list[int]]
    heard: list[list[int]]
    delivered: list[list[bool]]
    ages: list[list[int]]

    def to_json(self) -> dict[str, Any]:
        """The episode as JSON has it; `Trajectory(**…)` reads it back."""
        return asdict(self)


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
    scenario, player = policy_for(load_scenario(scenario, overrides), policy, seed)
    world = World(scenario)
    cells = world.grid.coordinate_table() + 1
    splits_slot = world.duplex.splits_slot
    path, charged, heard, delivered, ages, nodes = [], [], [], [], [], []
    for state, events in play(world, player, seed):
        path.append(cells[state.cell[0]].tolist())
        if events is None:
            nodes = cells[state.node_cell[0]].tolist()
            continue
        beta = events.beta[0]
        charged.append(np.where(splits_slot & (beta == 0), 0, events.charged[0] + 1).tolist())
        heard.append(np.where(splits_slot & (beta == 1), 0, events.heard[0] + 1).tolist())
        delivered.append(events.delivered[0].tolist())
        ages.append(state.age[0].astype(int).tolist())
    return Trajectory(
        list(scenario.grid.cells),
        scenario.grid.spacing_m,
        nodes,
        path,
        charged,
        heard,
        delivered,
        ages,
    )
