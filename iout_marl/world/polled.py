"""What polling further nodes comes to, node by node."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from iout_marl.core.split import Split
from iout_marl.core.state import State
from iout_marl.parts import Call, Heard, Request
from iout_marl.physics.arrays import Array, cast

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
    """

    heard: Heard
    to_auvs: Array
    delivers: Array
    spent_j: Array
    reset_to: Array
    packets: Array

    @classmethod
    def from_slot(
        cls,
        world: World,
        state: State,
        request: Request,
        split: Split,
        hears: Array | None,
        available_j: Array,
    ) -> Polled:
        """Have the AUVs of a world whose hearing part polls hear.

        Args:
            world: the world.
            state: the state before the slot.
            request, split, hears: of the nodes chosen, as in `World.step`.
            available_j: (envs, nodes) energies when the uplinks begin.
        """
        heard = listen(world, state, request, split, hears, available_j)
        backend, nodes = world.backend, world.nodes
        xp = backend.xp
        to_auvs, spent_j = None, backend.zeros(available_j.shape)
        reset_to = backend.zeros(available_j.shape)
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
                own = cast(xp, delivered, age.dtype) * age
                reset_to = nodes.scatter_add(reset_to, place, own)
        sent = cast(xp, heard.node < world.num_nodes, available_j.dtype)
        return cls(
            heard=heard,
            to_auvs=to_auvs,
            delivers=backend.with_envs_inside(xp.any(to_auvs, axis=1)),
            spent_j=spent_j,
            reset_to=reset_to,
            packets=xp.sum(xp.sum(sent, axis=2), axis=1, keepdims=True),
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
