"""The world as a PettingZoo ParallelEnv."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from pettingzoo import ParallelEnv

from iout_marl.envs.arguments import RENDER_MODES, options_of, seed_of
from iout_marl.envs.episodes import OWN_INFO_KEYS, EpisodeBatch
from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario import AnyScenario, Overrides
from iout_marl.whole import short
from iout_marl.world.actions import entries_of

Observation = Any
Info = dict[str, Any]


class AUVParallelEnv(ParallelEnv[str, Any, Any]):
    """AUVs that charge underwater sensor nodes by sound and collect their data.

    See `iout_marl.iout_v0` for the environment's page.

    Args:
        scenario: a bundled name, a path to a YAML file, a mapping or a `Scenario`.
        render_mode: `human`, `ansi`, `rgb_array` or None.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: no such scenario, a fault in it, or an unknown render mode.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (PettingZoo declares it so)
        "name": "iout_v0",
        "render_modes": list(RENDER_MODES),
        "is_parallelizable": True,
        "render_fps": 4,
    }

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
        self.possible_agents = [f"auv_{i}" for i in range(self.scenario.num_auvs)]
        self.agents: list[str] = []
        # One object each for good: wrappers key on the identity of spaces. Each is a copy
        # that has not drawn yet: agents must not draw from one another's streams.
        self.observation_spaces = {
            a: copy.deepcopy(self._episodes.observation_space) for a in self.possible_agents
        }
        self.action_spaces = {
            a: copy.deepcopy(self._episodes.action_space) for a in self.possible_agents
        }
        self._entries = len(self._episodes.world.action_sizes)
        self.state_space = self._episodes.state_space
        #: What brings the entries of one AUV's observation to the order of one, see `Ranges`.
        self.observation_ranges = self._episodes.world.observer.agent_ranges

    @property
    def episodes(self) -> EpisodeBatch:
        """What the environment plays: its world, and the state that it is in."""
        return self._episodes

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The observations of an agent: a Box, or a Dict of tables, or with the mask beside it."""
        return self.observation_spaces[self._known(agent)]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The actions of an agent: MultiDiscrete([directions, K, K]), in TDD [directions, K].

        With `auvs.idle_choices` K + 1 stands for K, and the last choice for nobody.
        """
        return self.action_spaces[self._known(agent)]

    def _known(self, agent: str) -> str:
        if agent in self.possible_agents:
            return agent
        hint = did_you_mean(str(agent), self.possible_agents)
        raise InputError(f"there is no agent {agent!r}{hint}")

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[dict[str, Observation], dict[str, Info]]:
        """Start an episode.

        Args:
            seed: starts a new stream of random layouts; None continues with the old one.
            options: none are known; unknown ones have no effect.

        Raises:
            InputError: the seed is no whole number from 0 on, or options are no mapping.
        """
        options_of(options)
        self._episodes.reset([seed_of(seed)])
        self.agents = self.possible_agents[:]
        return self._observations(), self._infos()

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[
        dict[str, Observation],
        dict[str, float],
        dict[str, bool],
        dict[str, bool],
        dict[str, Info],
    ]:
        """One slot.

        Args:
            actions: an action for every agent.

        Raises:
            InputError: an agent's action is missing or outside its space, or there is no such
                agent.
            RuntimeError: the episode is over, or has not begun.
        """
        agents = self.agents
        if not agents:
            begun = self._episodes.has_begun
            is_over = "is over" if begun else "has not begun"
            raise RuntimeError(f"the episode {is_over}: call reset() first")
        if type(actions) is not dict and not isinstance(actions, Mapping):
            raise InputError(f"actions must be a mapping by agent, not {short(actions)}")
        missing = [a for a in agents if a not in actions]
        if missing:
            raise InputError(f"no action for {', '.join(missing)}")
        if len(actions) > len(agents):
            for agent in actions:
                self._known(agent)
        own = [self._own_action(actions, a) for a in agents]
        rewards = self._episodes.step(own[0][None, None] if len(own) == 1 else np.array([own]))
        over = self._episodes.is_over
        result = (
            self._observations(),
            dict(zip(agents, rewards.tolist()[0], strict=True)),
            dict.fromkeys(agents, False),
            dict.fromkeys(agents, over),
            self._infos(),
        )
        if over:
            self.agents = []
        return result

    def _own_action(self, actions: dict[str, Any], agent: str) -> npt.NDArray[Any]:
        return entries_of(actions[agent], self._entries, f"the action of {agent}")

    def state(self) -> npt.NDArray[np.float32]:
        """What a central critic may see, (entries,): see `Observer.observe_globally`."""
        return self._episodes.observe_globally()[0]

    def render(self) -> str | npt.NDArray[np.uint8] | None:
        """Text or pixels of the current slot, as `render_mode` says; None without one."""
        return self._episodes.render()

    def close(self) -> None:
        """Nothing is held open."""

    def _observations(self) -> dict[str, Observation]:
        found = self._episodes.observations()
        if not isinstance(found, dict):
            return dict(zip(self.agents, found[0], strict=True))
        return {
            agent: {name: array[0, i] for name, array in found.items()}
            for i, agent in enumerate(self.agents)
        }

    def _infos(self) -> dict[str, Info]:
        #: A number for all agents, or one for each of them in a list.
        values = self._episodes.info_of_first()
        infos: dict[str, Info] = {}
        for i, agent in enumerate(self.agents):
            infos[agent] = info = values.copy()
            for name in OWN_INFO_KEYS:
                info[name] = float(values[name][i])
        if self._episodes.mask_place == "info":
            for agent, mask in zip(self.agents, self._episodes.masks()[0], strict=True):
                infos[agent]["action_mask"] = mask
        return infos
