"""Which actions are of no use: they are harmless, but a policy need not try them."""

from __future__ import annotations

from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.world.backend import Backend
from iout_marl.world.link import Link
from iout_marl.world.motion import Motion
from iout_marl.world.state import State


class ActionMask:
    """Marks sensible choices: staying in the grid, hearing a node that may pay.

    A node is masked out in FDD only where it could not pay from any cell within one
    move, even if it were charged in the same slot. In TDD every node may be chosen:
    what can not send is charged.
    """

    def __init__(self, scenario: Scenario, link: Link, motion: Motion, backend: Backend) -> None:
        self._link = link
        self._motion = motion
        self._xp = backend.xp
        self._num_nodes = scenario.num_nodes
        self._is_fdd = scenario.duplex.kind == "fdd"
        # Others may charge the node too, from as near as can be.
        self._others_j = (
            (scenario.num_auvs - 1) * float(link.channel.harvested_power_w(0.0)) * scenario.slot_s
        )

    def __call__(self, state: State) -> Array:
        """(envs, auvs, choices) bool: directions, nodes to charge, in FDD nodes to hear."""
        xp = self._xp
        inside = self._motion.stays_inside(state.cell)
        shape = (*state.cell.shape, self._num_nodes)
        any_node = xp.broadcast_to(xp.ones_like(state.age, dtype=xp.bool)[:, None, :], shape)
        masks = [inside, any_node]
        if self._is_fdd:
            masks.append(self._may_pay(state))
        # A choice needs at least one way to go.
        masks = [mask | ~xp.any(mask, axis=-1, keepdims=True) for mask in masks]
        return xp.concat(masks, axis=-1)

    def _may_pay(self, state: State) -> Array:
        link = self._link
        reachable = self._motion.neighbours(state.cell)
        offset = link.offset(reachable[..., None], state.node_cell[:, None, None, :])
        charged_j = link.at(link.harvested_w, offset) * link.slot_s + self._others_j
        best_j = state.energy_j[:, None, None, :] + charged_j
        return self._xp.any(best_j > link.at(link.slot_uplink_j, offset), axis=2)
