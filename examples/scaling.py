"""How large observations and rewards are, and what becomes of them by each way of scaling.

    python examples/scaling.py [SCENARIO]

Prints, for whole episodes of a baseline, the mean and the standard deviation of each part of an
observation as it is, divided by the bounds of its space, and by the scales that the environment
offers; then the rewards.
"""

from __future__ import annotations

import sys

import numpy as np

from iout_marl import iout_v0, load_policy

POLICIES = ("random-walk", "greedy")
EPISODES = 10


def played(scenario: str, policy_name: str) -> tuple[np.ndarray, np.ndarray]:
    """(slots · auvs, entries) observations, and as many rewards."""
    env, policy = iout_v0.parallel_env(scenario), load_policy(policy_name)
    seen, paid = [], []
    for seed in range(EPISODES):
        observations, _ = env.reset(seed=seed)
        while env.agents:
            actions = policy.predict(observations, env=env)
            observations, rewards, _, _, _ = env.step(actions)
            seen += list(observations.values())
            paid += list(rewards.values())
    return np.array(seen), np.array(paid)


def scaled(observation: np.ndarray, env: iout_v0.AUVParallelEnv) -> np.ndarray:
    """Observations of the order of one, by what the environment offers."""
    ranges = env.observation_ranges
    return np.clip((observation - ranges.low) / ranges.scale, -ranges.limit, ranges.limit)


def main(scenario: str = "paper/k10-fdd") -> dict[str, float]:
    """Prints the tables; returns the standard deviation of energies by each way of scaling."""
    env = iout_v0.parallel_env(scenario)
    space, k = env.observation_space("auv_0"), env.scenario.num_nodes
    parts = {"position": slice(0, 3), "ages": slice(3, 3 + k), "energies": slice(3 + k, 3 + 2 * k)}
    spread = {}
    print(f"{scenario}, {EPISODES} episodes each")
    print(f"{'':12} {'part':10} {'bound':>10} {'largest':>10} {'as it is':>20}", end="")
    print(f" {'by the space':>18} {'by the ranges':>16}")
    for name in POLICIES:
        seen, _ = played(scenario, name)
        by_space = (seen - space.low) / (space.high - space.low)
        by_ranges = scaled(seen, env)
        for part, of in parts.items():
            print(
                f"{name:12} {part:10} {space.high[of].max():10.0f} {seen[:, of].max():10.0f}",
                end="",
            )
            print(f" {seen[:, of].mean():10.1f} ± {seen[:, of].std():7.1f}", end="")
            print(f" {by_space[:, of].mean():9.4f} ± {by_space[:, of].std():6.4f}", end="")
            print(f" {by_ranges[:, of].mean():8.2f} ± {by_ranges[:, of].std():5.2f}")
        spread = {"space": by_space[:, parts["energies"]].std(),
                  "ranges": by_ranges[:, parts["energies"]].std()}  # fmt: skip
    print(f"\n{'':12} {'reward a slot':>18} {'return':>10}")
    for name in POLICIES:
        _, paid = played(scenario, name)
        slots = env.scenario.num_slots
        print(f"{name:12} {paid.mean():9.2f} ± {paid.std():6.2f} {slots * paid.mean():10.1f}")
    return spread


if __name__ == "__main__":
    main(*sys.argv[1:2])
