"""The batched world as a Stable-Baselines3 VecEnv."""

from __future__ import annotations

import time
from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices

from iout_marl.envs.arguments import seed_of
from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.envs.observed import each_array
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides, Scenario
from iout_marl.world.actions import integers
from iout_marl.world.observation import Ranges

Infos = list[dict[str, Any]]


class SB3VecEnv(VecEnv):
    """Every AUV of many worlds as an environment of its own, all of them in one batch.

    Slot `i * auvs + j` of the VecEnv is `auv_j` of world i, and sees, does and earns what that
    agent of the ParallelEnv does. Episodes start and end together. The step that ends them
    returns the first observations of the next ones, and its infos, beside those of the last
    slot, hold

    - `terminal_observation`, the last observation, and `TimeLimit.truncated`, which is True:
      an episode has a time limit and no other end;
    - `episode`, the return, the length and the seconds, as Stable-Baselines3's `Monitor` tells
      them: `rollout/ep_rew_mean` needs no wrapper.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        num_envs: worlds side by side, 1 or more.
        render_mode: `human`, `ansi`, `rgb_array` or None, of every world.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, or an argument out of its range.
    """

    def __init__(
        self,
        scenario: AnyScenario = "paper/k10-fdd",
        num_envs: int = 8,
        render_mode: str | None = None,
        *,
        overrides: Overrides = None,
    ) -> None:
        self._episodes = episodes = EpisodeBatch(
            scenario, num_envs, render_mode, overrides=overrides
        )
        self.scenario = episodes.scenario
        #: What brings, in one slot, the entries of its observation to the order of one.
        self.observation_ranges = episodes.world.observer.agent_ranges
        num_slots = episodes.world.num_envs * episodes.world.num_auvs
        self._slots = [Slot(self, i) for i in range(num_slots)]
        super().__init__(num_slots, episodes.observation_space, episodes.action_space)
        self.metadata |= {"render_fps": AUVParallelEnv.metadata["render_fps"]}
        self._actions: Any = None
        #: Masks of the current slot, where they were asked for.
        self._masks: npt.NDArray[np.int8] | None = None
        self._returns = np.zeros(num_slots)
        self._length = 0
        self._started = time.time()

    @property
    def episodes(self) -> EpisodeBatch:
        """What the environment plays: its worlds, and the state that they are in."""
        return self._episodes

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Set the seeds of the next reset: `seed + i` for world i, and so for all its AUVs.

        Args:
            seed: None draws one from NumPy's global generator, as Stable-Baselines3 has it.

        Returns:
            that of every slot.

        Raises:
            InputError: the seed is no whole number from 0 on.
        """
        first = super().seed(seed_of(seed))[0]
        assert first is not None
        auvs = self._episodes.world.num_auvs
        self._seeds = [first + i // auvs for i in range(self.num_envs)]
        return self._seeds

    def reset(self, seed: int | None = None) -> Any:
        """Start an episode of every world.

        Args:
            seed: as for `seed`; None leaves the seeds to it, or continues with their streams.

        Returns:
            (slots, entries) observations, or a mapping of arrays where masks are beside them;
            `reset_infos` has the infos.

        Raises:
            InputError: the seed is no whole number from 0 on.
        """
        if seed is not None:
            self.seed(seed)
        self._begin(self._seeds[:: self._episodes.world.num_auvs])
        # Seeds are for one reset; there are no options.
        self._reset_seeds()
        self._reset_options()
        self._actions = None
        return self._observations()

    def step_async(self, actions: npt.NDArray[Any]) -> None:
        """Take the actions for `step_wait`, (slots, choices) integers."""
        self._actions = actions

    def step_wait(
        self,
    ) -> tuple[Any, npt.NDArray[np.float32], npt.NDArray[np.bool_], Infos]:
        """One slot of every world; those that end begin anew.

        Returns:
            observations, float32 rewards, whether the episodes have ended, infos.

        Raises:
            InputError: an action lies outside its space.
            RuntimeError: before the first reset, or without `step_async`.
        """
        if self._actions is None:
            raise RuntimeError("there are no actions: call step_async() first")
        actions, self._actions = self._by_world(integers(self._actions)), None
        rewards = self._episodes.step(actions).reshape(-1)
        self._masks = None
        self._returns += rewards
        self._length += 1
        is_over, infos = self._episodes.is_over, self._infos()
        for info in infos:
            info["TimeLimit.truncated"] = is_over
        if is_over:
            self._tell_ends(infos)
            self._begin()
        dones = np.full(self.num_envs, is_over)
        return self._observations(), rewards.astype(np.float32), dones, infos

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """(slots, choices): True for each sensible choice, entries joined end to end.

        The form that sb3-contrib's MaskablePPO asks for, whatever `observation.action_mask` of
        the scenario says.

        Raises:
            RuntimeError: before the first reset.
        """
        return self._int8_masks().astype(np.bool_)

    def _int8_masks(self) -> npt.NDArray[np.int8]:
        if self._masks is None:
            self._masks = self._episodes.masks().reshape(self.num_envs, -1)
        return self._masks

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """An attribute of `Slot`, or what `set_attr` has set, of each slot."""
        return [getattr(slot, attr_name) for slot in self._chosen(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Set an attribute of one's own of each slot; what a world is cannot be set.

        Raises:
            AttributeError: `Slot` itself has an attribute of this name.
        """
        if hasattr(Slot, attr_name):
            raise AttributeError(f"{attr_name!r} is what a slot is, and cannot be set")
        for slot in self._chosen(indices):
            setattr(slot, attr_name, value)

    def env_method(
        self,
        method_name: str,
        *method_args: Any,
        indices: VecEnvIndices = None,
        **method_kwargs: Any,
    ) -> list[Any]:
        """What a method of `Slot` returns, for each slot."""
        methods = self.get_attr(method_name, indices)
        return [method(*method_args, **method_kwargs) for method in methods]

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """True for `Monitor`, whose statistics are in the infos; there are no wrappers."""
        return [wrapper_class is Monitor for _ in self._chosen(indices)]

    def get_images(self) -> list[npt.NDArray[np.uint8] | None]:
        """A picture of its world for each slot, in mode `rgb_array`; None in others."""
        if self.render_mode != "rgb_array":
            return [None] * self.num_envs
        worlds = range(self._episodes.world.num_envs)
        pictures: list[Any] = [self._episodes.render(i) for i in worlds]
        return [pictures[slot.world] for slot in self._slots]

    def close(self) -> None:
        """Nothing is held open."""

    def _chosen(self, indices: VecEnvIndices) -> list[Slot]:
        return [self._slots[i] for i in self._get_indices(indices)]

    def _by_world(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """(slots, choices) actions as (worlds, auvs, choices)."""
        world = self._episodes.world
        expected = (self.num_envs, len(world.action_sizes))
        if actions.shape != expected:
            raise InputError(f"actions must have shape {expected}, not {actions.shape}")
        return actions.reshape(world.num_envs, world.num_auvs, -1)

    def _begin(self, seeds: Sequence[int | None] | None = None) -> None:
        self._episodes.reset(seeds)
        self._masks = None
        self._returns[:] = 0.0
        self._length = 0
        self.reset_infos = self._infos()

    def _observations(self) -> Any:
        vectors = self._episodes.observe().reshape(self.num_envs, -1)
        return self._episodes.form.arrays(vectors, lambda: self._int8_masks().copy())

    def _infos(self) -> Infos:
        world = self._episodes.world
        columns = self._episodes.info()
        table = np.empty((world.num_envs, world.num_auvs, len(columns)))
        for column, values in enumerate(columns.values()):
            table[..., column] = values if values.ndim == 2 else values[:, None]
        rows = table.reshape(self.num_envs, -1).tolist()
        infos: Infos = [dict(zip(columns, row, strict=True)) for row in rows]
        if self._episodes.mask_place == "info":
            for info, mask in zip(infos, self._int8_masks().copy(), strict=True):
                info["action_mask"] = mask
        return infos

    def _tell_ends(self, infos: Infos) -> None:
        """Write into the infos of a last slot what `VecEnv` and `Monitor` tell of an end."""
        last = self._observations()
        seconds = round(time.time() - self._started, 6)
        for i, (info, value) in enumerate(zip(infos, self._returns.tolist(), strict=True)):
            info["terminal_observation"] = each_array(itemgetter(i), last)
            info["episode"] = {"r": round(value, 6), "l": self._length, "t": seconds}


class Slot:
    """One slot of the VecEnv: what `get_attr`, `set_attr` and `env_method` reach."""

    #: What Gymnasium's environments have: the entry of a registry, which there is not.
    spec = None

    def __init__(self, vec_env: SB3VecEnv, index: int) -> None:
        self._vec_env, self._index = vec_env, index

    @property
    def world(self) -> int:
        """Which world it lies in, from 0 on."""
        return self._index // self._vec_env.episodes.world.num_auvs

    @property
    def agent(self) -> str:
        """The name of its AUV."""
        return f"auv_{self._index % self._vec_env.episodes.world.num_auvs}"

    @property
    def scenario(self) -> Scenario:
        """The scenario."""
        return self._vec_env.scenario

    @property
    def observation_space(self) -> spaces.Space[Any]:
        """The observations of an AUV."""
        return self._vec_env.episodes.observation_space

    @property
    def action_space(self) -> spaces.Space[Any]:
        """The actions of an AUV."""
        return self._vec_env.episodes.action_space

    @property
    def observation_ranges(self) -> Ranges:
        """What brings the entries of an observation to the order of one."""
        return self._vec_env.observation_ranges

    @property
    def render_mode(self) -> str | None:
        """The render mode."""
        return self._vec_env.episodes.render_mode

    @property
    def metadata(self) -> dict[str, Any]:
        """Render modes, and pictures a second."""
        return self._vec_env.metadata

    def render(self) -> Any:
        """Text or pixels of its world, as the render mode says; None without one."""
        return self._vec_env.episodes.render(self.world)

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """(choices,): its row of `SB3VecEnv.action_masks`."""
        masks = self._vec_env._int8_masks()  # noqa: SLF001
        return masks[self._index].astype(np.bool_)
