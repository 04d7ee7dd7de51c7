"""How policies are asked in an environment: `predict`."""

from __future__ import annotations

import inspect
import secrets
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError, did_you_mean
from iout_marl.policies.chance import EpisodeStreams
from iout_marl.policies.forms import Question, Sizes, read_question
from iout_marl.policies.policy import Actions, Policy, chosen_by, is_deterministic, take_actions
from iout_marl.whole import short
from iout_marl.world import State, World
from iout_marl.world.actions import ActionCheck

if TYPE_CHECKING:
    from iout_marl.envs.episodes import EpisodeBatch


class BasePolicy(ABC):
    """A policy that can also be asked in an environment. Its own part is `act`.

    Attributes:
        name: what tables call it.
        plans_ahead: whether it plans whole episodes and then keeps to the plan, rather than react
            to what has happened.
    """

    name: str
    plans_ahead: bool = False

    @property
    def code(self) -> Any:
        """The class or the function that chooses."""
        return type(self)

    @abstractmethod
    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """See `Policy.act`."""

    def predict(
        self,
        observation: Any,
        mask: Any = None,
        *,
        env: Any = None,
        rng: np.random.Generator | None = None,
    ) -> Any:
        """Actions in the form that `env.step` takes, for what the environment has handed out.

        Evaluation plays the same: in an environment that was reset by a seed, the episode is that
        of `evaluate` with this seed, whatever the policy leaves to chance.

        Args:
            observation: of one agent, of all by name, of an environment or of a batch, see
                `iout_marl.policies.forms`. A policy that decides by the state of the world (all
                but trained ones) is asked for all AUVs at once, or by agents' names.
            mask: sensible actions, in the same form; they may also lie in the observation. Only
                policies that were trained with masks heed them, as in evaluation.
            env: the environment, wrapped or not: trained policies do without, unless a mask is
                wanted and none is given.
            rng: for what is left to chance; None for streams by the environment's seed.

        Raises:
            InputError: observations of another form or size, or no environment where one is needed.
        """
        if env is None:
            raise InputError(
                f"{self.name}: decides by the state of the world, of which observations are a "
                "part: predict(observation, env=env)"
            )
        episodes = episodes_of(env)
        question = read_question(observation, mask, Sizes.from_world(episodes.world), self.name)
        actions = _acted(self, episodes, rng)
        return question.answer(rows_of(actions, question, episodes, self.name))


class AskedPolicy(BasePolicy):
    """Anyone's policy, with `predict`.

    Args:
        policy: the policy.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy = policy
        self.name = policy.name

    @property
    def code(self) -> Any:
        """The policy's class."""
        return type(self.policy)

    @property
    def is_deterministic(self) -> bool:
        """As the policy says."""
        return is_deterministic(self.policy)

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        """As the policy does."""
        return self.policy.act(world, state, rng)


class ObservationPolicy(BasePolicy):
    """A plain function of the observations as a policy.

    Args:
        function: takes (envs, auvs, entries) float32 observations, returns
            (envs, auvs, entries) integer actions.
        name: what tables call it.
    """

    def __init__(self, function: Callable[[Any], Any], name: str = "") -> None:
        self._function = function
        self.name = name or str(getattr(function, "__name__", "callable"))

    @property
    def code(self) -> Any:
        """The function, or the class of what is called like one."""
        function = self._function
        return function if inspect.isroutine(function) else type(function)

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:  # noqa: ARG002
        observation = np.asarray(world.observe(state), dtype=np.float32)
        chosen = self._function(observation)
        try:
            return np.asarray(chosen)
        except ValueError:  # ragged; whoever plays it says what an action is
            return np.asarray(chosen, dtype=object)


def episodes_of(env: Any) -> EpisodeBatch:
    """What an environment plays.

    Raises:
        InputError: it is none of this package's, in any wrapper.
        RuntimeError: it was not reset yet.
    """
    from iout_marl.envs.episodes import EpisodeBatch

    episodes = getattr(getattr(env, "unwrapped", env), "episodes", None)
    if not isinstance(episodes, EpisodeBatch):
        raise InputError(
            "env: must be an environment of iout_marl, such as iout_v0.parallel_env(), AUVEnv or "
            f"AUVVectorEnv, wrapped or not, but it is {short(env)}"
        )
    return episodes


def rows_of(
    values: npt.NDArray[Any], question: Question, episodes: EpisodeBatch, who: str
) -> npt.NDArray[Any]:
    """The row, of (envs, auvs, …) values, for each row of the question.

    Raises:
        InputError: the question is neither by agents nor about all of them.
    """
    world = episodes.world
    rows = values.reshape(-1, values.shape[-1])
    if question.agents is None:
        if len(question.rows) != len(rows):
            raise InputError(
                f"{who}: decides for all AUVs at once: expected observations of {len(rows)} "
                f"(environments × AUVs), or by agent, {{'auv_0': …}}, not of {len(question.rows)}"
            )
        return rows
    known = {f"auv_{i}": i for i in range(world.num_auvs)}
    for agent in question.agents:
        if agent not in known:
            raise InputError(f"there is no agent {agent!r}{did_you_mean(str(agent), known)}")
    if world.num_envs > 1:
        raise InputError(f"{who}: observations by agent are of one environment")
    return rows[[known[agent] for agent in question.agents]]


@dataclass
class _Asked:
    """What was drawn and decided in an environment.

    Attributes:
        seeds: those of the environment's last reset by seeds.
        streams: the streams that begin with them.
        last: the policy that was asked last, the state then, and its actions.
    """

    seeds: tuple[int | None, ...]
    streams: EpisodeStreams
    last: tuple[Policy, State, Actions] | None = None


_ASKED: WeakKeyDictionary[EpisodeBatch, _Asked] = WeakKeyDictionary()


def asked_in(episodes: EpisodeBatch) -> _Asked:
    """The streams of an environment, which begin anew whenever it is reset by a seed."""
    asked = _ASKED.get(episodes)
    if asked is None or asked.seeds is not episodes.seeds:
        seeds = [secrets.randbits(63) if seed is None else seed for seed in episodes.seeds]
        asked = _ASKED[episodes] = _Asked(episodes.seeds, EpisodeStreams(seeds, len(seeds)))
    return asked


def _acted(policy: Policy, episodes: EpisodeBatch, rng: np.random.Generator | None) -> Actions:
    """The actions of all AUVs; asked again in the same slot, a policy answers the same."""
    world, state, asked = episodes.world, episodes.current, asked_in(episodes)
    if rng is None and asked.last and asked.last[0] is policy and asked.last[1] is state:
        return asked.last[2]
    check = ActionCheck(world.num_envs, world.num_auvs, world.action_sizes)
    chosen = chosen_by(policy, world, state, asked.streams if rng is None else rng)
    actions = take_actions(policy, chosen, check)
    if rng is None:
        asked.last = policy, state, actions
    return actions
