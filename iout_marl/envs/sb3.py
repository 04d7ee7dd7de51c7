"""The ParallelEnv for Stable-Baselines3, through SuperSuit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.scenario import Scenario


def sb3_vec_env(
    scenario: str | Path | Scenario = "paper/k10-fdd", num_envs: int = 8, processes: int = 0
) -> Any:
    """A Stable-Baselines3 VecEnv with one slot for every AUV of every environment.

    The AUVs share one policy. Seed it with `vec_env.reset(seed=…)`; SuperSuit's adapter
    has no `seed` method, so pass no seed to the algorithm.

    Args:
        scenario: a bundled name, a path to a YAML file or a `Scenario`.
        num_envs: copies of the environment.
        processes: worker processes; 0 steps all copies in this one.
    """
    import supersuit  # its import takes a second that no other face needs to pay

    vectorised = supersuit.pettingzoo_env_to_vec_env_v1(AUVParallelEnv(scenario))
    return supersuit.concat_vec_envs_v1(
        vectorised, num_envs, num_cpus=processes, base_class="stable_baselines3"
    )
