"""SuperSuit's VecEnv for Stable-Baselines3, with seeds, time limits and action masks."""

from __future__ import annotations

import copy
import functools
from typing import Any

import numpy as np
import numpy.typing as npt
from stable_baselines3.common.vec_env import VecEnv
from supersuit.vector import ProcConcatVec
from supersuit.vector.multiproc_vec import decompress_info
from supersuit.vector.sb3_vector_wrapper import SB3VecEnvWrapper

from iout_marl.errors import InputError


class SeededVecEnv(SB3VecEnvWrapper):  # type: ignore[misc] # SuperSuit ships no types
    """Mends five things of SuperSuit's adapter.

    Its `reset(seed=…)` fails for want of a `seed` underneath; copies in different worker
    processes would get the same seeds; it does not tell a time limit from an end, so that
    PPO would learn that nothing follows the last slot; wrappers around it, such as
    Stable-Baselines3's `VecNormalize`, do not learn its render mode; and it has no
    `action_masks` for sb3-contrib's MaskablePPO.

    Args:
        venv: what `supersuit.concat_vec_envs_v1` returns.
        num_agents: slots of one copy of the environment.
        mask_place: where the environment hands out masks: `none`, `info` or `observation`.
    """

    def __init__(self, venv: Any, num_agents: int, mask_place: str) -> None:
        super().__init__(venv)
        self._num_agents = num_agents
        self._mask_place = mask_place
        #: Observations and infos as they were last handed out; None before the first reset.
        self._seen: tuple[Any, list[dict[str, Any]]] | None = None
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
        self._seen = observations, self.reset_infos
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
        if attr_name == "action_masks" and self._mask_place != "none":
            return [functools.partial(self._mask_of, i) for i in self._get_indices(indices)]
        attributes: list[Any] = super().get_attr(attr_name, indices)
        return attributes

    def has_attr(self, attr_name: str) -> bool:
        """Whether the slots have an attribute; that of SuperSuit fails on its own environments."""
        return bool(VecEnv.has_attr(self, attr_name))

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """What a method returns for every slot; of those of the environment, `action_masks`."""
        if method_name == "action_masks":
            return list(self.action_masks()[list(self._get_indices(indices))])
        results: list[Any] = super().env_method(method_name, *args, indices=indices, **kwargs)
        return results

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """(slots, choices): True for each sensible choice, entries joined end to end.

        Raises:
            InputError: the scenario has no masks handed out.
            RuntimeError: before the first reset.
        """
        if self._mask_place == "none":
            raise InputError(
                "observation.action_mask: is none, and SuperSuit's copies are asked for masks; "
                "take info or observation, or sb3_vec_env, which needs neither"
            )
        if self._seen is None:
            raise RuntimeError("the episode has not begun: call reset() first")
        observations, infos = self._seen
        masks = (
            observations["action_mask"]
            if self._mask_place == "observation"
            else np.stack([info["action_mask"] for info in infos])
        )
        return np.asarray(masks, dtype=np.bool_)

    def _mask_of(self, slot: int) -> npt.NDArray[np.bool_]:
        return self.action_masks()[slot]

    def step_wait(self) -> Any:
        """What the slot brought, with `TimeLimit.truncated` in every info."""
        observations, rewards, terminations, truncations, infos = self.venv.step_wait()
        # Those of the slot that follows: at an end the first ones of the next episode.
        self._seen = observations, infos
        for info, terminated, truncated in zip(infos, terminations, truncations, strict=True):
            info["TimeLimit.truncated"] = bool(truncated and not terminated)
        return observations, rewards, np.logical_or(terminations, truncations), infos
