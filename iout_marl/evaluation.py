"""Runs any policy over seeded episodes, all in one batch, and reports with intervals."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.breakdown import Breakdown, Tally
from iout_marl.errors import InputError
from iout_marl.metrics import BUILTIN
from iout_marl.policies import (
    AnyPolicy,
    EpisodeStreams,
    Policy,
    chosen_by,
    is_deterministic,
    policy_for,
    take_actions,
)
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.whole import seed_argument, short, whole_argument
from iout_marl.world import Events, State, World, has_chance
from iout_marl.world.actions import ActionCheck

#: More would say no more, and not fit into memory.
MAX_EPISODES = 1_000_000

#: The built-in metrics of every world in the order of reports; those of stores with limits and
#: those of users follow. See `iout_marl.metrics`.
METRICS = tuple(metric.name for metric in BUILTIN)


@dataclass(frozen=True)
class Estimate:
    """A mean over episodes with its 95 % confidence interval (Student's t).

    The interval is NaN for a single episode, which says nothing of its spread.
    """

    mean: float
    low: float
    high: float

    @classmethod
    def from_samples(cls, samples: npt.ArrayLike) -> Estimate:
        """The estimate from (episodes,) samples.

        Raises:
            ValueError: there are none, one is NaN or infinite, or they are too large to add up.
        """
        values = np.asarray(samples, dtype=np.float64)
        if values.ndim != 1 or not len(values):
            raise ValueError(f"samples must be a list of numbers, not {short(samples)}")
        if not np.isfinite(values).all():
            raise ValueError(f"samples must be finite, not {values[~np.isfinite(values)][0]}")
        count = len(values)
        with np.errstate(over="ignore", invalid="ignore"):
            mean = float(values.mean())
            std = float(values.std(ddof=1)) if count > 1 else 0.0
        if not math.isfinite(mean + std):
            raise ValueError("samples are too large to add up")
        if count == 1:
            return cls(mean, math.nan, math.nan)
        from scipy.special import stdtrit  # slow to import, and not needed by all

        margin = float(stdtrit(count - 1, 0.975) * std / math.sqrt(count))
        return cls(mean, mean - margin, mean + margin)

    @property
    def margin(self) -> float:
        """Half the width of the interval; NaN where there is none."""
        return (self.high - self.low) / 2

    def to_json(self) -> dict[str, Any]:
        """Mean and interval as JSON has them; null where there is no interval."""
        interval = None if math.isnan(self.low) else [self.low, self.high]
        return {"mean": self.mean, "ci95": interval}


@dataclass(frozen=True)
class Evaluation:
    """A policy's record on a scenario.

    Attributes:
        scenario, scenario_hash: what was played; where a layout is drawn once for a run, the
            hash is that of the scenario with the layout.
        policy: what the policy is called.
        seed: of the first episode.
        samples: every metric of every episode, (episodes,) each.
        deterministic: neither policy nor world has left anything to chance: all episodes are
            like the one that was played.
        sampled: a trained policy has drawn its actions, rather than taken the most probable.
        breakdown: figures of each node and each AUV, if they were asked for.
    """

    scenario: str
    scenario_hash: str
    policy: str
    seed: int
    samples: dict[str, npt.NDArray[np.float64]] = field(repr=False)
    deterministic: bool = False
    sampled: bool = False
    breakdown: Breakdown | None = field(default=None, repr=False)

    @property
    def episodes(self) -> int:
        """How many were played."""
        return len(next(iter(self.samples.values())))

    @property
    def label(self) -> str:
        """What tables call the policy."""
        return f"{self.policy} (sampled)" if self.sampled else self.policy

    @property
    def metrics(self) -> dict[str, Estimate]:
        """Means and intervals of all metrics."""
        return {name: Estimate.from_samples(values) for name, values in self.samples.items()}

    def to_json(self) -> dict[str, Any]:
        """The record as JSON has it; the interval of a single episode is null."""
        return {
            "scenario": self.scenario,
            "scenario_hash": self.scenario_hash,
            "policy": self.policy,
            **({"sampled": True} if self.sampled else {}),
            "episodes": self.episodes,
            "deterministic": self.deterministic,
            "seed": self.seed,
            "metrics": {name: estimate.to_json() for name, estimate in self.metrics.items()},
            **({} if self.breakdown is None else _breakdown_json(self.breakdown)),
        }


def _breakdown_json(breakdown: Breakdown) -> dict[str, Any]:
    """A row for each node and each AUV, counted from 1."""
    return {
        "slot_s": breakdown.slot_s,
        **{
            f"{what}s": [
                {
                    what: i + 1,
                    **{
                        name: Estimate.from_samples(values[:, i]).to_json()
                        for name, values in columns.items()
                    },
                }
                for i in range(next(iter(columns.values())).shape[1])
            ]
            for what, columns in (("node", breakdown.nodes), ("auv", breakdown.auvs))
        },
    }


def evaluate(
    scenario: AnyScenario,
    policy: AnyPolicy,
    episodes: int = 100,
    seed: int = 0,
    *,
    overrides: Overrides = None,
    breakdown: bool = False,
    observe: Callable[[World, State, Events | None], None] | None = None,
) -> Evaluation:
    """Run a policy over whole episodes.

    Args:
        scenario: a scenario, its name, its path, or a mapping with the keys of a file.
        policy: a `Policy`; a function from (envs, auvs, entries) observations to (envs, auvs,
            entries) actions; or whatever `load_policy` takes: the name of a baseline, the folder
            of a run, `MODULE:NAME`. Where a layout is drawn once for a run, a run that is named
            by its folder plays in its own.
        episodes: how many, run side by side as one batch. Where neither the policy (by its
            `is_deterministic`) nor the world leaves anything to chance, one is played.
        seed: episode i has the seed `seed + i`: that of the layout, where it is random, is
            that of an environment reset with it; and of what the policy leaves to chance.
        overrides: changes of the scenario, as for `load_scenario`.
        breakdown: also tell each node and each AUV apart.
        observe: called with the world, the first state and None, and after every slot with the
            world, the state after it and what happened in it; of all episodes as a batch.

    Raises:
        InputError: no such scenario or policy, a run of another scenario, episodes or a seed out
            of range, a policy whose actions are not integers, of another shape, or outside their
            space, a scenario whose numbers grow beyond all bounds, or a user's metric whose
            values are of another shape, not finite or out of its bounds.
    """
    episodes = whole_argument("episodes", episodes, 1, MAX_EPISODES)
    seed = seed_argument(seed)
    scenario, player = policy_for(load_scenario(scenario, overrides), policy, seed)
    deterministic = is_deterministic(player) and not has_chance(scenario)
    world = World(scenario, 1 if deterministic else episodes)
    total_reward = np.zeros((world.num_envs, world.num_auvs))
    tally = None
    for state, events in play(world, player, seed):
        if observe is not None:
            with _unbounded():
                observe(world, state, events)
        if events is None:
            tally = Tally(world, state) if breakdown else None
            continue
        with _unbounded():
            total_reward += world.reward(state, events)
            if tally is not None:
                tally.add(state, events)
    with _unbounded():
        found = world.metrics(state)
        for metric in world.measured:
            if metric.computed_from == "rewards":
                found[metric.name] = metric.function(world, total_reward)
    samples = {
        metric.name: np.asarray(found[metric.name], dtype=np.float64) for metric in world.measured
    }
    for metric in world.measured:
        values = samples[metric.name]
        if not metric.is_builtin:
            metric.check(values)
        elif not np.isfinite(values).all():
            raise InputError(
                f"{scenario.name}: {metric.name} is {values[~np.isfinite(values)][0]}: "
                "the scenario has numbers that are too large to compute with"
            )
    return Evaluation(
        scenario=scenario.name,
        scenario_hash=scenario.hash,
        policy=str(player.name),
        seed=seed,
        samples=samples,
        deterministic=deterministic,
        sampled=bool(getattr(player, "sampled", False)),
        breakdown=None if tally is None else tally.result(state),
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
        InputError: the policy's actions do not fit their space, or it is from outside and raises.
    """
    state, chance = world.reset(seed=seed), world.draw_chance(seed)
    rng = EpisodeStreams(seed, world.num_envs)
    check = ActionCheck(world.num_envs, world.num_auvs, world.action_sizes)
    yield state, None
    for slot in range(world.num_slots):
        chosen = chosen_by(policy, world, state, rng)
        action = take_actions(policy, chosen, check, f", slot {slot + 1}")
        with _unbounded():
            state, events = world.step(state, action, next(chance))
        yield state, events


def _unbounded() -> np.errstate:
    """Numbers may grow beyond all bounds: what comes of it is looked at in the end."""
    return np.errstate(over="ignore", invalid="ignore")
