"""Strong baselines that know everything: tours, and a search for something better."""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from iout_marl.policies.policy import Actions
from iout_marl.policies.search import Plan, Planner
from iout_marl.world import State, World


class _Planned:
    """Plays episodes as planned; from a state that no plan has foreseen it plans anew.

    Knows the whole scenario and the whole state, learns nothing and leaves nothing to chance.
    """

    searches: bool

    def __init__(self) -> None:
        self._known: WeakKeyDictionary[World, tuple[Planner, list[Plan | None]]]
        self._known = WeakKeyDictionary()

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:  # noqa: ARG002
        if world not in self._known:
            self._known[world] = (
                Planner(world.scenario, searches=self.searches),
                [None] * world.num_envs,
            )
        planner, plans = self._known[world]
        fresh: dict[bytes, Plan] = {}
        actions = []
        for env, current in enumerate(plans):
            here = State(*(array[env : env + 1] for array in state))
            plan, row = current, _foreseen(current, here)
            if plan is None or row is None:
                # Of environments that are alike one is planned.
                key = b"".join(np.asarray(array).tobytes() for array in here)
                if key not in fresh:
                    fresh[key] = planner.plan(here)
                plan, row = fresh[key], 0
                plans[env] = plan
            actions.append(plan.actions[row])
        return np.array(actions)


class Tour(_Planned):
    """Every AUV goes round its share of the nodes, charging and hearing by a fixed rule.

    Tours of several reaches are played in the world before the first slot, the best is kept.
    """

    name = "tour"
    searches = False


class PlannerPolicy(_Planned):
    """The best tour, improved on by a beam search in the world itself, see `Planner`."""

    name = "planner"
    searches = True


def _foreseen(plan: Plan | None, state: State) -> int | None:
    """The slot of the plan, counted from its first, that is to begin in the state of one env."""
    if plan is None:
        return None
    row = int(state.slot[0] - plan.states.slot[0])
    if not 0 <= row < len(plan.actions):
        return None
    expected = plan.states.map(lambda array: array[row])
    alike = (
        np.array_equal(expected.cell, state.cell[0])
        and np.array_equal(expected.node_cell, state.node_cell[0])
        and np.array_equal(expected.age, state.age[0])
        # The last digits depend on how many environments are reckoned at once.
        and np.allclose(expected.energy_j, state.energy_j[0], rtol=1e-6)
    )
    return row if alike else None
