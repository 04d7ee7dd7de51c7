"""Strong baselines that know everything: tours, and a search for something better."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from iout_marl.errors import InputError, InputTypeError, warn_once
from iout_marl.policies.guided import GuidedSearch
from iout_marl.policies.policy import Actions, Policy
from iout_marl.policies.predicting import BasePolicy
from iout_marl.policies.rehearsal import Rehearsal
from iout_marl.policies.search import DEFAULT_BUDGET, Budget, Planner
from iout_marl.policies.simulator import Plan
from iout_marl.scenario import Scenario
from iout_marl.world import State, World

#: What should be known of plans where slots are left to chance.
_BY_THE_EXPECTED = (
    "searches (tour, planner, best of, beam) plan for the median sea and expected deliveries, and "
    "their plans are then played in the sea as it is drawn, without planning anew"
)


class _Planned(BasePolicy):
    """Plays episodes as planned; from a state that no plan has foreseen it plans anew.

    Knows the whole scenario and the whole state, and learns nothing. The layouts that are
    planned in one slot share the budget. Where slots are left to chance, it plans by
    `World.expected`, and then does in each slot what it has planned for it, whatever has happened.
    """

    #: What a search leaves to chance, a seed of its own decides.
    is_deterministic = True
    plans_ahead = True
    searches: bool = False

    def __init__(
        self, budget: Budget = DEFAULT_BUDGET, *, warm: Sequence[Policy] = (), seed: int = 0
    ) -> None:
        self._budget = budget
        self._warm = tuple(warm)
        self._seed = seed
        self._known: WeakKeyDictionary[World, tuple[Any, list[Plan | None]]]
        self._known = WeakKeyDictionary()

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:  # noqa: ARG002
        if world.chance:
            warn_once(_BY_THE_EXPECTED)
        if world not in self._known:
            self._known[world] = self._planner(world.scenario), [None] * world.num_envs
        planner, plans = self._known[world]
        slots: list[int] = []
        fresh: dict[bytes, tuple[State, list[int]]] = {}
        for env, plan in enumerate(plans):
            here = State(*(array[env : env + 1] for array in state))
            slot = _foreseen(plan, here, by_time=bool(world.chance))
            slots.append(slot or 0)
            if slot is None:
                # Of environments that are alike one is planned.
                key = b"".join(np.asarray(array).tobytes() for array in here)
                fresh.setdefault(key, (here, []))[1].append(env)
        if fresh:
            made = self._plans(planner, [here for here, _ in fresh.values()])
            for (_, envs), plan in zip(fresh.values(), made, strict=True):
                for env in envs:
                    plans[env] = plan
        return np.array(
            [plan.actions[slot] for plan, slot in zip(plans, slots, strict=True) if plan]
        )

    def _planner(self, scenario: Scenario) -> Any:
        """Who makes the plans of a scenario."""
        return Planner(scenario, searches=self.searches, seed=self._seed)

    def _plans(self, planner: Any, states: Sequence[State]) -> list[Plan]:
        """A plan from each of the states, of one environment each."""
        budget = self._budget.shared(len(states))
        return [planner.plan(state, budget, self._warm) for state in states]


class Tour(_Planned):
    """Every AUV goes round its share of the nodes, charging and hearing by a fixed rule.

    Tours of several reaches are played in the world before the first slot, the best is kept.
    """

    name = "tour"

    def __init__(self) -> None:
        super().__init__()


class PlannerPolicy(_Planned):
    """The best tour, improved on by beam searches in the world itself, see `Planner`.

    Args:
        budget: how long to search, for all layouts that are planned in one slot: each gets
            an equal share. Of rounds it is rounded down: a hundred random layouts have the
            first search each and no round, unless there are a hundred. Of seconds it is up:
            each has one round at least.
        warm: policies, trained ones say, whose episodes the plans are to be no worse than.
        seed: of whatever the search leaves to chance.
    """

    name = "planner"
    searches = True


class _PlayedAhead(_Planned):
    """Plans all layouts of a slot together, by what a trained policy does."""

    def _plans(self, planner: Any, states: Sequence[State]) -> list[Plan]:
        made: list[Plan] = planner.plans(states)
        return made


class BestOf(_PlayedAhead):
    """The best of several episodes that a trained policy plays ahead, from the same state.

    In the first it takes the most probable actions, in the others it draws them. The best is the
    one of the lowest mean AoI.

    Args:
        policy: has an attribute `sampled`: whether it draws its actions.
        episodes: how many are played ahead, at least 1.
        mirrored: play ahead in the seven other mirror images of the world, too, by the most
            probable actions.
        seed: of what is drawn.

    Raises:
        InputError: there is to be no episode.
        InputTypeError: it is no such policy.
    """

    def __init__(
        self, policy: Policy, episodes: int = 1, *, mirrored: bool = False, seed: int = 0
    ) -> None:
        super().__init__(seed=seed)
        _check_search("BestOf", policy, "sampled", episodes)
        ways = [f"best of {episodes}"] * (episodes > 1) + ["mirrored"] * mirrored
        self.name = ", ".join([policy.name, *ways])
        self._policy = policy
        self._episodes, self._mirrored = episodes, mirrored

    def _planner(self, scenario: Scenario) -> Any:
        return Rehearsal(
            scenario, self._policy, self._episodes, mirrored=self._mirrored, seed=self._seed
        )


class GuidedBeam(_PlayedAhead):
    """A beam search in the world that a trained policy guides: see `GuidedSearch`.

    Args:
        policy: names its most probable actions, as trained ones do (`likely_actions`).
        episodes: how many are kept in every slot, at least 1.

    Raises:
        InputError, InputTypeError: as of `BestOf`.
    """

    def __init__(self, policy: Policy, episodes: int = 16) -> None:
        super().__init__()
        _check_search("GuidedBeam", policy, "likely_actions", episodes)
        self.name = f"{policy.name}, beam of {episodes}"
        self._policy = policy
        self._episodes = episodes

    def _planner(self, scenario: Scenario) -> Any:
        return GuidedSearch(scenario, self._policy, self._episodes)


def _check_search(who: str, policy: Policy, needs: str, episodes: int) -> None:
    """Refuse a policy that was not trained, and no episodes.

    Raises:
        InputError, InputTypeError: as of `BestOf`.
    """
    if not hasattr(policy, needs):
        raise InputTypeError(
            f"{who}: needs a trained policy, with {needs}, not {getattr(policy, 'name', policy)}"
        )
    if episodes < 1:
        raise InputError(f"{who}: needs at least one episode, not {episodes}")


def _foreseen(plan: Plan | None, state: State, *, by_time: bool) -> int | None:
    """The slot of the plan, counted from its first, that is to begin in the state of one env.

    Args:
        plan: the plan, if there is any.
        state: the state.
        by_time: whether only the layout and the time must be as planned.
    """
    if plan is None:
        return None
    row = int(state.slot[0] - plan.states.slot[0])
    if not 0 <= row < len(plan.actions):
        return None
    expected = plan.states.map(lambda array: array[row])
    if by_time:
        return row if np.array_equal(expected.node_cell, state.node_cell[0]) else None
    alike = (
        np.array_equal(expected.cell, state.cell[0])
        and np.array_equal(expected.node_cell, state.node_cell[0])
        and np.array_equal(expected.age, state.age[0])
        # The last digits depend on how many environments are computed at once.
        and np.allclose(expected.energy_j, state.energy_j[0], rtol=1e-6)
        and np.allclose(expected.battery_j, state.battery_j[0], rtol=1e-6)
    )
    return row if alike else None
