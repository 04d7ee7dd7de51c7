"""What polling further nodes comes to, node by node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from iout_marl.core.split import Split
from iout_marl.core.state import State
from iout_marl.parts import Call, Heard, Request
from iout_marl.physics.arrays import Array, add_up, cast
from iout_marl.world.reception import Judged, Received

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
        reset_to: (envs, nodes) slots: its age if it has delivered, less the slot by which all
            grow; None for 0.
        packets: (envs, 1) float: how many were sent.
        share: (envs, nodes) float: with which share it is expected to have delivered to any; None
            where that is drawn.
        delivered: (envs, auvs, rounds) bool: which of the packets polled have arrived.
    """

    heard: Heard
    to_auvs: Array
    delivers: Array
    spent_j: Array
    reset_to: Array | None
    packets: Array
    delivered: Array
    share: Array | None = None

    @classmethod
    def from_slot(
        cls, world: World, heard: Heard, available_j: Array, received: Received | None
    ) -> Polled:
        """What it comes to that nodes are polled.

        Args:
            world: the world, whose hearing part polls.
            heard: what that says of the slot.
            available_j: (envs, nodes) energies when the uplinks begin.
            received: what became of all packets, where any may get lost. An AUV has gone on to
                the next node as if nothing had.
        """
        xp, nodes = world.backend.xp, world.nodes
        place, delivered, came, share = nodes.flat_index(heard.node), heard.delivered, None, None
        if received is not None:
            judged = Judged(*(each if each is None else each[..., 1:] for each in received.judged))
            # Of what is expected, the age is that of a packet that arrives.
            delivered, came = judged.delivered, judged.delivered | judged.lost
            if judged.share is not None:
                share = nodes.total(place, judged.share)
        # As of the nodes chosen, rounding may ask for more than there is.
        taken_j = xp.minimum(heard.spent_j, nodes.gather(available_j, place))
        reset_to = None
        if world.sampling.is_continuous:
            age = world.sampling.reset_to_s(heard.age_s)
            came = delivered if came is None else came
            reset_to = nodes.total(place, cast(xp, came, age.dtype) * age)
        if world.num_auvs == 1:
            delivers = nodes.total(place, cast(xp, delivered, taken_j.dtype)) > 0
            to_auvs = delivers[:, None, :]
        else:
            to_auvs = nodes.flags(place[..., 0], delivered[..., 0])
            for i in range(1, heard.node.shape[2]):
                to_auvs = to_auvs | nodes.flags(place[..., i], delivered[..., i])
            delivers = world.backend.with_envs_inside(xp.any(to_auvs, axis=1))
        sent = cast(xp, heard.node < world.num_nodes, taken_j.dtype)
        return cls(
            heard=heard,
            to_auvs=to_auvs,
            delivers=delivers,
            spent_j=nodes.total(place, taken_j),
            reset_to=reset_to,
            packets=add_up(xp, add_up(xp, sent, 2), 1)[:, None],
            delivered=delivered,
            share=share,
        )

    @property
    def events(self) -> dict[str, Array]:
        """Fields of the slot's events."""
        heard = self.heard
        return {
            "polled": heard.node,
            "polled_delivered": self.delivered,
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
