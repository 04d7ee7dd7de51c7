"""Where the nodes lie at the start of an episode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from iout_marl.core.grid import Grid
from iout_marl.parts import Placement
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import settings_of
from iout_marl.world.chance import draws_of


def node_codes(
    scenario: Scenario, grid: Grid, rngs: Sequence[np.random.Generator]
) -> npt.NDArray[np.int64]:
    """Codes of the nodes' cells for an episode of each environment, (envs, nodes).

    Args:
        scenario: the scenario.
        grid: its grid.
        rngs: the stream of each environment, or one for all of them in turn. Streams
            are drawn from only where the scenario places nodes at random.
    """
    placement: Placement = scenario.nodes.part
    if placement.redraws == "never":
        codes = grid.encode(placement.drawn(grid, np.random.default_rng(0)))
        return np.tile(codes, (len(rngs), 1))
    return np.stack([grid.encode(placement.drawn(grid, rng)) for rng in rngs])


def redraws_every_episode(scenario: Scenario) -> bool:
    """Whether the nodes lie elsewhere in each episode."""
    return bool(scenario.nodes.part.redraws == "episode")


def has_chance(scenario: Scenario) -> bool:
    """Whether the episodes of a run may differ though the actions do not.

    Layouts may be left to chance, though one that is drawn once for a run is the same in all of
    its episodes, and so may slots.
    """
    return redraws_every_episode(scenario) or bool(draws_of(scenario))


def draws_layout_once(scenario: Scenario) -> bool:
    """Whether the nodes of a run lie where its seed puts them."""
    return bool(scenario.nodes.part.redraws == "run")


def pin_layout(scenario: Scenario, seed: int) -> Scenario:
    """The scenario with a layout that is drawn once for a run drawn and written into it.

    Other scenarios come back as they are. A run pins its scenario by its seed before
    it starts, so that whatever reads the run later finds the nodes where they were.
    """
    if not draws_layout_once(scenario):
        return scenario
    placement: Placement = scenario.nodes.part
    drawn = placement.drawn(Grid.from_scenario(scenario), np.random.default_rng(seed)) + 1
    pinned = {"kind": "fixed", "cells": drawn.tolist(), "weights": placement.weights}
    nodes = settings_of("placement", pinned)
    return scenario.model_copy(update={"nodes": nodes})
