"""The world as a batched `gymnasium.vector.VectorEnv`, without a loop over environments."""

from __future__ import annotations

from collections.abc import Sequence
from operator import itemgetter
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from iout_marl.envs.arguments import (
    RENDER_MODES,
    autoreset_mode_of,
    options_of,
    reset_mask_of,
    seeds_of,
)
from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.envs.joint import (
    joint_info,
    joint_observations,
    joint_ranges,
    joint_spaces,
    split_actions,
)
from iout_marl.envs.observed import each_array
from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.world.actions import integers


class AUVVectorEnv(VectorEnv[Any, Any, Any]):
    """Many `AUVEnv` side by side in one batched world.

    Environment i, seeded with `seed + i`, is the `AUVEnv` seeded so, number for number
    (rewards up to rounding).
    Episodes start and end together. What follows an end is Gymnasium's autoreset mode:

    - SAME_STEP: the step that ends them returns the first observations of the next ones, with
      the last ones in `infos["final_obs"]` and the last infos in `infos["final_info"]`;
    - NEXT_STEP: the step after it begins the next ones, whatever its actions, for a reward of 0
      (what most of Gymnasium's vector wrappers want);
    - DISABLED: nothing; the caller resets, all or, by `options={"reset_mask": …}`, some, whose
      episodes then end earlier or later than the others.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        num_envs: environments side by side, 1 or more.
        render_mode: `human`, `ansi`, `rgb_array` or None, of every environment.
        autoreset_mode: an `AutoresetMode`, or its name or value; None for that of `metadata`,
            SAME_STEP.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, or an argument out of its range.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Gymnasium declares it so)
        "render_modes": list(RENDER_MODES),
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        scenario: AnyScenario = "paper/k10-fdd",
        num_envs: int = 1,
        render_mode: str | None = None,
        autoreset_mode: str | AutoresetMode | None = None,
        *,
        overrides: Overrides = None,
    ) -> None:
        mode = self.metadata["autoreset_mode"] if autoreset_mode is None else autoreset_mode
        self.autoreset_mode = autoreset_mode_of(mode)
        self.metadata = {**self.metadata, "autoreset_mode": self.autoreset_mode}
        self._is_next_reset = False
        self._episodes = EpisodeBatch(scenario, num_envs, render_mode, overrides=overrides)
        self.num_envs = num_envs = self._episodes.world.num_envs
        self.render_mode = render_mode
        self.scenario = self._episodes.scenario
        self.single_observation_space, self.single_action_space = joint_spaces(self._episodes)
        #: What brings the entries of one environment's observation to the order of one.
        self.observation_ranges = joint_ranges(self._episodes)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    @property
    def episodes(self) -> EpisodeBatch:
        """What the environment plays: its world, and the state that it is in."""
        return self._episodes

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode of every environment, or of some.

        Args:
            seed: environment i gets `seed + i`, or `seed[i]`.
            options: `reset_mask`, (envs,) bools of the environments that it is for, in mode
                DISABLED once all have begun; others have no effect.

        Returns:
            observations of all, and infos of those that it was for.

        Raises:
            InputError: seeds or options are something else, or episodes start together.
        """
        seeds, options = seeds_of(seed, self.num_envs), options_of(options)
        self._is_next_reset = False
        if "reset_mask" not in options:
            self._episodes.reset(seeds)
            return joint_observations(self._episodes), self._infos()
        where = reset_mask_of(options["reset_mask"], self.num_envs)
        if self.autoreset_mode is not AutoresetMode.DISABLED:
            raise InputError(
                "options['reset_mask']: the environments of this batch start and end together; "
                "autoreset_mode='Disabled' leaves their resets to the caller"
            )
        if not self._episodes.has_begun and not where.all():
            raise InputError("options['reset_mask']: the first reset must be of all environments")
        self._episodes.reset(seeds, where)
        return joint_observations(self._episodes), _of(self._infos(), where)

    def step(
        self, actions: Any
    ) -> tuple[
        Any,
        npt.NDArray[np.float64],
        npt.NDArray[np.bool_],
        npt.NDArray[np.bool_],
        dict[str, Any],
    ]:
        """One slot of every environment.

        Args:
            actions: (envs, entries) integers; those of a step that only resets are not read.

        Raises:
            InputError: an action lies outside its space.
            RuntimeError: before the first reset, or an episode is over (DISABLED).
        """
        episodes = self._episodes
        if self._is_next_reset:
            self._is_next_reset = False
            episodes.reset()
            nothing = np.zeros(self.num_envs)
            ends = (nothing.astype(np.bool_), nothing.astype(np.bool_))
            return joint_observations(episodes), nothing, *ends, self._infos()
        reward = episodes.step(split_actions(episodes, integers(actions))).mean(axis=1)
        truncations = episodes.over
        terminations = np.zeros(self.num_envs, dtype=np.bool_)
        final: dict[str, Any] = {}
        self._is_next_reset = self.autoreset_mode is AutoresetMode.NEXT_STEP and episodes.is_over
        if self.autoreset_mode is AutoresetMode.SAME_STEP and episodes.is_over:
            every = np.ones(self.num_envs, dtype=np.bool_)
            final = {
                "final_obs": self._as_objects(joint_observations(episodes)),
                "_final_obs": every,
                "final_info": self._infos(),
                "_final_info": every.copy(),
            }
            episodes.reset()
        infos = {**self._infos(), **final}
        return joint_observations(episodes), reward, terminations, truncations, infos

    def render(self) -> Any:
        """Texts or pictures of all environments, as `render_mode` says."""
        if self.render_mode is None:
            return None
        return tuple(self._episodes.render(i) for i in range(self.num_envs))

    def _infos(self) -> dict[str, Any]:
        infos: dict[str, Any] = {}
        for name, values in joint_info(self._episodes).items():
            infos[name] = values
            infos[f"_{name}"] = np.ones(self.num_envs, dtype=np.bool_)
        return infos

    def _as_objects(self, observations: Any) -> npt.NDArray[np.object_]:
        """One object an environment, the form in which Gymnasium hands out final observations."""
        objects = np.empty(self.num_envs, dtype=object)
        for i in range(self.num_envs):
            objects[i] = each_array(itemgetter(i), observations)
        return objects


def _of(infos: dict[str, Any], where: npt.NDArray[np.bool_]) -> dict[str, Any]:
    """Infos of some environments; 0 stands for the others, as Gymnasium has it."""
    return {
        name: values & where if name.startswith("_") else _zeros_but(values, where)
        for name, values in infos.items()
    }


def _zeros_but(values: npt.NDArray[Any], where: npt.NDArray[np.bool_]) -> npt.NDArray[Any]:
    kept = np.zeros_like(values)
    kept[where] = values[where]
    return kept
