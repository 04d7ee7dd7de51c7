"""The world as a PettingZoo ParallelEnv."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces
from pettingzoo import ParallelEnv

from iout_marl.envs.episodes import RENDER_MODES, Episodes
from iout_marl.scenario import Scenario
from iout_marl.world.actions import integers

Observation = Any
Info = dict[str, Any]


class AUVParallelEnv(ParallelEnv[str, Any, Any]):
    """AUVs that charge underwater sensor nodes by sound and collect their data.

    See `iout_marl.iout_v0` for the environment's page.

    Args:
        scenario: a bundled name, a path to a YAML file or a `Scenario`.
        render_mode: `human`, `ansi`, `rgb_array` or None.

    Raises:
        InputError: no such scenario, or a fault in it.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (PettingZoo declares it so)
        "name": "iout_v0",
        "render_modes": list(RENDER_MODES),
        "is_parallelizable": True,
        "render_fps": 4,
    }

    def __init__(
        self,
        scenario: str | Path | Scenario = "paper/k10-fdd",
        render_mode: str | None = None,
    ) -> None:
        self._episodes = Episodes(scenario, render_mode=render_mode)
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
        self.state_space = self._episodes.state_space

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """The observations of an agent: a Box, or a Dict with the mask beside it."""
        return self.observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """The actions of an agent: MultiDiscrete([directions, K, K]), in TDD [directions, K]."""
        return self.action_spaces[agent]

    def reset(
        self,
        seed: int | None = None,
        options: dict[str, Any] | None = None,  # noqa: ARG002
    ) -> tuple[dict[str, Observation], dict[str, Info]]:
        """Start an episode.

        Args:
            seed: starts a new stream of random layouts; None goes on with the old one.
            options: none are known.
        """
        self._episodes.reset([seed])
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
            ValueError: an agent's action is missing or outside its space.
            RuntimeError: the episode is over, or has not begun.
        """
        agents = self.agents
        if not agents:
            raise RuntimeError("no agent is alive: call reset() first")
        missing = [a for a in agents if a not in actions]
        if missing:
            raise ValueError(f"no action for {', '.join(missing)}")
        rewards = self._episodes.step(np.array([[self._own_action(actions, a) for a in agents]]))
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
        action = integers(actions[agent], f"the action of {agent}")
        expected = (len(self._episodes.world.action_sizes),)
        if action.shape != expected:
            raise ValueError(
                f"the action of {agent} must have shape {expected}, not {action.shape}"
            )
        return action

    def state(self) -> npt.NDArray[np.float32]:
        """What a central critic may see, (entries,): see `Observer.observe_globally`."""
        return self._episodes.observe_globally()[0]

    def render(self) -> str | npt.NDArray[np.uint8] | None:
        """Text or pixels of the current slot, as `render_mode` says."""
        return self._episodes.render()

    def close(self) -> None:
        """Nothing is held open."""

    def _observations(self) -> dict[str, Observation]:
        vectors = dict(zip(self.agents, self._episodes.observe()[0], strict=True))
        if self._episodes.mask_place != "observation":
            return vectors
        masks = self._episodes.masks()[0]
        return {
            agent: {"observation": vector, "action_mask": mask}
            for (agent, vector), mask in zip(vectors.items(), masks, strict=True)
        }

    def _infos(self) -> dict[str, Info]:
        #: A number for all agents, or one for each of them in a list.
        values = {name: value.tolist()[0] for name, value in self._episodes.info().items()}
        infos: dict[str, Info] = {
            agent: {
                name: float(value[i]) if isinstance(value, list) else value
                for name, value in values.items()
            }
            for i, agent in enumerate(self.agents)
        }
        if self._episodes.mask_place == "info":
            for agent, mask in zip(self.agents, self._episodes.masks()[0], strict=True):
                infos[agent]["action_mask"] = mask
        return infos
