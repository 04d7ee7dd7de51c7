"""What polling further nodes comes to, node by node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from iout_marl.core.split import Split
from iout_marl.core.state import State
from iout_marl.parts import Call, Heard, Request
from iout_marl.physics.arrays import Array, cast
from iout_marl.world.reception import Conditions, Judged

if TYPE_CHECKING:
    from iout_marl.world.world import World


@dataclass(frozen=True)
class Polled:
    """Who was heard in a slot, and what became of the nodes that were polled beside.

    Attributes:
        heard: what the hearing part says.
        to_auvs: (envs, auvs, nodes) bool: the node polled has delivered to that AUV.
        delivers: (envs, nodes) bool: it has delivered to any.
        spent_j: (envs, nodes) J: energy that it has spent.
        reset_to: (envs, nodes) slots: its age if it has delivered, less the slot by which all grow.
        packets: (envs, 1) float: how many were sent.
        judged: of each round, what became of its packets; empty where none may get lost.
        share: (envs, nodes) float: with which share it is expected to have delivered to any; None
            where that is drawn.
    """

    heard: Heard
    to_auvs: Array
    delivers: Array
    spent_j: Array
    reset_to: Array
    packets: Array
    judged: tuple[Judged, ...] = ()
    share: Array | None = None

    @classmethod
    def from_slot(
        cls,
        world: World,
        state: State,
        request: Request,
        split: Split,
        hears: Array | None,
        available_j: Array,
        conditions: Conditions | None,
    ) -> Polled:
        """Have the AUVs of a world whose hearing part polls hear.

        Args:
            world: the world.
            state: the state before the slot.
            request, split, hears: of the nodes chosen, as in `World.step`.
            available_j: (envs, nodes) energies when the uplinks begin.
            conditions: of the slot, where levels change or packets get lost.
        """
        heard = listen(world, state, request, split, hears, available_j)
        # An AUV goes on to the next node as if nothing had got lost: that is judged afterwards.
        judged = _judged(world, state, request, heard, conditions)
        if judged:
            arrived = [packets.delivered[..., None] for packets in judged]
            heard = heard._replace(delivered=world.backend.xp.concat(arrived, axis=2))
        backend, nodes = world.backend, world.nodes
        xp = backend.xp
        to_auvs, spent_j = None, backend.zeros(available_j.shape)
        reset_to, share = backend.zeros(available_j.shape), None
        for i in range(world.hearing.rounds(world.num_nodes)):
            place = nodes.flat_index(heard.node[..., i])
            delivered = heard.delivered[..., i]
            flags = nodes.flags(place, delivered)
            to_auvs = flags if to_auvs is None else to_auvs | flags
            # As of the nodes chosen, rounding may ask for more than there is.
            taken_j = xp.minimum(heard.spent_j[..., i], nodes.gather(available_j, place))
            spent_j = nodes.scatter_add(spent_j, place, taken_j)
            if world.sampling.is_continuous:
                age = world.sampling.reset_to_s(heard.age_s[..., i])
                # Of what is expected, the age is that of a packet that arrives.
                came = delivered | judged[i].lost if judged else delivered
                own = cast(xp, came, age.dtype) * age
                reset_to = nodes.scatter_add(reset_to, place, own)
            if judged and judged[i].share is not None:
                before = backend.zeros(available_j.shape) if share is None else share
                share = nodes.scatter_add(before, place, judged[i].share)
        sent = cast(xp, heard.node < world.num_nodes, available_j.dtype)
        return cls(
            heard=heard,
            to_auvs=to_auvs,
            delivers=backend.with_envs_inside(xp.any(to_auvs, axis=1)),
            spent_j=spent_j,
            reset_to=reset_to,
            packets=xp.sum(xp.sum(sent, axis=2), axis=1, keepdims=True),
            judged=judged,
            share=share,
        )

    @property
    def events(self) -> dict[str, Array]:
        """Fields of the slot's events."""
        heard = self.heard
        return {
            "polled": heard.node,
            "polled_delivered": heard.delivered,
            "polled_j": heard.spent_j,
        }


def listen(
    world: World,
    state: State,
    request: Request,
    split: Split,
    hears: Array | None,
    available_j: Array,
) -> Heard:
    """What the hearing part makes of a slot; arguments as of `Polled.from_slot`."""
    listens = request.cell == request.cell if hears is None else hears
    call = Call(state.age, state.node_cell, available_j, request, split, listens)
    return world.hearing(call, world.access, world.storage)


def _judged(
    world: World, state: State, request: Request, heard: Heard, conditions: Conditions | None
) -> tuple[Judged, ...]:
    """See `Polled.judged`."""
    reception = world.reception
    if reception is None or conditions is None or not reception.loses:
        return ()
    found = []
    for i in range(world.hearing.rounds(world.num_nodes)):
        node, arrives = heard.node[..., i], heard.delivered[..., i]
        sent = node < world.num_nodes
        node_cell = world.nodes.gather(state.node_cell, world.nodes.flat_index(node))
        offset = world.link.offset(request.cell, node_cell)
        found.append(reception.judge(conditions, node, offset, sent, arrives, 1 + i))
    return tuple(found)
