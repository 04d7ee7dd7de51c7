"""The ParallelEnv for Stable-Baselines3, through SuperSuit."""

from __future__ import annotations

from typing import Any

from iout_marl.core.limits import MOST_ENVS
from iout_marl.envs.arguments import MOST_PROCESSES
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.whole import whole_argument


def sb3_vec_env(
    scenario: AnyScenario = "paper/k10-fdd",
    num_envs: int = 8,
    processes: int = 0,
    *,
    overrides: Overrides = None,
) -> Any:
    """A Stable-Baselines3 VecEnv with one slot for every AUV of every environment.

    The AUVs share one policy. Copy i of the environment gets the seed `seed + i`, whether
    by `vec_env.reset(seed=…)` or by the seed of the algorithm, in any number of processes.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        num_envs: copies of the environment, 1 or more.
        processes: worker processes; 0 steps all copies in this one.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, or an argument out of its range.
    """
    num_envs = whole_argument("num_envs", num_envs, 1, MOST_ENVS)
    processes = whole_argument("processes", processes, 0, MOST_PROCESSES)
    # Their import takes seconds that no other face needs to pay.
    import supersuit

    from iout_marl.envs.seeded import SeededVecEnv

    env = AUVParallelEnv(scenario, overrides=overrides)
    vectorised = supersuit.pettingzoo_env_to_vec_env_v1(env)
    copies = supersuit.concat_vec_envs_v1(vectorised, num_envs, num_cpus=processes)
    return SeededVecEnv(copies, len(env.possible_agents))
