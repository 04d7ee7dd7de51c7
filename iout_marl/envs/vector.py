"""The world as a batched `gymnasium.vector.VectorEnv`, without a loop over environments."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from iout_marl.envs.episodes import RENDER_MODES, Episodes
from iout_marl.envs.joint import joint_info, joint_observations, joint_spaces, split_actions
from iout_marl.scenario import Scenario
from iout_marl.world.actions import integers


class AUVVectorEnv(VectorEnv[Any, Any, Any]):
    """Many `AUVEnv` side by side in one batched world.

    Environment i, seeded with `seed + i`, is the `AUVEnv` seeded so, number for number
    (rewards up to rounding).
    Episodes start and end together; the step that ends them returns the first
    observations of the next ones (autoreset mode SAME_STEP), with the last ones in
    `infos["final_obs"]` and the last infos in `infos["final_info"]`.

    Args:
        scenario: a bundled name, a path to a YAML file or a `Scenario`.
        num_envs: environments side by side.
        render_mode: `human`, `ansi`, `rgb_array` or None, of every environment.

    Raises:
        InputError: no such scenario, or a fault in it.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 (Gymnasium declares it so)
        "render_modes": list(RENDER_MODES),
        "render_fps": 4,
        "autoreset_mode": AutoresetMode.SAME_STEP,
    }

    def __init__(
        self,
        scenario: str | Path | Scenario = "paper/k10-fdd",
        num_envs: int = 1,
        render_mode: str | None = None,
    ) -> None:
        self._episodes = Episodes(scenario, num_envs, render_mode)
        self.num_envs = num_envs
        self.render_mode = render_mode
        self.scenario = self._episodes.scenario
        self.single_observation_space, self.single_action_space = joint_spaces(self._episodes)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Any, dict[str, Any]]:
        """Start an episode of every environment.

        Args:
            seed: environment i gets `seed + i`, or `seed[i]`.
            options: `reset_mask` is refused: episodes start together.

        Raises:
            ValueError: the wrong number of seeds, or a `reset_mask`.
        """
        if options and "reset_mask" in options:
            raise ValueError("reset_mask: environments of this batch start and end together")
        if isinstance(seed, int | np.integer):
            seed = [int(seed) + i for i in range(self.num_envs)]
        if seed is not None and len(seed) != self.num_envs:
            raise ValueError(f"expected {self.num_envs} seeds, not {len(seed)}")
        self._episodes.reset(seed)
        return joint_observations(self._episodes), self._infos()

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
            actions: (envs, entries) integers.

        Raises:
            ValueError: an action lies outside its space.
            RuntimeError: before the first reset.
        """
        episodes = self._episodes
        reward = episodes.step(split_actions(episodes, integers(actions))).mean(axis=1)
        over = episodes.is_over
        truncations = np.full(self.num_envs, over)
        terminations = np.zeros(self.num_envs, dtype=np.bool_)
        final: dict[str, Any] = {}
        if over:
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
            objects[i] = (
                {k: v[i] for k, v in observations.items()}
                if isinstance(observations, dict)
                else observations[i]
            )
        return objects
