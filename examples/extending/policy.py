"""A policy of one's own: always the oldest node, approached on the shortest way.

Beside a baseline, on the command line:

    iout evaluate paper/k10-fdd --policy greedy --policy examples/extending/policy.py:OldestFirst

and in Python, by whole episodes and slot by slot in an environment:

    python examples/extending/policy.py
"""

from __future__ import annotations

import numpy as np

from iout_marl import World, evaluate, iout_v0, load_policy
from iout_marl.world import State

SCENARIO = "paper/k10-fdd"


class OldestFirst:
    """Flies to the node that has waited longest, charges and hears it.

    It needs a name, which tables show, and `act`. That it leaves nothing to chance it may say, so
    that in a world without chance a single episode is played.
    """

    name = "oldest-first"
    is_deterministic = True

    def act(self, world: World, state: State, rng: np.random.Generator) -> np.ndarray:
        """(envs, auvs, entries) actions: direction, node to charge, node to hear (in TDD: node).

        The i-th AUV of several takes the i-th oldest node.
        """
        oldest = np.argsort(-state.age, axis=-1, kind="stable")  # (envs, nodes)
        node = oldest[:, np.arange(world.num_auvs) % world.num_nodes]  # (envs, auvs)
        cells = world.grid.coordinate_table()  # x, y, z by code
        target = cells[np.take_along_axis(state.node_cell, node, axis=-1)]  # (envs, auvs, 3)
        # Where each direction would lead: (envs, auvs, directions, 3).
        steps = cells[world.motion.neighbours(state.cell)]
        direction = np.linalg.norm(steps - target[:, :, None], axis=-1).argmin(axis=-1)
        return np.stack([direction, *[node] * (len(world.action_sizes) - 1)], axis=-1)


def hear_the_oldest(observation: np.ndarray) -> np.ndarray:
    """The simplest form of a policy: from (envs, auvs, entries) observations to actions.

    For the observations of `paper/k10-fdd`: position (3), ages (10), energies (10).
    """
    age, energy_j = observation[..., 3:13], observation[..., 13:23]
    direction = np.zeros(observation.shape[:-1], dtype=int)
    return np.stack([direction, energy_j.argmin(-1), age.argmax(-1)], axis=-1)


def main() -> dict[str, float]:
    """Mean AoI in slots of each policy, by `evaluate`, and of an episode played by hand."""
    policies = {"greedy": "greedy", "oldest-first": OldestFirst(), "function": hear_the_oldest}
    found = {
        name: evaluate(SCENARIO, policy, episodes=20).metrics["mean_aoi"].mean
        for name, policy in policies.items()
    }

    # `load_policy` adds `predict` to whatever it finds.
    policy = load_policy(f"{__file__}:OldestFirst")
    env = iout_v0.parallel_env(SCENARIO)
    observations, infos = env.reset(seed=0)
    while env.agents:
        observations, _, _, _, infos = env.step(policy.predict(observations, env=env))
    found["oldest-first, by hand"] = infos["auv_0"]["time_mean_aoi"]
    return found


if __name__ == "__main__":
    for name, mean_aoi in main().items():
        print(f"{name}: mean AoI {mean_aoi:.2f}")
