"""A placement of one's own: nodes on the sea floor, elsewhere in every episode.

Where this file is imported, scenarios can name it:

    nodes: {kind: sea_floor, count: 10}

python examples/extending/placement.py [--episodes 100]

checks it, and prints it beside nodes anywhere in the water.
"""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from iout_marl import evaluate, parts
from iout_marl.testing import check_part


@parts.placements.register("sea_floor", version=1)
class SeaFloor(parts.Placement):
    """Nodes at cells of the deepest layer, drawn at random, no two in one cell."""

    class Settings(parts.Settings):
        count: parts.Count

    #: `never` for nodes at given cells, `run` for a draw by the seed of a run.
    redraws = "episode"

    @property
    def num_nodes(self) -> int:
        """K."""
        return self.settings.count

    def check(self, scenario: Any) -> None:
        """See that the settings go together with those of others."""
        width, length, _ = scenario.grid.cells
        if self.num_nodes > width * length:
            raise parts.invalid(
                ("nodes", "count"),
                f"is {self.num_nodes}, but the sea floor has only {width * length} cells",
                beside=("grid", "cells"),
            )

    def draw(self, grid: Any, rng: np.random.Generator) -> np.ndarray:
        """(nodes, 3) coordinates from 0; chance comes from `rng` alone."""
        width, length, depth = grid.shape
        place = rng.choice(width * length, self.num_nodes, replace=False)
        return np.stack([place // length, place % length, np.full_like(place, depth - 1)], axis=1)


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI of a baseline in slots, by placement."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=100)
    episodes = parser.parse_args(options).episodes

    check_part(parts.placements, "sea_floor", {"count": 4})
    found = {}
    print("nodes      mean AoI of greedy")
    for kind in ("random", "sea_floor"):
        overrides = {"nodes": {"kind": kind, "count": 10}}
        evaluation = evaluate("paper/k10-fdd", "greedy", episodes, overrides=overrides)
        found[kind] = evaluation.metrics["mean_aoi"].mean
        print(f"{kind:9}  {found[kind]:18.2f}")
    return found


if __name__ == "__main__":
    main()
