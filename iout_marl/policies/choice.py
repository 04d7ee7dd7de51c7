"""Whom AUVs charge and hear from where they are: the oldest data that can be had now."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.limits import UPLINK_W
from iout_marl.world import State, World

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
#: Taken off the worth of what is of no use: beyond any age.
_BETTER_NOT = 1e9
#: Stands for no harvest at all where it divides.
_LEAST_J = 1e-250
#: Stands for never, whose powers are numbers still.
_NEVER_SLOTS = 1e60


class Links(NamedTuple):
    """What each AUV could do with each node in a slot, (envs, auvs, nodes) each."""

    offset: Integers  # see `Link`
    harvested_j: Floats  # energy that the node harvests in a slot of nothing but charging
    required_j: Floats  # energy of an uplink over the whole slot, alone in the band
    missing_slots: Floats  # slots of charging from here until the node can pay that


def links(world: World, cell: Integers, state: State) -> Links:
    """The links from the (envs, auvs) cells to the nodes, with the energy that they have."""
    link = world.link
    offset = link.offset(cell[:, :, None], state.node_cell[:, None, :])
    harvested_j = link.at(link.harvested_w, offset) * link.slot_s
    required_j = link.at(link.slot_uplink_j, offset)
    missing_j = np.maximum(required_j - state.energy_j[:, None, :], 0)
    missing_slots = np.minimum(missing_j / np.maximum(harvested_j, _LEAST_J), _NEVER_SLOTS)
    if world.storage.is_limited:
        # More than a store holds it never has, however long it is charged.
        too_dear = np.asarray(world.storage.filled(required_j)) < required_j
        missing_slots = np.where(too_dear, float(world.num_slots), missing_slots)
    return Links(offset, harvested_j, required_j, missing_slots)


def near_uplink_j(world: World) -> float:
    """The energy of an uplink from the farthest next cell: what makes a store much or little."""
    return max(world.link.reference_uplink_j(max(world.scenario.grid.edges_m)), UPLINK_W[0])


def greedy_action(
    world: World, state: State, cell: Integers, urgency_exponents: tuple[float, ...]
) -> Integers:
    """The nodes that the AUVs name once they are in `cell`.

    AUVs choose in turn, the one with the most to gain first, and no two the same node
    while there are others. In FDD they hear the oldest nodes that can pay, and charge
    where stores grow most in proportion. In TDD a node is worth its age, divided by
    (the slots until it has paid)^haste. No AUV is left without a node, even where it may be
    (`auvs.idle_choices`), but one: in FDD an AUV that can run out of energy charges nobody where
    a slot's charging brings less than an uplink from there takes.

    Args:
        world: the world: its rules. `state` may be of another number of environments.
        state: the state before the slot.
        cell: (envs, auvs) codes of the cells that the AUVs will be in.
        urgency_exponents: exponents, from 0; FDD makes no difference between them.

    Returns:
        (urgency_exponents, envs, auvs, 1 or 2): the entries of an action after the direction.
    """
    here = links(world, cell, state)
    if world.duplex.num_choices == 1:
        return _choose_one(world, state, cell, here, urgency_exponents)[..., None]
    return np.stack([np.stack(_choose_two(world, state, here), axis=-1)] * len(urgency_exponents))


def _choose_two(world: World, state: State, here: Links) -> tuple[Integers, Integers]:
    """FDD: the node to charge and the node to hear, (envs, auvs) each."""
    envs, auvs, _ = here.offset.shape
    near_j, stored_j = near_uplink_j(world), state.energy_j[:, None, :]
    can_pay = world.storage.filled(stored_j + here.harvested_j) > here.required_j
    # Ages are whole: the second term but decides between equals, for the cheaper uplink.
    cheap = 1 / (2 + here.required_j / near_j)
    worth = np.where(can_pay, state.age[:, None, :] + cheap, -np.inf)

    energy_j = state.energy_j.copy()
    charged, heard = np.full((envs, auvs), -1), np.zeros((envs, auvs), dtype=np.int64)
    exclusive = world.access.max_uplinks_per_slot(auvs) == 1 < auvs
    for _ in range(1 if exclusive else auvs):
        env, auv, node = _best(worth)
        # Where one uplink may arrive all hear the one node: it sends once, to the nearest AUV.
        heard[env, slice(None) if exclusive else auv] = node[:, None] if exclusive else node
        needs_charge = here.missing_slots[env, auv, node] > 0
        charged[env[needs_charge], auv[needs_charge]] = node[needs_charge]
        gain_j = np.where(needs_charge, here.harvested_j[env, auv, node], 0)
        energy_j[env, node] += gain_j - here.required_j[env, auv, node]
        worth[env, auv] = -np.inf
        worth[env, :, node] = -np.inf

    every = np.arange(envs)
    for charger in range(auvs):
        harvested_j = here.harvested_j[:, charger]
        accepted_j = world.storage.accepted_j(energy_j, harvested_j)
        growth = accepted_j / (np.maximum(energy_j, 0) + near_j)
        decided = charged[:, charger] >= 0
        chosen = np.where(decided, charged[:, charger], growth.argmax(-1))
        energy_j[every, chosen] += np.where(decided, 0, harvested_j[every, chosen])
        charged[:, charger] = chosen
        if world.vehicle.is_limited and world.scenario.auvs.idle_choices:
            pays = accepted_j[every, chosen] >= here.required_j[every, charger, chosen]
            charged[:, charger] = np.where(pays, chosen, world.num_nodes)
    return charged, heard


def _choose_one(
    world: World, state: State, cell: Integers, here: Links, urgency_exponents: tuple[float, ...]
) -> Integers:
    """TDD: the node to charge and hear, (urgency_exponents, envs, auvs)."""
    stored_j = np.broadcast_to(state.energy_j[:, None, :], here.offset.shape)
    split = world.duplex.split(here.offset, here.offset, stored_j)
    beta = np.asarray(split.beta)
    if world.storage.is_limited:
        harvested_j = world.link.at(world.link.harvested_w, here.offset) * split.charging_s
        come_j = stored_j + harvested_j
        available_j = world.storage.filled(come_j)
        sends = world.storage.permits(beta < 1, split.required_j, come_j, available_j)
        beta = np.where(sends, beta, 1.0)
    slots = 1 + np.where(beta < 1, 0, here.missing_slots)
    if world.num_auvs > 1 and world.access.charging_disturbs:
        too_weak = (beta == 0) & (stored_j < here.required_j * _noise(world, cell)[..., None])
        slots = np.where(too_weak, 2, slots)

    named = np.zeros((len(urgency_exponents), *cell.shape), dtype=np.int64)
    for row, haste in zip(named, urgency_exponents, strict=True):
        worth = state.age[:, None, :] / slots**haste
        for _ in range(world.num_auvs):
            env, auv, node = _best(worth)
            row[env, auv] = node
            worth[env, auv] = -np.inf
            # Better not: below anything that is of use, but an AUV must name a node.
            worth[env, :, node] -= _BETTER_NOT
            if world.num_auvs > 1:
                first = beta[env, auv, node][:, None, None]
                spoilt = world.access.spoils(first, beta[env])
                worth[env] -= 0 if spoilt is None else np.where(spoilt, _BETTER_NOT, 0)
    return named


def _noise(world: World, cell: Integers) -> Floats:
    """The factor on an uplink's energy if all other AUVs charge meanwhile, (envs, auvs)."""
    link = world.link
    between = link.offset(cell[:, :, None], cell[:, None, :])
    louder = link.budget.charging_disturbance_w / link.at(link.power_per_snr_w, between)
    noise: Floats = 1 + (louder * (1 - np.eye(cell.shape[1]))).sum(-1)
    return noise


def _best(worth: Floats) -> tuple[Integers, Integers, Integers]:
    """Environment, AUV and node of the highest worth, of all environments that have any."""
    flat = worth.reshape(len(worth), -1)
    best = flat.argmax(-1)
    env = np.flatnonzero(flat[np.arange(len(flat)), best] > -np.inf)
    auv, node = np.divmod(best[env], worth.shape[-1])
    return env, auv, node
