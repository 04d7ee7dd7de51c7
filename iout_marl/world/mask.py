"""Which actions are of no use: they are harmless, but a policy need not try them."""

from __future__ import annotations

import numpy as np

from iout_marl.core.state import State
from iout_marl.parts import Context, Storage, Vehicle
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.world.manoeuvre import Manoeuvre
from iout_marl.world.motion import Mover


class ActionMask:
    """Marks sensible choices: staying inside, charging a node in reach, hearing one that may pay.

    Of an AUV under way, whose direction is ignored, all directions but the first are masked out;
    of others those that need more speed through the water than the vehicle has.

    Where an AUV names one node to charge and one to hear, as in FDD, the one charged is masked out
    where it would harvest nothing from any cell within one move. The one heard is masked out
    only where it could not pay from any cell within one move, even if all AUVs charged it in the
    same slot, each from where it is best done. Where it names one for both, as in TDD, every node
    may be chosen: what cannot send is charged. Nor is a node masked out that
    the AUV does not see, and AUVs that it does not see may be anywhere: of energies and of
    other AUVs the mask tells no more than the observation. Positions of nodes count as known.

    To an AUV whose battery is empty, which does nothing, staying and nobody are left, as far as
    they are choices.
    """

    def __init__(
        self,
        scenario: Scenario,
        context: Context,
        motion: Mover,
        manoeuvre: Manoeuvre,
        storage: Storage,
        vehicle: Vehicle,
    ) -> None:
        backend, link = context.backend, context.link
        self._view = context.view
        self._link = link
        self._storage = storage
        self._vehicle = vehicle
        rests = ~motion.steps.any(axis=1)
        self._rests = backend.xp.asarray(rests, device=backend.device) if rests.any() else None
        self._manoeuvre = manoeuvre
        self._xp = backend.xp
        self._num_nodes = scenario.num_nodes
        self._idle_choices = scenario.auvs.idle_choices
        self._hears_another = scenario.duplex.part.num_choices > 1
        #: (auvs, auvs): 1 for each other AUV.
        self._others = backend.floats(1 - np.eye(scenario.num_auvs))
        self._may_harvest_nothing = link.may_harvest_nothing
        self._nothing = backend.floats(0.0)
        self._sees_others = scenario.observation.part.sees_others
        best_j = link.most_harvested_w * link.slot_s
        self._others_at_best_j = backend.floats((scenario.num_auvs - 1) * best_j)

    def __call__(self, state: State) -> Array:
        """(envs, auvs, choices) bool: directions, nodes to charge, in FDD nodes to hear.

        Nobody, where it is a choice, is always a sensible one.
        """
        xp = self._xp
        inside = self._manoeuvre.sensible(state)
        shape = (*state.cell.shape, self._num_nodes)
        any_node = xp.broadcast_to(xp.ones_like(state.age, dtype=xp.bool)[:, None, :], shape)
        masks = [inside, any_node]
        if self._hears_another:
            reachable = self._manoeuvre.reachable(state)
            offset = self._link.offset(reachable[..., None], state.node_cell[:, None, None, :])
            charged_j = self._link.at(self._link.harvested_w, offset) * self._link.slot_s
            if self._may_harvest_nothing:
                masks[1] = xp.any(charged_j > self._nothing, axis=2)
            may_pay = self._may_pay(state, offset, charged_j)
            if self._view.is_limited:
                may_pay = may_pay | ~self._view.sees(state.cell, state.node_cell)
            masks.append(may_pay)
        if self._vehicle.is_limited:
            masks = self._for_stranded(state, masks)
        if self._idle_choices:
            nobody = any_node[..., :1]
            masks = [masks[0], *(xp.concat([mask, nobody], axis=-1) for mask in masks[1:])]
        # A choice needs at least one way to go.
        masks = [mask | ~xp.any(mask, axis=-1, keepdims=True) for mask in masks]
        return xp.concat(masks, axis=-1)

    def _for_stranded(self, state: State, masks: list[Array]) -> list[Array]:
        """Directions, and nodes without nobody, of what AUVs can do that may be stranded."""
        can_act = ~self._vehicle.is_stranded(state.battery_j)[..., None]
        inside, *nodes = masks
        if self._rests is not None:
            inside = inside & (can_act | self._rests)
        return [inside, *([mask & can_act for mask in nodes] if self._idle_choices else nodes)]

    def _may_pay(self, state: State, offset: Array, charged_j: Array) -> Array:
        """Which nodes might send, (envs, auvs, nodes).

        Args:
            state: the state.
            offset: how nodes lie to the cells that AUVs reach, (envs, auvs, directions, nodes).
            charged_j: what nodes harvest from there, alike.
        """
        link = self._link
        if self._sees_others:
            others_j = self._others @ self._xp.max(charged_j, axis=2)
        else:
            others_j = self._others_at_best_j
        best_j = (state.energy_j[:, None, :] + others_j)[:, :, None, :] + charged_j
        best_j = self._storage.filled(best_j)
        return self._xp.any(best_j > link.at(link.slot_uplink_j, offset), axis=2)
