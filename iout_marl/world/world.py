"""The world: reset and step of a batch of environments, as pure functions of `State`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from types import ModuleType
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.arrays.nodes import NodeAxis
from iout_marl.core.chance import Chance
from iout_marl.core.credit import Credit
from iout_marl.core.current import CurrentField
from iout_marl.core.limits import MOST_ENVS, check_scenario
from iout_marl.core.reasons import Reason
from iout_marl.core.sampling import Sampling
from iout_marl.core.state import Events, State
from iout_marl.core.view import View
from iout_marl.errors import InputError
from iout_marl.metrics import Metric, registered
from iout_marl.parts import (
    Access,
    Context,
    Duplex,
    Hearing,
    Representation,
    Reward,
    Storage,
    Vehicle,
    at_work,
)
from iout_marl.physics.arrays import Array
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.scenario.parts import outside_parts
from iout_marl.whole import seed_argument, whole_argument
from iout_marl.world.actions import ActionCheck, LayoutCheck, is_on_accelerator
from iout_marl.world.chance import (
    ChanceStream,
    check_chance,
    draws_of,
    expected,
    first_of_current,
)
from iout_marl.world.manoeuvre import Manoeuvre
from iout_marl.world.mask import ActionMask
from iout_marl.world.observation import Observer
from iout_marl.world.outcomes import Outcomes, outcomes, polled_outcomes
from iout_marl.world.placement import node_codes
from iout_marl.world.reception import Reception, may_differ, nothing
from iout_marl.world.tables import Tables
from iout_marl.world.transition import Transition
from iout_marl.world.watch import check_first_slot

#: Changes whenever the same scenario, seed and actions would lead elsewhere, rounding apart.
WORLD_VERSION = 0
DTYPES = ("float64", "float32")


class World:
    """A scenario as a batch of environments.

    One slot is: move → charge → uplink → age → reward → observe. The world holds tables
    and constants only; what changes lies in the `State` that goes in and comes out.

    `step` takes what it is given as it is: an action out of its range would read the row of
    another node. `checked_step` looks first.

    Args:
        scenario: whatever `load_scenario` takes.
        num_envs: environments in the batch, 1 or more.
        library: array library, such as `numpy` (default) or `torch`.
        dtype: floating type, `float64` or `float32`.
        device: device of the library, or None for its default.
        overrides: changes of the scenario, as for `load_scenario`.
        measured: what episodes are judged by, of what applies to the scenario; None for all
            metrics that are registered now.

    Attributes:
        measured: the metrics that `metrics` computes, and those that rewards are needed for.
        summed: those of them that each slot adds to, in the order of `State.sums`.
        current: the current of the water; None where it is still.
        num_envs, num_auvs, num_nodes, num_slots: sizes of the batch, of the fleet, of the
            network, of an episode.
        reception: gains, noise and losses; None where nothing differs from slot to slot.
        fades: whether levels of links change from slot to slot.
        may_be_idle: whether an AUV may charge and hear nobody, which is K: by choice
            (`auvs.idle_choices`), or for want of energy.
        chance: what a slot draws of each environment, by field of `Chance`; empty where the
            scenario leaves nothing of a slot to chance.
        expected: the chance by which planners step, whose normal numbers are 0, and which has no
            uniform ones: of what they decide the expected share happens. None where nothing is
            left to chance.
        action_sizes: number of choices of each entry of an AUV's action: (directions, K, K)
            in FDD, (directions, K) in TDD; K + 1 for K with `auvs.idle_choices`.

    Raises:
        InputError: no such scenario, a fault in it, an argument is something else, or the
            scenario makes numbers that no array holds.
    """

    def __init__(
        self,
        scenario: AnyScenario,
        num_envs: int = 1,
        library: Any = np,
        dtype: str = "float64",
        device: Any = None,
        *,
        overrides: Overrides = None,
        measured: Sequence[Metric] | None = None,
    ) -> None:
        scenario = load_scenario(scenario, overrides)
        if dtype not in DTYPES:
            raise InputError(f"dtype must be one of {', '.join(DTYPES)}, not {dtype!r}")
        check_scenario(scenario)
        num_envs = whole_argument("num_envs", num_envs, 1, MOST_ENVS)
        self.scenario = scenario
        self.num_envs = num_envs
        self.num_auvs = scenario.num_auvs
        self.num_nodes = scenario.num_nodes
        self.num_slots = scenario.num_slots
        asked = registered() if measured is None else measured
        self.measured = tuple(metric for metric in asked if metric.applies(scenario))
        self.summed = tuple(metric for metric in self.measured if metric.computed_from == "slot")
        self.backend = backend = Backend.from_library(library, dtype, device)
        # What stands in for an array library, to write down what is done, has constants of its own.
        make_tables = Tables.shared if isinstance(library, ModuleType) else Tables
        self._tables = tables = make_tables(scenario, backend)
        self.grid, self.link, self.motion = tables.grid, tables.link, tables.motion
        self.may_be_idle = scenario.may_be_idle
        self.nodes = NodeAxis(
            num_envs,
            self.num_auvs,
            self.num_nodes,
            backend,
            names_nobody=self.may_be_idle or scenario.hearing.part.polls,
        )
        self.sampling = Sampling(scenario, self.link, backend)
        self.view = View(scenario, self.link, self.nodes, backend)
        self.credit = Credit(scenario, self.nodes, backend)
        self.representation: Representation = scenario.observation.part
        flows = scenario.current.part.flows
        self.current = CurrentField(scenario, self.grid, backend) if flows else None
        self._context = context = Context(
            scenario,
            num_envs,
            backend,
            self.grid,
            self.link,
            self.nodes,
            self.credit,
            self.view,
            self.representation,
            self.current,
            self.motion.neighbours,
            lambda: self.duplex.needed_j(),  # noqa: PLW0108 (the duplex is set up later)
        )
        with scenario.observation.entry.blamed():
            self.representation.setup(context)
        self.storage: Storage = at_work(scenario.storage, context)
        self.vehicle: Vehicle = at_work(scenario.vehicle, context)
        self.manoeuvre = Manoeuvre(context, self.motion, self.vehicle)
        self.duplex: Duplex = at_work(scenario.duplex, context)
        self.access: Access = at_work(scenario.channel.access, context)
        self.hearing: Hearing = at_work(scenario.hearing, context)
        self.reception = Reception(scenario, context) if may_differ(scenario) else None
        self.fades = self.reception is not None and self.reception.fades
        self.reward_part: Reward = at_work(scenario.reward, context)
        self.observer = Observer(scenario, context)
        self.action_mask = ActionMask(
            scenario, context, self.motion, self.manoeuvre, self.storage, self.vehicle
        )
        self.action_sizes = (
            self.motion.num_directions,
            *(self.num_nodes + scenario.auvs.idle_choices,) * self.duplex.num_choices,
        )
        start = self.grid.encode(scenario.starts())
        # Brought to the device here: later an accelerator would have to stop for them.
        self._start = backend.integers(np.tile(start, (num_envs, 1)))
        self._one = backend.floats(1.0)
        self._check_layout = LayoutCheck((num_envs, self.num_nodes), self.grid)
        self._check_action = ActionCheck(num_envs, self.num_auvs, self.action_sizes)
        self.chance = draws_of(scenario)
        self.expected = expected(backend, self.chance, num_envs) if self.chance else None
        self.transition = Transition(self)
        self._check_parts(library, dtype, device)

    def _check_parts(self, library: Any, dtype: str, device: Any) -> None:
        """Look at what parts from outside return in a first slot: once, on arrays of this kind."""
        is_from_outside = any(outside_parts(self.scenario))
        if is_from_outside and isinstance(library, ModuleType):
            check_first_slot(_Unchecked, self.scenario, library, dtype, device)

    def reset(
        self,
        node_cell: npt.NDArray[np.int64] | None = None,
        *,
        seed: int | None = None,
        current: Array | None = None,
    ) -> State:
        """The first state of an episode of every environment.

        Args:
            node_cell: (envs, nodes) codes of the nodes' cells, as drawn by `node_codes`; None
                draws them here, where the scenario leaves them to chance.
            seed: of that draw: environment i has the layout of an environment reset by
                `seed + i`. None takes the operating system's entropy.
            current: (envs, 2) standard normal numbers that a current which changes by chance
                begins with, of `first_of_current`; None draws them where layouts are drawn here,
                and else begins with its mean.

        Raises:
            InputError: they are something else, or both are given. What lies on an accelerator,
                which would have to stop for it, is not looked at.
        """
        if node_cell is None:
            streams = self._streams(seed)
            node_cell = node_codes(self.scenario, self.grid, streams)
            if self.chance and current is None:
                current = first_of_current(self.scenario, streams)
        elif seed is not None:
            raise InputError("seed: node_cell says where the nodes lie; give one of the two")
        if not is_on_accelerator(node_cell):
            self._check_layout(node_cell)
        backend, xp, envs = self.backend, self.backend.xp, (self.num_envs,)
        nodes = (self.num_envs, self.num_nodes)
        return State(
            slot=xp.zeros(envs, dtype=xp.int64, device=backend.device),
            cell=xp.asarray(self._start, copy=True),
            node_cell=backend.with_envs_inside(backend.integers(node_cell)),
            age=backend.zeros(nodes) + float(self.scenario.age.initial),
            deliveries=backend.zeros(nodes),
            mean_age=backend.zeros(envs) + float(self.scenario.age.initial),
            jain=backend.zeros(envs),
            age_sum=backend.zeros(envs),
            peak_age=backend.zeros(envs),
            capped_ages=backend.zeros(envs),
            harvested_j=backend.zeros(envs),
            spent_j=backend.zeros(envs),
            **self.storage.first(self.num_envs),
            **self.view.first(self.num_envs),
            **self.credit.first(self.num_envs),
            **self.vehicle.first(self.num_envs),
            unasked=backend.zeros((self.num_envs, int(self.may_be_idle))),
            polled=backend.zeros((self.num_envs, int(self.hearing.polls))),
            **self.motion.first(self.num_envs),
            wander_m_per_s=backend.zeros((self.num_envs, 0))
            if self.current is None
            else self.current.first(self.num_envs, current),
            **self._first_of_sea(),
            sums=backend.zeros((self.num_envs, len(self.summed))),
        )

    def _first_of_sea(self) -> dict[str, Array]:
        if self.reception is None:
            return nothing(self.backend, self.num_envs, self.num_auvs)
        return self.reception.first(self.num_envs)

    def _streams(self, seed: int | None) -> list[np.random.Generator]:
        if seed is None:
            return [np.random.default_rng() for _ in range(self.num_envs)]
        first = seed_argument(seed)
        return [np.random.default_rng(first + i) for i in range(self.num_envs)]

    def draw_chance(self, seed: int | None = None) -> Iterator[Chance | None]:
        """The chance of an episode of every environment, slot by slot, for `step`.

        Args:
            seed: environment i has the chance of an environment reset by `seed + i`. None takes
                the operating system's entropy.

        Raises:
            InputError: the seed is something else.
        """
        stream = ChanceStream(self.scenario, self._streams(seed))
        return (chance and chance.map(self.backend.floats) for chance in stream)

    def step(
        self, state: State, action: Array, chance: Chance | None = None
    ) -> tuple[State, Events]:
        """One slot of every environment.

        Args:
            state: the state before the slot.
            action: (envs, auvs, entries) int: direction, node charged, node heard (FDD),
                or direction, node (TDD), each below its `action_sizes`. With
                `auvs.idle_choices` node K is nobody. An AUV that charges nobody makes no sound
                for it, and in TDD its β is 0. One that hears nobody gets no packet, no node spends
                anything for it, it takes no part of the band, and it polls nobody. So it is with an
                AUV whose battery is empty, whatever it names; its direction is ignored, too.
            chance: what was drawn for the slot, such as by `draw_chance`, or `expected`. None in
                worlds that leave nothing to chance, which do not look at it.

        Returns:
            the state after the slot, and what happened in it.

        Raises:
            InputError: there is no chance in a world that takes some.
        """
        if chance is None and self.chance:
            raise InputError(
                f"{self.scenario.name} leaves {', '.join(self.chance)} to chance: pass "
                "`chance`, such as next(world.draw_chance(seed)) in each slot, or world.expected"
            )
        return self.transition(state, action, chance)

    def outcomes(self, before: State, events: Events, after: State) -> Outcomes:
        """Why uplinks of a slot have failed, of a world on NumPy: see `world.outcomes`."""
        return outcomes(self, before, events, after)

    def polled_outcomes(
        self, before: State, events: Events, after: State
    ) -> list[list[list[Reason | None]]]:
        """The same of nodes polled beside: see `world.outcomes.polled_outcomes`."""
        return polled_outcomes(self, before, events, after)

    def checked_step(
        self, state: State, action: Any, chance: Chance | None = None
    ) -> tuple[State, Events]:
        """`step`, after a look at what it is given.

        Args:
            state: a state of this world, of an episode that is not over.
            action: as for `step`; lists will do.
            chance: as for `step`.

        Raises:
            InputError: the state, or the chance, is another world's; an action is not of integers,
                has another shape, or lies outside its range.
            RuntimeError: an episode is over.
        """
        if not isinstance(state, State):
            raise InputError("state must be one that `reset` or `step` has given")
        shapes = tuple(state.cell.shape), tuple(state.node_cell.shape)
        expected = (self.num_envs, self.num_auvs), (self.num_envs, self.num_nodes)
        if shapes != expected:
            raise InputError(
                f"state is that of another world: its AUVs and nodes have shapes {shapes[0]} and "
                f"{shapes[1]}, here it is {expected[0]} and {expected[1]}"
            )
        if int(self.backend.xp.max(state.slot)) >= self.num_slots:
            raise RuntimeError(f"the episode is over, after {self.num_slots} slots: reset first")
        if chance is not None:
            check_chance(chance, self.chance, self.num_envs)
        return self.step(state, self.backend.integers(self._check_action(action)), chance)

    def reward_terms(self, state: State, events: Events) -> Mapping[str, Array]:
        """The terms of a slot's reward, (envs, auvs) each; `state` is that after the slot."""
        return self.reward_part(state, events)

    def reward(self, state: State, events: Events) -> Array:
        """A slot's reward, (envs, auvs); `state` is that after the slot."""
        return self.total_reward(self.reward_terms(state, events))

    def total_reward(self, terms: Mapping[str, Array]) -> Array:
        """The sum of a reward's terms, (envs, auvs)."""
        total, *others = terms.values()
        for term in others:
            total = total + term
        if total.shape[1] != self.num_auvs:  # all terms are for all AUVs alike
            total = self.nodes.broadcast_to_auvs(total[:, 0])
        return total

    def observe(self, state: State) -> Array:
        """Observations of every AUV, (envs, auvs, entries), in the world's floating type.

        A fresh array each time, with the environments next to one another in memory, as
        by `Backend.with_envs_inside`.
        """
        return self.observer.observe(state)

    def observer_as(self, scenario: AnyScenario) -> Observer:
        """What sees this world's states as a scenario says that differs in `observation` alone.

        Raises:
            InputError: its observation has another view of the nodes, which states depend on.
        """
        other = load_scenario(scenario)
        if other.observation.view_range_m != self.scenario.observation.view_range_m:
            raise InputError("observation.view_range_m: must be that of the world that is seen")
        representation: Representation = other.observation.part
        context = replace(self._context, scenario=other, representation=representation)
        with other.observation.entry.blamed():
            representation.setup(context)
        return Observer(other, context)

    def slot(
        self, state: State, action: Array, chance: Chance | None = None
    ) -> tuple[State, Array, Array]:
        """All of a slot that a learner needs: the state after it, rewards and observations.

        On torch it compiles into one graph, several times as fast as the calls one by one:

            slot = torch.compile(world.slot, fullgraph=True)
            state, reward, observation = slot(state, action)

        Args:
            state, action, chance: as for `step`.
        """
        state, events = self.step(state, action, chance)
        return state, self.reward(state, events), self.observe(state)

    def metrics(self, state: State) -> dict[str, Array]:
        """What an episode is judged by, up to `state`, by name: (envs,) each.

        See `iout_marl.metrics`; all but those of rewards, which no state keeps.

        Raises:
            InputError: a user's metric is no (envs,) array of numbers.
        """
        sums = {metric.name: state.sums[:, i] for i, metric in enumerate(self.summed)}
        return {
            metric.name: sums[metric.name] if metric.name in sums else metric.values(self, state)
            for metric in self.measured
            if metric.computed_from != "rewards"
        }

    def with_sums_of(self, state: State, summed: Sequence[str]) -> State:
        """The state of a world that sums these metrics, by name, as one of this world.

        Metrics that it has not summed begin at 0.
        """
        names = [metric.name for metric in self.summed]
        if names == list(summed):
            return state
        none = self.backend.zeros((self.num_envs,))
        columns = [state.sums[:, summed.index(name)] if name in summed else none for name in names]
        empty = self.backend.zeros((self.num_envs, 0))
        xp = self.backend.xp
        return state._replace(sums=xp.stack(columns, axis=1) if columns else empty)

    def slots_over(self, state: State) -> Array:
        """Slots of the episode that are over, at least 1, as floats: (envs,)."""
        xp = self.backend.xp
        return xp.maximum(xp.astype(state.slot, state.age.dtype), self._one)


class _Unchecked(World):
    """A world whose parts are about to be looked at."""

    def _check_parts(self, library: Any, dtype: str, device: Any) -> None:
        pass
