"""The environment for Stable-Baselines3: in one batch, or copy by copy through SuperSuit."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from iout_marl.core.limits import MOST_ENVS
from iout_marl.envs.arguments import MOST_PROCESSES
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.extras import require
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.whole import whole_argument

if TYPE_CHECKING:
    from iout_marl.envs.sb3_batched import SB3VecEnv


def sb3_vec_env(
    scenario: AnyScenario = "paper/k10-fdd",
    num_envs: int = 8,
    *,
    render_mode: str | None = None,
    overrides: Overrides = None,
) -> SB3VecEnv:
    """A Stable-Baselines3 VecEnv over one batched world, with one slot for every AUV.

    The AUVs share one policy. World i gets the seed `seed + i`, by `vec_env.seed(seed)` or by
    the seed of the algorithm, and then plays what `evaluate(…, seed=seed)` plays in episode i.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        num_envs: worlds side by side, 1 or more; the VecEnv has `num_envs` times AUVs slots.
        render_mode: `human`, `ansi`, `rgb_array` or None, of every world.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, an argument out of its range, or
            Stable-Baselines3 is not installed.
    """
    require("sb3_vec_env", "sb3")
    # Its import takes seconds that no other API needs to pay.
    from iout_marl.envs.sb3_batched import SB3VecEnv

    return SB3VecEnv(scenario, num_envs, render_mode, overrides=overrides)


def supersuit_vec_env(
    scenario: AnyScenario = "paper/k10-fdd",
    num_envs: int = 8,
    processes: int = 0,
    *,
    overrides: Overrides = None,
) -> Any:
    """The same slots as `sb3_vec_env`, by copies of the ParallelEnv, through SuperSuit.

    Slower than `sb3_vec_env` by far; for wrappers that want the ParallelEnv itself, and for
    copies in worker processes. Copy i of the environment gets the seed `seed + i`, whether by
    `vec_env.reset(seed=…)` or by the seed of the algorithm, in any number of processes.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        num_envs: copies of the environment, 1 or more.
        processes: worker processes; 0 steps all copies in this one.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, an argument out of its range, or
            Stable-Baselines3 is not installed.
    """
    num_envs = whole_argument("num_envs", num_envs, 1, MOST_ENVS)
    processes = whole_argument("processes", processes, 0, MOST_PROCESSES)
    require("supersuit_vec_env", "sb3")
    import supersuit

    from iout_marl.envs.seeded import SeededVecEnv

    env = AUVParallelEnv(scenario, overrides=overrides)
    vectorised = supersuit.pettingzoo_env_to_vec_env_v1(env)
    copies = supersuit.concat_vec_envs_v1(vectorised, num_envs, num_cpus=processes)
    return SeededVecEnv(copies, len(env.possible_agents), env.episodes.mask_place)
