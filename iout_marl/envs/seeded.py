"""SuperSuit's VecEnv for Stable-Baselines3, with seeds and time limits."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from supersuit.vector import ProcConcatVec
from supersuit.vector.multiproc_vec import decompress_info
from supersuit.vector.sb3_vector_wrapper import SB3VecEnvWrapper


class SeededVecEnv(SB3VecEnvWrapper):  # type: ignore[misc] # SuperSuit ships no types
    """Mends four things of SuperSuit's adapter.

    Its `reset(seed=…)` fails for want of a `seed` underneath; copies in different worker
    processes would get the same seeds; it does not tell a time limit from an end, so that
    PPO would learn that nothing follows the last slot; and wrappers around it, such as
    Stable-Baselines3's `VecNormalize`, do not learn its render mode.

    Args:
        venv: what `supersuit.concat_vec_envs_v1` returns.
        num_agents: slots of one copy of the environment.
    """

    def __init__(self, venv: Any, num_agents: int) -> None:
        super().__init__(venv)
        self._num_agents = num_agents
        self._next_seed: int | None = None

    def seed(self, seed: int | None = None) -> list[int | None]:
        """Set the seed of the next reset; returns that of every slot."""
        self._next_seed = seed
        copies = (i // self._num_agents for i in range(self.num_envs))
        return [None if seed is None else seed + i for i in copies]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:  # noqa: ARG002
        """Start an episode of every copy; copy i gets `seed + i`."""
        if seed is None:
            seed, self._next_seed = self._next_seed, None
        if isinstance(self.venv, ProcConcatVec):
            observations, self.reset_infos = self._reset_workers(seed)
        else:
            observations, self.reset_infos = self.venv.reset(seed=seed)
        return observations

    def _reset_workers(self, seed: int | None) -> tuple[Any, list[dict[str, Any]]]:
        # ProcConcatVec.reset would seed the first copies of its workers with seed,
        # seed + 1, …, which are the seeds of further copies in the workers before them.
        venv = self.venv
        for first_slot, pipe in zip(venv.idx_starts, venv.pipes, strict=False):
            first_seed = None if seed is None else seed + first_slot // self._num_agents
            pipe.send(("reset", (first_seed, None)))
        infos = decompress_info(venv.num_envs, venv.idx_starts, venv._receive_info())  # noqa: SLF001
        return copy.deepcopy(venv.observations_buffers), infos

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """An attribute of every slot; that of SuperSuit fails on its own environments."""
        if attr_name == "render_mode":
            return [self.render_mode] * self.num_envs
        attributes: list[Any] = super().get_attr(attr_name, indices)
        return attributes

    def step_wait(self) -> Any:
        """What the slot brought, with `TimeLimit.truncated` in every info."""
        observations, rewards, terminations, truncations, infos = self.venv.step_wait()
        for info, terminated, truncated in zip(infos, terminations, truncations, strict=True):
            info["TimeLimit.truncated"] = bool(truncated and not terminated)
        return observations, rewards, np.logical_or(terminations, truncations), infos
