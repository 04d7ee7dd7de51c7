"""Two metrics of one's own: one of the state at the end of an episode, one summed over its slots.

python examples/extending/metric.py [--episodes 20]

Where this file is imported, the two are shown wherever the built-in metrics are: in
evaluations and their JSON, in TensorBoard and `metrics.jsonl`, in studies and their reports.
"""

from __future__ import annotations

import argparse
from typing import Any

from iout_marl import evaluate, metrics
from iout_marl.world import Events, State, World


@metrics.register(
    "worst_wait",
    unit="slots",
    definition="Highest Age of Information of any node at the end of the episode.",
    better="less",
    low=0,
    digits=1,
)
def worst_wait(world: World, state: State) -> Any:
    """(envs,) slots."""
    return world.backend.xp.max(state.age, axis=1)


@metrics.register(
    "failed_uplinks",
    per_slot=True,
    unit="AUV-slots",
    definition="Slots in which an AUV asked a node for its packet and got none, over all AUVs.",
    better="less",
    low=0,
    digits=1,
)
def failed_uplinks(world: World, state: State, events: Events) -> Any:
    """(envs,) AUVs, in one slot; `state` is that after it."""
    return world.backend.xp.sum(~events.delivered, axis=1)


def main(options: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--episodes", type=int, default=20)
    chosen = parser.parse_args(options)
    found = evaluate("paper/k3-fdd", "greedy", chosen.episodes).metrics
    for name in ("worst_wait", "failed_uplinks"):
        metric = metrics.described(name)
        print(f"{metric.heading}: {found[name].mean:.{metric.digits}f} {metric.unit}")


if __name__ == "__main__":
    main()
