"""Runs any policy over seeded episodes, all in one batch, and reports with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.special import stdtrit

from iout_marl.errors import InputError
from iout_marl.policies import ObservationPolicy, Policy, make_baseline
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import Events, State, World, node_codes, pin_layout
from iout_marl.world.actions import ActionCheck

#: Metrics in the order of reports. `reward` is the undiscounted return of an AUV,
#: averaged over AUVs; the others are those of `World.metrics`.
METRICS = (
    "mean_aoi",
    "final_aoi",
    "peak_aoi",
    "jain",
    "harvested_kj",
    "uplink_success",
    "reward",
    "spent_kj",
    "age_violations",
    "jain_violation",
)


@dataclass(frozen=True)
class Estimate:
    """A mean over episodes with its 95 % confidence interval (Student's t).

    The interval is NaN for a single episode, which says nothing of its spread.
    """

    mean: float
    low: float
    high: float

    @classmethod
    def of(cls, samples: npt.ArrayLike) -> Estimate:
        """The estimate from (episodes,) samples."""
        values = np.asarray(samples, dtype=np.float64)
        count, mean = len(values), float(values.mean())
        if count < 2:
            return cls(mean, math.nan, math.nan)
        margin = float(stdtrit(count - 1, 0.975) * values.std(ddof=1) / math.sqrt(count))
        return cls(mean, mean - margin, mean + margin)

    @property
    def margin(self) -> float:
        """Half the width of the interval."""
        return (self.high - self.low) / 2


@dataclass(frozen=True)
class Evaluation:
    """A policy's record on a scenario.

    Attributes:
        samples: every metric of every episode, (episodes,) each.
    """

    scenario: str
    scenario_hash: str
    policy: str
    episodes: int
    seed: int
    samples: dict[str, npt.NDArray[np.float64]] = field(repr=False)

    @property
    def metrics(self) -> dict[str, Estimate]:
        """Means and intervals of all metrics."""
        return {name: Estimate.of(values) for name, values in self.samples.items()}

    def to_json(self) -> dict[str, Any]:
        """The record as JSON has it; the interval of a single episode is null."""

        def bounds(e: Estimate) -> list[float | None]:
            return [None if math.isnan(b) else b for b in (e.low, e.high)]

        return {
            "scenario": self.scenario,
            "scenario_hash": self.scenario_hash,
            "policy": self.policy,
            "episodes": self.episodes,
            "seed": self.seed,
            "metrics": {
                name: {"mean": estimate.mean, "ci95": bounds(estimate)}
                for name, estimate in self.metrics.items()
            },
        }


def evaluate(
    scenario: str | Scenario,
    policy: str | Policy | Callable[[Any], Any],
    episodes: int = 100,
    seed: int = 0,
) -> Evaluation:
    """Run a policy over whole episodes.

    Args:
        scenario: a scenario, its name or its path.
        policy: the name of a baseline, a `Policy` (a trained one, say), or a function
            from (envs, auvs, entries) observations to (envs, auvs, entries) actions.
        episodes: how many, run side by side as one batch.
        seed: seeds the policy's choices; the layout of episode i, where it is random,
            is that of an environment reset with seed `seed + i`.

    Raises:
        InputError: no such scenario or baseline, or fewer than one episode.
        ValueError: the policy's actions are not integers, of another shape, or outside
            their space.
    """
    if episodes < 1:
        raise InputError(f"episodes must be at least 1, not {episodes}")
    if seed < 0:
        raise InputError(f"seed must not be negative, not {seed}")
    scenario = pin_layout(load_scenario(scenario), seed)
    player = _as_policy(policy)
    world = World(scenario, episodes)
    total_reward = np.zeros((episodes, world.num_auvs))
    for state, events in play(world, player, seed):
        if events is not None:
            total_reward += world.reward(state, events)
    samples = {**world.metrics(state), "reward": total_reward.mean(axis=1)}
    return Evaluation(
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        policy=player.name,
        episodes=episodes,
        seed=seed,
        samples={name: np.asarray(samples[name], dtype=np.float64) for name in METRICS},
    )


def play(world: World, policy: Policy, seed: int = 0) -> Iterator[tuple[State, Events | None]]:
    """Whole episodes of a batch, slot by slot.

    Args:
        world: the world, on NumPy.
        policy: who chooses.
        seed: as for `evaluate`.

    Yields:
        the state, and what happened in the slot before it: None for the first state.

    Raises:
        ValueError: the policy's actions do not fit their space.
    """
    streams = [np.random.default_rng(seed + i) for i in range(world.num_envs)]
    state = world.reset(node_codes(world.scenario, world.grid, streams))
    rng = np.random.default_rng(seed)
    check = ActionCheck(world.num_envs, world.num_auvs, world.action_sizes)
    yield state, None
    for _ in range(world.num_slots):
        state, events = world.step(state, check(policy.act(world, state, rng)))
        yield state, events


def _as_policy(policy: str | Policy | Callable[[Any], Any]) -> Policy:
    if isinstance(policy, str):
        return make_baseline(policy)
    if isinstance(policy, Policy):
        return policy
    if callable(policy):
        return ObservationPolicy(policy)
    raise TypeError(f"a policy needs a name and a method act, or must be callable: {policy!r}")
