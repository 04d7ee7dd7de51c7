"""The world: reset and step of a batch of environments, as pure functions of `State`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array, cast
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.whole import MAX_SEED, whole_argument
from iout_marl.world.actions import ActionCheck, LayoutCheck, is_on_accelerator
from iout_marl.world.age import advance, jain_index
from iout_marl.world.backend import Backend
from iout_marl.world.charging import charge
from iout_marl.world.credit import Credit
from iout_marl.world.duplex import make_duplex
from iout_marl.world.grid import Grid
from iout_marl.world.limits import MOST_ENVS, check_scenario
from iout_marl.world.link import Link
from iout_marl.world.mask import ActionMask
from iout_marl.world.motion import Motion
from iout_marl.world.nodes import NodeAxis
from iout_marl.world.observation import Observer
from iout_marl.world.placement import node_codes, start_cells
from iout_marl.world.reward import make_reward
from iout_marl.world.state import Events, State
from iout_marl.world.uplink import Request, make_access
from iout_marl.world.view import View

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

    Attributes:
        num_envs, num_auvs, num_nodes, num_slots: sizes of the batch, of the fleet, of the
            network, of an episode.
        action_sizes: number of choices of each entry of an AUV's action: (directions, K, K)
            in FDD, (directions, K) in TDD.

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
        self.backend = backend = Backend.of(library, dtype, device)
        self.grid = Grid(scenario.grid.cells)
        self.link = Link(scenario, self.grid, backend)
        self.motion = Motion(
            self.grid, scenario.auvs.motion, scenario.auvs.separation_cells, backend
        )
        self.nodes = NodeAxis(num_envs, self.num_auvs, self.num_nodes, backend)
        self.duplex = make_duplex(scenario, self.link, (num_envs, self.num_auvs), backend)
        self.access = make_access(scenario, self.link, backend)
        self.view = View(scenario, self.link, self.nodes, backend)
        self.credit = Credit(scenario, self.nodes, backend)
        self.reward_part = make_reward(scenario, self.link, self.nodes, self.credit, backend)
        self.observer = Observer(scenario, self.grid, self.link, backend)
        self.action_mask = ActionMask(scenario, self.link, self.motion, self.view, backend)
        self.action_sizes = (
            self.motion.num_directions,
            *(self.num_nodes,) * self.duplex.num_choices,
        )
        start = self.grid.encode(start_cells(scenario, self.grid))
        # Brought to the device here: later an accelerator would have to stop for them.
        self._start = backend.integers(np.tile(start, (num_envs, 1)))
        self._one_slot = backend.integers(1)
        self._one = backend.floats(1.0)
        self._check_layout = LayoutCheck((num_envs, self.num_nodes), self.grid)
        self._check_action = ActionCheck(num_envs, self.num_auvs, self.action_sizes)
        # Of every node: NumPy compares two arrays faster than an array and a number.
        nowhere = backend.zeros((num_envs, self.num_nodes))
        self._maximum_age = nowhere + float(scenario.age.maximum)

    def reset(
        self, node_cell: npt.NDArray[np.int64] | None = None, *, seed: int | None = None
    ) -> State:
        """The first state of an episode of every environment.

        Args:
            node_cell: (envs, nodes) codes of the nodes' cells, as drawn by `node_codes`; None
                draws them here, where the scenario leaves them to chance.
            seed: of that draw: environment i has the layout of an environment reset by
                `seed + i`. None takes the operating system's entropy.

        Raises:
            InputError: they are something else, or both are given. What lies on an accelerator,
                which would have to stop for it, is not looked at.
        """
        if node_cell is None:
            node_cell = self._drawn(seed)
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
            energy_j=backend.zeros(nodes),
            deliveries=backend.zeros(nodes),
            mean_age=backend.zeros(envs) + float(self.scenario.age.initial),
            jain=backend.zeros(envs),
            age_sum=backend.zeros(envs),
            peak_age=backend.zeros(envs),
            capped_ages=backend.zeros(envs),
            harvested_j=backend.zeros(envs),
            spent_j=backend.zeros(envs),
            **self.view.first(self.num_envs),
            **self.credit.first(self.num_envs),
        )

    def _drawn(self, seed: int | None) -> npt.NDArray[np.int64]:
        if seed is None:
            rngs = [np.random.default_rng() for _ in range(self.num_envs)]
        else:
            first = whole_argument("seed", seed, 0, MAX_SEED)
            rngs = [np.random.default_rng(first + i) for i in range(self.num_envs)]
        return node_codes(self.scenario, self.grid, rngs)

    def step(self, state: State, action: Array) -> tuple[State, Events]:
        """One slot of every environment.

        Args:
            state: the state before the slot.
            action: (envs, auvs, entries) int: direction, node charged, node heard (FDD),
                or direction, node (TDD), each below its `action_sizes`.

        Returns:
            the state after the slot, and what happened in it.
        """
        xp, link, nodes = self.backend.xp, self.link, self.nodes
        charged, heard = action[..., 1], action[..., -1]

        cell, left_grid, blocked = self.motion.move(state.cell, action[..., 0])

        heard_place = nodes.place(heard)
        heard_cell = nodes.chosen(state.node_cell, heard_place)
        heard_offset = link.offset(cell, heard_cell)
        if self.duplex.num_choices == 1:
            charged_offset, charged_place = heard_offset, heard_place
        else:
            charged_place = nodes.place(charged)
            charged_offset = link.offset(cell, nodes.chosen(state.node_cell, charged_place))

        stored_j = nodes.chosen(state.energy_j, heard_place)
        split = self.duplex.split(charged_offset, heard_offset, stored_j)
        harvested_j = charge(link, charged_offset, split)
        payable_j = nodes.plus(state.energy_j, charged_place, harvested_j)

        heard_payable_j = nodes.chosen(payable_j, heard_place)
        sends = self.duplex.sends(split, heard_payable_j)
        request = Request(cell, heard, heard_cell, sends, heard_payable_j, heard_offset)
        delivered, spent_j = self.access(request, split)
        # At the root of the energy balance rounding may ask for more than there is.
        taken_j = xp.minimum(spent_j, heard_payable_j)
        energy_j = nodes.plus(payable_j, heard_place, -taken_j)

        # A node delivers to one AUV at most.
        packets = cast(xp, delivered, state.age.dtype)
        overcome = -packets * nodes.chosen(state.age, heard_place)
        age, uncut = advance(xp, nodes.plus(state.age, heard_place, overcome), self._maximum_age)
        # Whole numbers, whose sums are exact.
        total_age = nodes.sum(age)
        cut_short = nodes.sum(uncut) - total_age
        mean_age = total_age / nodes.num_nodes
        deliveries = nodes.plus(state.deliveries, heard_place, packets)

        new_state = State(
            slot=state.slot + self._one_slot,
            cell=cell,
            node_cell=state.node_cell,
            age=age,
            energy_j=energy_j,
            deliveries=deliveries,
            mean_age=mean_age,
            jain=jain_index(xp, nodes.sum(deliveries), nodes.sum(deliveries**2), nodes.num_nodes),
            age_sum=state.age_sum + mean_age,
            peak_age=xp.maximum(state.peak_age, nodes.max(age)),
            capped_ages=state.capped_ages + cut_short,
            harvested_j=state.harvested_j + _over_auvs(xp, harvested_j),
            spent_j=state.spent_j + _over_auvs(xp, spent_j),
            **self.view.after(state, cell, age, energy_j, heard_place, delivered),
            **self.credit.after(state, heard_place, delivered),
        )
        events = Events(
            left_grid=left_grid,
            blocked=blocked,
            charged=charged,
            heard=heard,
            beta=split.beta,
            harvested_j=harvested_j,
            payable_j=payable_j,
            delivered=delivered,
            spent_j=spent_j,
        )
        return new_state, events

    def checked_step(self, state: State, action: Any) -> tuple[State, Events]:
        """`step`, after a look at what it is given.

        Args:
            state: a state of this world, of an episode that is not over.
            action: as for `step`; lists will do.

        Raises:
            InputError: the state is another world's; an action is not of integers, has another
                shape, or lies outside its range.
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
        return self.step(state, self.backend.integers(self._check_action(action)))

    def reward_terms(self, state: State, events: Events) -> Mapping[str, Array]:
        """The terms of a slot's reward, (envs, auvs) each; `state` is that after the slot."""
        return self.reward_part(state, events)

    def reward(self, state: State, events: Events) -> Array:
        """A slot's reward, (envs, auvs); `state` is that after the slot."""
        total, *others = self.reward_terms(state, events).values()
        for term in others:
            total = total + term
        return total

    def observe(self, state: State) -> Array:
        """Observations of every AUV, (envs, auvs, entries), in the world's floating type.

        A fresh array each time, with the environments next to one another in memory, as
        by `Backend.with_envs_inside`.
        """
        return self.observer.observe(state)

    def slot(self, state: State, action: Array) -> tuple[State, Array, Array]:
        """All of a slot that a learner needs: the state after it, rewards and observations.

        On torch it compiles into one graph, several times as fast as the calls one by one:

            slot = torch.compile(world.slot, fullgraph=True)
            state, reward, observation = slot(state, action)

        Args:
            state, action: as for `step`.
        """
        state, events = self.step(state, action)
        return state, self.reward(state, events), self.observe(state)

    def metrics(self, state: State) -> dict[str, Array]:
        """What an episode is judged by, up to `state`: (envs,) each.

        `mean_aoi` averages over nodes and over the slots that are over; `final_aoi` is
        the mean over nodes now, `peak_aoi` the highest age of any node in any slot;
        `uplink_success` the share of AUVs' slots that delivered a packet;
        `age_violations` counts node-slots in which an age would have passed A_max, and
        `jain_violation` is 1 where J lies below J_min.
        """
        xp = self.backend.xp
        slots = xp.maximum(xp.astype(state.slot, state.age.dtype), self._one)
        below = state.jain < self.scenario.fairness.minimum_jain
        return {
            "mean_aoi": state.age_sum / slots,
            "final_aoi": state.mean_age,
            "peak_aoi": state.peak_age,
            "jain": state.jain,
            "harvested_kj": state.harvested_j / 1000,
            "spent_kj": state.spent_j / 1000,
            "uplink_success": self.nodes.sum(state.deliveries) / (slots * self.num_auvs),
            "age_violations": state.capped_ages,
            "jain_violation": xp.astype(below, state.age.dtype),
        }


def _over_auvs(xp: Any, values: Array) -> Array:
    """Sum over AUVs: (envs, auvs) to (envs,)."""
    return values[:, 0] if values.shape[1] == 1 else xp.sum(values, axis=1)
