"""What a slot does: a state and the AUVs' actions lead to the next state."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from iout_marl.core.age import advance, jain_index
from iout_marl.core.chance import Chance
from iout_marl.core.split import Split
from iout_marl.core.state import Events, State
from iout_marl.parts import Request
from iout_marl.physics.arrays import Array, cast
from iout_marl.world.addressed import Addressed
from iout_marl.world.chance import completed
from iout_marl.world.polled import Polled, listen
from iout_marl.world.reception import Received

if TYPE_CHECKING:
    from iout_marl.world.world import World


class _Ages(NamedTuple):
    """What a slot makes of the ages."""

    age: Array  # (envs, nodes) slots
    deliveries: Array  # (envs, nodes) count, so far
    mean_age: Array  # (envs,) slots, over nodes
    counted_age: Array  # (envs,) slots, over nodes: what the slot adds to the sum of ages
    capped_ages: Array  # (envs,) count, or slots: what the cap has taken


class Transition:
    """Steps a world: move → charge → uplink → age.

    Args:
        world: the world, whose parts are set up.
    """

    def __init__(self, world: World) -> None:
        self._world, backend = world, world.backend
        self._one_slot = backend.integers(1)
        self._nothing = backend.floats(0.0)
        self._nobody = backend.integers(world.num_nodes)
        self._no_chance = completed({}, backend, {}, world.num_envs)
        rounds = (world.num_envs, world.num_auvs, world.hearing.rounds(world.num_nodes))
        #: Fields of events where nobody polls.
        self._none_polled = {
            "polled": backend.integers(np.zeros(rounds)),
            "polled_delivered": backend.zeros(rounds) > 0,
            "polled_j": backend.zeros(rounds),
        }
        self._none_lost = {
            "lost": backend.zeros((world.num_envs, world.num_auvs, 0)) > 0,
            "excess_db": backend.zeros((world.num_envs, world.num_auvs, 0)),
        }
        # Of every node: NumPy compares two arrays faster than an array and a number.
        nowhere = backend.zeros((world.num_envs, world.num_nodes))
        self._maximum_age = nowhere + float(world.scenario.age.maximum)

    def __call__(self, state: State, action: Array, chance: Chance | None) -> tuple[State, Events]:
        """See `World.step`."""
        world = self._world
        xp, link, nodes = world.backend.xp, world.link, world.nodes
        charged, heard = action[..., 1], action[..., -1]

        reception, conditions = world.reception, None
        if reception is not None:
            conditions = reception.conditions(state, self._no_chance if chance is None else chance)
        stranded = world.vehicle.none_stranded
        if world.vehicle.is_limited:
            stranded = world.vehicle.is_stranded(state.battery_j)
            charged, heard = (xp.where(stranded, self._nobody, each) for each in (charged, heard))
        moved = world.manoeuvre.move(state, action[..., 0], stranded)
        heading = cell = moved.cell

        (
            heard_index,
            heard_cell,
            heard_offset,
            charged_index,
            charged_offset,
            charges,
            hears,
        ) = self.addressed(state.node_cell, cell, charged, heard)
        stored_j = nodes.gather(state.energy_j, heard_index)
        split = world.duplex.split(charged_offset, heard_offset, stored_j)
        if charges is not None:
            split = self.without_idle(split, charges)
        if world.vehicle.is_limited:
            heading = world.motion.heading(moved)
            can_charge = world.vehicle.can_charge(
                state, heading, split.charging_s, moved.propulsion_j
            )
            charged = xp.where(can_charge, charged, self._nobody)
            if world.duplex.num_choices == 1:
                # Charging and hearing are one act.
                heard, hears = charged, hears & can_charge
            split = self.without_idle(split, can_charge)
        vehicle, drawn_j = world.vehicle.after(
            state, cell, heading, stranded, split.charging_s, moved.propulsion_j, moved.idle
        )
        # Eq. `E harvested`; a node charged by two AUVs gets both.
        if reception is None or conditions is None:
            harvested_w = link.at(link.harvested_w, charged_offset)
        else:
            harvested_w = reception.harvested_w(conditions, charged, charged_offset)
        gain_db = None if conditions is None else conditions.gain_db
        harvested_j = harvested_w * split.charging_s
        come_j = nodes.scatter_add(state.energy_j, charged_index, harvested_j)
        available_j = world.storage.filled(come_j)

        heard_available_j = nodes.gather(available_j, heard_index)
        sends = self.sends(split, heard_index, hears, come_j, heard_available_j)
        request = Request(cell, heard, heard_cell, sends, heard_available_j, heard_offset)
        heard_beside = polled = None
        if world.hearing.polls:
            heard_beside = listen(world, state, request, split, hears, available_j)
            uplinks = heard_beside.chosen
        else:
            uplinks = world.access(request, split)
        delivered, spent_j = uplinks
        received: Received | None = None
        if reception is not None and reception.loses:
            assert conditions is not None
            received = reception.received(conditions, state, request, uplinks, heard_beside)
            delivered = received.judged.delivered[..., 0]
        if heard_beside is not None:
            polled = Polled.from_slot(world, heard_beside, available_j, received)
        # At the root of the energy balance rounding may ask for more than there is.
        taken_j = xp.minimum(spent_j, heard_available_j)
        left_j = nodes.scatter_add(available_j, heard_index, -taken_j)
        if polled is not None:
            left_j = left_j - polled.spent_j
        stores = world.storage.after(state, come_j, available_j, left_j)

        packets = cast(xp, delivered, state.age.dtype)
        if received is not None and received.judged.share is not None:
            packets = received.judged.share[..., 0]
        ages = self._ages(state, split, heard_index, heard_offset, packets, polled)
        spent_by_all_j = _over_auvs(xp, spent_j)
        if polled is not None:
            spent_by_all_j = spent_by_all_j + nodes.sum(polled.spent_j)
        to_auvs = None if polled is None else polled.to_auvs

        new_state = State(
            slot=state.slot + self._one_slot,
            cell=cell,
            node_cell=state.node_cell,
            age=ages.age,
            deliveries=ages.deliveries,
            mean_age=ages.mean_age,
            jain=jain_index(
                xp, nodes.sum(ages.deliveries), nodes.sum(ages.deliveries**2), nodes.num_nodes
            ),
            age_sum=state.age_sum + ages.counted_age,
            peak_age=xp.maximum(
                state.peak_age, nodes.max(world.sampling.highest(state.age, ages.age))
            ),
            capped_ages=state.capped_ages + ages.capped_ages,
            harvested_j=state.harvested_j + _over_auvs(xp, harvested_j),
            spent_j=state.spent_j + spent_by_all_j,
            unasked=state.unasked if hears is None else state.unasked + self._number_unasked(hears),
            polled=state.polled if polled is None else state.polled + polled.packets,
            transit_slots=moved.transit_slots,
            course=moved.course,
            wander_m_per_s=state.wander_m_per_s
            if world.current is None
            else world.current.after(state, chance),
            gain_db=state.gain_db if gain_db is None else gain_db,
            gust_m_per_s=state.gust_m_per_s if conditions is None else conditions.gust_m_per_s,
            packets=state.packets if received is None else state.packets + received.counts,
            sums=state.sums,
            **stores,
            **vehicle,
            **world.view.after(
                state, cell, ages.age, stores["energy_j"], heard_index, delivered, to_auvs
            ),
            **world.credit.after(state, ages.age, heard_index, delivered, to_auvs),
        )
        events = Events(
            left_grid=moved.left_grid,
            blocked=moved.blocked,
            charged=charged,
            heard=heard,
            beta=split.beta,
            harvested_j=harvested_j,
            available_j=available_j,
            delivered=delivered,
            spent_j=spent_j,
            drawn_j=drawn_j,
            stranded=stranded,
            **(self._none_polled if polled is None else polled.events),
            **(self._none_lost if received is None else received.judged.events),
        )
        if world.summed:
            more = [metric.values(world, new_state, events)[:, None] for metric in world.summed]
            new_state = new_state._replace(sums=state.sums + xp.concat(more, axis=1))
        return new_state, events

    def _ages(
        self,
        state: State,
        split: Split,
        heard_index: Array,
        heard_offset: Array,
        packets: Array,
        polled: Polled | None,
    ) -> _Ages:
        """Ages and deliveries after the uplinks.

        Args:
            state: the state before the slot.
            split, heard_index, heard_offset: of the nodes heard.
            packets: (envs, auvs) float: which of them have delivered, or their expected share.
            polled: what came of nodes polled beside.
        """
        xp, nodes = self._world.backend.xp, self._world.nodes
        sampling = self._world.sampling
        # A node delivers to one AUV at most.
        age_reset = -packets * nodes.gather(state.age, heard_index)
        if sampling.is_continuous:
            if polled is None:
                reset_to = sampling.reset_to(split, heard_offset)
            else:
                reset_to = sampling.reset_to_s(polled.heard.age_s[..., 0])
            age_reset = age_reset + packets * reset_to
        age = nodes.scatter_add(state.age, heard_index, age_reset)
        if polled is not None:
            reset_to = self._nothing if polled.reset_to is None else polled.reset_to
            if polled.share is None:
                age = xp.where(polled.delivers, reset_to, age)
            else:
                age = age + polled.share * (reset_to - age)
        age, uncut = advance(xp, age, self._maximum_age)
        # Whole numbers, whose sums are exact, but for packets that are younger than a slot.
        total_age = nodes.sum(age)
        mean_age = counted_age = total_age / nodes.num_nodes
        if sampling.is_continuous:
            capped_ages = nodes.sum(cast(xp, uncut > age, age.dtype))
            counted_age = nodes.sum(sampling.counted(state.age, age)) / nodes.num_nodes
        else:
            capped_ages = nodes.sum(uncut) - total_age
        deliveries = nodes.scatter_add(state.deliveries, heard_index, packets)
        if polled is not None:
            arrived = cast(xp, polled.delivers, deliveries.dtype)
            deliveries = deliveries + (arrived if polled.share is None else polled.share)
        return _Ages(age, deliveries, mean_age, counted_age, capped_ages)

    def addressed(self, node_cell: Array, cell: Array, charged: Array, heard: Array) -> Addressed:
        """The nodes that AUVs name, and how they lie to them.

        Args:
            node_cell: (envs, nodes) codes of the nodes' cells.
            cell: (envs, auvs) codes of the AUVs' cells, after their moves.
            charged, heard: (envs, auvs) nodes, or K for nobody.
        """
        world = self._world
        link, nodes = world.link, world.nodes
        charges = hears = None
        if world.may_be_idle:
            charges, hears = charged < self._nobody, heard < self._nobody
        heard_index = nodes.flat_index(heard)
        heard_cell = nodes.gather(node_cell, heard_index)
        heard_offset = link.offset(cell, heard_cell)
        if world.duplex.num_choices == 1:
            charged_index, charged_offset = heard_index, heard_offset
        else:
            charged_index = nodes.flat_index(charged)
            charged_offset = link.offset(cell, nodes.gather(node_cell, charged_index))
        return Addressed(
            heard_index, heard_cell, heard_offset, charged_index, charged_offset, charges, hears
        )

    def without_idle(self, split: Split, charges: Array) -> Split:
        """The split of slots in which only AUVs that charge somebody, (envs, auvs) bool, do so."""
        xp, nothing = self._world.backend.xp, self._nothing
        return split._replace(
            beta=xp.where(charges, split.beta, nothing),
            charging_s=xp.where(charges, split.charging_s, nothing),
        )

    def sends(
        self,
        split: Split,
        heard_index: Array,
        hears: Array | None,
        come_j: Array,
        heard_available_j: Array,
    ) -> Array:
        """Whether the nodes heard send, (envs, auvs) bool: as the duplex part says, if they can.

        Args:
            split: the slot's split.
            heard_index, hears: which nodes are heard, see `Addressed`.
            come_j: (envs, nodes) energy after charging, before a store spills any.
            heard_available_j: (envs, auvs) energy of the nodes heard after that.
        """
        sends = self._world.duplex.sends(split, heard_available_j)
        if self._world.fades:
            # The harvest may have been less than what the split has counted on.
            sends = sends & (heard_available_j >= split.required_j)
        if hears is not None:
            sends = sends & hears
        if not self._world.storage.is_limited:
            return sends
        heard_come_j = self._world.nodes.gather(come_j, heard_index)
        return self._world.storage.permits(sends, split.required_j, heard_come_j, heard_available_j)

    def _number_unasked(self, hears: Array) -> Array:
        """How many AUVs hear nobody, (envs, 1) floats."""
        xp = self._world.backend.xp
        return xp.sum(cast(xp, ~hears, self._nothing.dtype), axis=1, keepdims=True)


def _over_auvs(xp: Any, values: Array) -> Array:
    """Sum over AUVs: (envs, auvs) to (envs,)."""
    return values[:, 0] if values.shape[1] == 1 else xp.sum(values, axis=1)
