"""A rule of channel access of one's own: so many uplinks in a slot, the nearest first.

Where this file is imported, scenarios can name it:

    channel: {access: {kind: nearest_first, most: 2}}

python examples/extending/access_rule.py [--episodes 100]

checks it, and prints it beside those that come along.
"""

from __future__ import annotations

import argparse
from typing import Any

from iout_marl import evaluate, parts
from iout_marl.testing import check_part


@parts.access_rules.register("nearest_first", version=1)
class NearestFirst(parts.Access):
    """One band for all, which holds `most` uplinks at once; those over longer ways stay silent."""

    class Settings(parts.Settings):
        most: parts.Count = 2

    def max_uplinks_per_slot(self, num_auvs: int) -> int:
        """The most uplinks that can arrive in a slot: bounds and planner rely on it."""
        return min(self.settings.most, num_auvs)

    def setup(self, world: parts.Context) -> None:
        super().setup(world)
        self._nothing_j = world.backend.floats(0.0)

    def __call__(self, request: parts.Request, split: Any) -> parts.Uplinks:
        """Who delivers, and what that takes, (envs, auvs) each."""
        xp, link = self.xp, self.world.link
        # A node that several AUVs hear sends to the nearest of them.
        sends = self.to_nearest(request)
        distance_m = link.at(link.distance_m, request.offset)
        mine, theirs = distance_m[:, :, None], distance_m[:, None, :]
        own_cell, their_cell = request.cell[:, :, None], request.cell[:, None, :]
        # Of ways of one length, by the cell: the order of the AUVs must not matter.
        before = (theirs < mine) | ((theirs == mine) & (their_cell < own_cell))
        rank = xp.sum(xp.astype(before & sends[:, None, :], xp.int64), axis=2)
        delivered = sends & (rank < self.settings.most)
        return parts.Uplinks(delivered, xp.where(delivered, split.required_j, self._nothing_j))


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI of a baseline in slots, by rule."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=100)
    episodes = parser.parse_args(options).episodes

    check_part(parts.access_rules, "nearest_first", {"most": 2})
    rules = {
        "exclusive": "exclusive",
        "nearest_first, 1": {"kind": "nearest_first", "most": 1},
        "nearest_first, 2": {"kind": "nearest_first", "most": 2},
        "orthogonal": "orthogonal",
    }
    found = {}
    print("access            mean AoI of greedy")
    for name, rule in rules.items():
        overrides = {"channel.access": rule}
        evaluation = evaluate("multi/m3-k10-fdd", "greedy", episodes, overrides=overrides)
        found[name] = evaluation.metrics["mean_aoi"].mean
        print(f"{name:16}  {found[name]:18.2f}")
    return found


if __name__ == "__main__":
    main()
