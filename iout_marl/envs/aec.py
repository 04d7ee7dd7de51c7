"""PettingZoo's AEC form, with one clear message for every misuse."""

from __future__ import annotations

from typing import Any

from pettingzoo import AECEnv
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from iout_marl.errors import InputError
from iout_marl.world.actions import ActionCheck, entries_of


class ActionSpaceError(InputError, AssertionError):
    """An action outside its space; an AssertionError as of PettingZoo's own wrapper, too."""


class CheckedAECEnv(OrderEnforcingWrapper[str, Any, Any]):  # type: ignore[misc] # without types
    """Refuses actions outside their space, and steps before a reset or after the end.

    Args:
        env: the AEC form of an `AUVParallelEnv`.
    """

    def __init__(self, env: AECEnv[str, Any, Any]) -> None:
        super().__init__(env)
        sizes = tuple(int(n) for n in env.action_space(env.possible_agents[0]).nvec)
        self._entries = len(sizes)
        self._check = ActionCheck(1, 1, sizes)

    def step(self, action: Any) -> None:
        """The action of the agent whose turn it is; None for one whose episode is over.

        Raises:
            ActionSpaceError: it lies outside its space.
            RuntimeError: the episode is over, or has not begun.
        """
        if not self._has_reset:
            raise RuntimeError("the episode has not begun: call reset() first")
        if not self.agents:
            raise RuntimeError("the episode is over: call reset() first")
        agent = self.agent_selection
        if self.terminations[agent] or self.truncations[agent]:
            if action is not None:
                raise ActionSpaceError(f"the episode of {agent} is over: step(None) takes it out")
        else:
            try:
                own = entries_of(action, self._entries, f"the action of {agent}")
                self._check(own[None, None])
            except InputError as error:
                raise ActionSpaceError(f"{error} (action is not in action space)") from None
        super().step(action)

    def observe(self, agent: str) -> Any:
        """What an agent sees.

        Raises:
            InputError: there is no such agent.
        """
        # A space is asked for, since it knows its agent, or says that there is none.
        self.observation_space(agent)
        return super().observe(agent)

    def __str__(self) -> str:
        return str(self.env)
