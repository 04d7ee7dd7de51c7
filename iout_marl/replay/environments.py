"""Records the episodes that somebody's own loop plays in an environment."""

from __future__ import annotations

from typing import Any, TypeAlias

import gymnasium
import numpy as np
from pettingzoo import ParallelEnv
from pettingzoo.utils import BaseParallelWrapper

from iout_marl.envs.episodes import EpisodeBatch
from iout_marl.envs.joint import AUVEnv
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.errors import InputError
from iout_marl.replay.recorder import Recorder
from iout_marl.replay.recording import Recording
from iout_marl.whole import short

RecordedEnv: TypeAlias = "RecordedParallelEnv | RecordedJointEnv"


class _Episode:
    """The episode that an environment plays, taken down."""

    def __init__(self, episodes: EpisodeBatch, policy: str) -> None:
        self._episodes, self._policy = episodes, policy
        self._recorder: Recorder | None = None

    def begin(self, seed: int | None) -> None:
        """Begin anew, after a reset."""
        episodes = self._episodes
        self._recorder = Recorder(episodes.world, episodes.current, self._policy, seed)

    def add(self) -> None:
        """Take down the slot that was just played."""
        events = self._episodes.last_events
        if self._recorder is not None and events is not None:
            with np.errstate(over="ignore", invalid="ignore"):
                self._recorder.add(events, self._episodes.current)

    @property
    def recording(self) -> Recording:
        if self._recorder is None:
            raise RuntimeError("the episode has not begun: call reset() first")
        return self._recorder.recording()


class RecordedParallelEnv(BaseParallelWrapper[str, Any, Any]):  # type: ignore[misc] # without types
    """A PettingZoo environment that records its episode; see `record`."""

    def __init__(self, env: ParallelEnv[str, Any, Any], policy: str) -> None:
        super().__init__(env)
        self._episode = _Episode(env.unwrapped.episodes, policy)

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode, and its recording."""
        result = self.env.reset(seed=seed, options=options)
        self._episode.begin(seed)
        return result

    def step(self, actions: dict[str, Any]) -> Any:
        """One slot, which is recorded."""
        result = self.env.step(actions)
        self._episode.add()
        return result

    @property
    def recording(self) -> Recording:
        """The episode so far, until the next reset.

        Raises:
            RuntimeError: no slot has been played.
        """
        return self._episode.recording


class RecordedJointEnv(gymnasium.Wrapper[Any, Any, Any, Any]):
    """A Gymnasium environment that records its episode; see `record`."""

    def __init__(self, env: gymnasium.Env[Any, Any], policy: str) -> None:
        super().__init__(env)
        inner = env.unwrapped
        assert isinstance(inner, AUVEnv)
        self._episode = _Episode(inner.episodes, policy)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Start an episode, and its recording."""
        result = self.env.reset(seed=seed, options=options)
        self._episode.begin(seed)
        return result

    def step(self, action: Any) -> Any:
        """One slot, which is recorded."""
        result = self.env.step(action)
        self._episode.add()
        return result

    @property
    def recording(self) -> Recording:
        """The episode so far, until the next reset.

        Raises:
            RuntimeError: no slot has been played.
        """
        return self._episode.recording


def record(env: Any, policy: str = "recorded") -> Any:
    """An environment that records the episode that is played in it.

        env = iout_marl.record(iout_v0.parallel_env("paper/k10-fdd"))
        ...                                    # reset, and step until the episode is over
        env.recording.save("episode.json")     # iout replay --recording episode.json

    Args:
        env: a PettingZoo `parallel_env` or a Gymnasium environment of this package, as it is or
            within wrappers.
        policy: what to call whoever plays.

    Returns:
        the environment, which has `recording`: the episode since the last reset.

    Raises:
        InputError: it is another environment.
    """
    inner = getattr(env, "unwrapped", None)
    if isinstance(env, ParallelEnv) and isinstance(inner, AUVParallelEnv):
        return RecordedParallelEnv(env, policy)
    if isinstance(env, gymnasium.Env) and isinstance(inner, AUVEnv):
        return RecordedJointEnv(env, policy)
    raise InputError(
        "env: must be iout_v0.parallel_env(…) or gymnasium.make('iout_marl:AUV-v0', …), "
        f"not {short(env)}"
    )
