"""The world as one `gymnasium.Env`: all AUVs under one controller."""

from __future__ import annotations

from operator import itemgetter
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from iout_marl.envs.arguments import RENDER_MODES, options_of, seed_of
from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.envs.observed import each_array
from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.world.actions import integers
from iout_marl.world.observation import Ranges


class AUVEnv(gymnasium.Env[Any, Any]):
    """One controller for the whole fleet; with one AUV, the paper's problem as it stands.

    Actions and observations of several AUVs are joined end to end; the reward is the
    mean of theirs. With one AUV they are exactly those of the ParallelEnv's `auv_0`.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        render_mode: `human`, `ansi`, `rgb_array` or None.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, or an unknown render mode.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": 4}  # noqa: RUF012

    def __init__(
        self,
        scenario: AnyScenario = "paper/k10-fdd",
        render_mode: str | None = None,
        *,
        overrides: Overrides = None,
    ) -> None:
        self._episodes = EpisodeBatch(scenario, render_mode=render_mode, overrides=overrides)
        self.render_mode = render_mode
        self.scenario = self._episodes.scenario
        self.observation_space, self.action_space = joint_spaces(self._episodes)
        #: What brings the entries of an observation to the order of one, see `Ranges`.
        self.observation_ranges = joint_ranges(self._episodes)

    @property
    def episodes(self) -> EpisodeBatch:
        """What the environment plays: its world, and the state that it is in."""
        return self._episodes

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode; `seed` starts a new stream of random layouts.

        Raises:
            InputError: the seed is no whole number from 0 on, or options are no mapping.
        """
        seed, options = seed_of(seed), options_of(options)
        super().reset(seed=seed, options=options)
        self._episodes.reset([seed])
        return self._observation(), self._info()

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One slot.

        Raises:
            InputError: the action lies outside its space.
            RuntimeError: the episode is over, or has not begun.
        """
        actions = split_actions(self._episodes, integers(action)[None])
        reward = float(self._episodes.step(actions).mean())
        return self._observation(), reward, False, self._episodes.is_over, self._info()

    def action_masks(self) -> npt.NDArray[np.bool_]:
        """(auvs · choices,): True for each sensible choice, entries joined end to end.

        The form that sb3-contrib's MaskablePPO asks for, whatever `observation.action_mask` of
        the scenario says.

        Raises:
            RuntimeError: before the first reset.
        """
        return self._episodes.masks()[0].reshape(-1).astype(np.bool_)

    def render(self) -> Any:
        """Text or pixels of the current slot, as `render_mode` says; None without one."""
        return self._episodes.render()

    def _observation(self) -> Any:
        return each_array(itemgetter(0), joint_observations(self._episodes))

    def _info(self) -> dict[str, Any]:
        info = {name: value[0] for name, value in joint_info(self._episodes).items()}
        # Plain numbers beside the mask.
        return {k: v if isinstance(v, np.ndarray) else v.item() for k, v in info.items()}


def joint_spaces(episodes: EpisodeBatch) -> tuple[spaces.Space[Any], spaces.MultiDiscrete]:
    """Observation and action space of a controller of all AUVs."""
    m = episodes.world.num_auvs
    return episodes.form.space(m), episodes.action_space_for(m)


def joint_ranges(episodes: EpisodeBatch) -> Ranges:
    """Those of the observations of all AUVs, joined end to end."""
    own, m = episodes.world.observer.agent_ranges, episodes.world.num_auvs
    low, high, scale = (np.tile(each, m) for each in (own.low, own.high, own.scale))
    return Ranges(low, high, scale, own.limit)


def split_actions(episodes: EpisodeBatch, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(envs, auvs · entries) joint actions as (envs, auvs, entries).

    Raises:
        InputError: the number of entries is not that of the space.
    """
    m, entries = episodes.world.num_auvs, len(episodes.world.action_sizes)
    if actions.shape[1:] != (m * entries,):
        raise InputError(
            f"an action must have {m * entries} entries, not shape {actions.shape[1:]}"
        )
    return actions.reshape(-1, m, entries)


def joint_observations(episodes: EpisodeBatch) -> Any:
    """Observations in their form, those of all AUVs joined end to end: each array (envs, …)."""
    return each_array(_end_to_end, episodes.observations())


def _end_to_end(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """(envs, auvs, rows, …) as (envs, auvs · rows, …)."""
    return array.reshape(array.shape[0], -1, *array.shape[3:])


def joint_info(episodes: EpisodeBatch) -> dict[str, npt.NDArray[Any]]:
    """`EpisodeBatch.info` with the AUVs taken together, (envs,) each.

    `harvested_j` and `delivered` are sums over AUVs, `beta` is their mean; the mask,
    where asked for, is (envs, auvs · choices).
    """
    info = episodes.info()
    combined: dict[str, npt.NDArray[Any]] = {
        # A copy: whoever writes into an info must not write into the state.
        name: np.array(value if value.ndim == 1 else _joined(name, value), dtype=np.float64)
        for name, value in info.items()
    }
    if episodes.mask_place == "info":
        combined["action_mask"] = episodes.masks().reshape(episodes.world.num_envs, -1)
    return combined


def _joined(name: str, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
    """Values of each AUV, (envs, auvs), taken together, (envs,)."""
    joined: npt.NDArray[Any] = values.mean(1) if name == "beta" else values.sum(1)
    return joined
