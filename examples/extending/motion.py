"""A motion of one's own: a knight's moves, and one cell up or down.

Where this file is imported, scenarios can name it:

    auvs: {motion: knight}

python examples/extending/motion.py [--episodes 100]

checks it, and prints what it does to a baseline.
"""

from __future__ import annotations

import argparse
from itertools import product

from iout_marl import World, evaluate, parts
from iout_marl.testing import check_part


@parts.motions.register("knight", version=1)
class Knight(parts.Motion):
    """Two cells along x or y and one along the other; or one cell up or down."""

    #: Of each direction, the cells that it leads along x, y and z. The size of the action space,
    #: masks, the planner and the bounds follow from it.
    steps = (
        *((2 * x, y, 0) for x, y in product((-1, 1), repeat=2)),
        *((x, 2 * y, 0) for x, y in product((-1, 1), repeat=2)),
        (0, 0, -1),
        (0, 0, 1),
    )


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI of a baseline in slots, by motion."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=100)
    episodes = parser.parse_args(options).episodes

    check_part(parts.motions, "knight")
    found = {}
    print("motion  directions  mean AoI of greedy")
    for motion in ("six", "knight"):
        overrides = {"auvs.motion": motion}
        evaluation = evaluate("paper/k10-fdd", "greedy", episodes, overrides=overrides)
        found[motion] = evaluation.metrics["mean_aoi"].mean
        directions = World("paper/k10-fdd", overrides=overrides).action_sizes[0]
        print(f"{motion:6}  {directions:10}  {found[motion]:18.2f}")
    return found


if __name__ == "__main__":
    main()
