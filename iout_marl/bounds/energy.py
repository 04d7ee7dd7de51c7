"""Stored energy on a ladder of levels, rounded so that a node is never poorer than in the world.

A state of a node's energy is an index into a ladder of energies in J; it stands for any
stored energy up to that level. The last level is without limit. Whatever a slot does to the
energy leads to the lowest level that is not below what the world would come to. A node may
also throw energy away: so more energy is never worse, in TDD too, where the rules for β would
at times serve a poorer node better.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl import physics
from iout_marl.scenario import Scenario, Tdd
from iout_marl.world import World, node_codes
from iout_marl.world.duplex import TimeDivision

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]


class Ladder(NamedTuple):
    """A ladder of levels in shares of the largest harvest of a slot."""

    step: float  # lowest levels: multiples of this,
    num_steps: int  # so many of them;
    wider_by: float  # from there each is the one below times this,
    top: float  # up to here; the last is without limit


#: Few levels, for bounds that list states of all nodes together.
COARSE = Ladder(step=0.024, num_steps=15, wider_by=1.12, top=1.8)
#: Many, for bounds that take the nodes one by one.
FINE = Ladder(step=0.012, num_steps=30, wider_by=1.08, top=3.0)
#: The fewest, to find one's way.
ROUGH = Ladder(step=0.05, num_steps=7, wider_by=1.25, top=1.8)
#: No level or affordable uplink comes near to this many joules.
BEYOND_J = 1e100
#: Ladders are made for no smaller harvest: their levels would be one and the same.
LEAST_J = 1e-200
#: Error allowed per slot for the world's floating-point sums, as a share of the energies.
ROUNDING = 1e-11


class Tables(NamedTuple):
    """Where a slot takes the level of a node, (nodes, cells, levels) each.

    Entries are levels; the number of levels stands for what cannot be. `both` is charging
    and delivery in one slot; in TDD it is not there: there `deliver` and `charge` are the two
    outcomes of naming the node.
    """

    charge: Integers
    deliver: Integers
    both: Integers | None


def ladder_j(ladder: Ladder, largest_harvest_j: float) -> Floats:
    """(levels,) energies in J, from 0 to infinity."""
    # Any ladder will do where nothing, or all but nothing, can be harvested.
    unit_j = max(largest_harvest_j, LEAST_J)
    levels = [i * ladder.step * unit_j for i in range(ladder.num_steps + 1)]
    while levels[-1] < ladder.top * unit_j:
        levels.append(levels[-1] * ladder.wider_by)
    return np.array([*levels, np.inf])


def make_tables(scenario: Scenario, levels_j: Floats, tolerance_j: float) -> Tables:
    """The tables of a scenario of one AUV and fixed nodes.

    Args:
        scenario: the scenario.
        levels_j: the ladder, by `ladder_j`.
        tolerance_j: by how much the world's energies may exceed a level, see `tolerance_j`.
    """
    world = World(scenario)
    link = world.link
    cells = world.grid.encode(world.grid.all_coordinates())
    nodes = node_codes(scenario, world.grid, [np.random.default_rng(0)])[0]
    offset = link.offset(cells[None, :], nodes[:, None])[..., None]
    harvested_w = link.at(link.harvested_w, offset)
    harvest_j = harvested_w * link.slot_s
    uplink_j = np.minimum(link.at(link.slot_uplink_j, offset), BEYOND_J)
    if isinstance(scenario.duplex, Tdd):
        power_per_snr_w = link.at(link.power_per_snr_w, offset)
        rule = _stored_rule if scenario.duplex.beta_rule == "stored" else _paper_rule
        return rule(world, harvested_w, power_per_snr_w, uplink_j, levels_j, tolerance_j)
    charged_j = levels_j + harvest_j
    return Tables(
        charge=_level(levels_j, charged_j),
        deliver=_paid(levels_j, levels_j, uplink_j, tolerance_j),
        both=_paid(levels_j, charged_j, uplink_j, tolerance_j),
    )


def tolerance_j(scenario: Scenario, levels_j: Floats, largest_harvest_j: float) -> float:
    """What floating-point sums of a whole episode may add to an energy, in J; more than enough.

    A slot rounds a handful of times, each by a share of 2⁻⁵³ of energies of this size.
    """
    return scenario.num_slots * ROUNDING * (float(levels_j[-2]) + largest_harvest_j)


def _level(levels_j: Floats, energy_j: Floats) -> Integers:
    """The lowest level that is not below."""
    return np.searchsorted(levels_j, energy_j).astype(np.int64)


def _paid(levels_j: Floats, energy_j: Floats, price_j: Floats, tolerance_j: float) -> Integers:
    """The level after a payment; the number of levels where the energy cannot pay."""
    pays = energy_j + tolerance_j > price_j
    left_j = np.maximum(energy_j - price_j, 0.0)
    return np.where(pays, _level(levels_j, left_j), len(levels_j))


def _stored_rule(
    world: World,
    harvested_w: Floats,
    power_per_snr_w: Floats,
    uplink_j: Floats,
    levels_j: Floats,
    tolerance_j: float,
) -> Tables:
    """TDD with the smallest β that pays.

    Of the energies up to a level some send without charging, some charge for β_min, some
    for just what they need, which leaves nothing, and some can but charge. A node leaves off
    with the most that any of them could.
    """
    duplex = world.scenario.duplex
    assert isinstance(duplex, Tdd)
    harvest_j = harvested_w * world.link.slot_s
    finite_j = np.where(np.isinf(levels_j), np.finfo(np.float64).max / 4, levels_j)
    pays = ~np.isnan(_smallest_beta(world, finite_j + tolerance_j, harvested_w, power_per_snr_w))
    sends_j = levels_j + tolerance_j > uplink_j
    # Charging for β_min comes first only while the store alone does not pay.
    poor_j = np.minimum(levels_j, uplink_j)
    least_s = (1 - duplex.beta_min) * world.link.slot_s
    least_j = world.link.budget.required_energy_j(power_per_snr_w, least_s)
    surplus_j = poor_j + duplex.beta_min * harvest_j - least_j
    left_j = np.maximum(np.where(sends_j, levels_j - uplink_j, 0.0), np.maximum(surplus_j, 0.0))
    deliver = np.where(pays | sends_j, _level(levels_j, left_j), -1)
    # A level holds an energy that cannot deliver if the level below it, or 0, cannot.
    below_j = np.maximum(np.concatenate([[0.0], levels_j[:-1]]) - tolerance_j, 0.0)
    below_pays = ~np.isnan(_smallest_beta(world, below_j, harvested_w, power_per_snr_w))
    can_fail = ~below_pays & (below_j <= uplink_j)
    charge = np.where(can_fail, _level(levels_j, levels_j + harvest_j), -1)
    return _with_disposal(deliver, charge)


def _smallest_beta(
    world: World, stored_j: Floats, harvested_w: Floats, power_per_snr_w: Floats
) -> Floats:
    assert isinstance(world.duplex, TimeDivision)
    return np.asarray(
        physics.smallest_beta(stored_j, harvested_w, power_per_snr_w, *world.duplex.interval)
    )


def _paper_rule(
    world: World,
    harvested_w: Floats,
    power_per_snr_w: Floats,
    uplink_j: Floats,
    levels_j: Floats,
    tolerance_j: float,
) -> Tables:
    """TDD with β*: where there is a root, a slot brings what its uplink takes."""
    assert isinstance(world.duplex, TimeDivision)
    beta = physics.beta_star(harvested_w, power_per_snr_w, *world.duplex.interval)
    harvest_j = harvested_w * world.link.slot_s
    has_root = np.broadcast_to(~np.isnan(beta), (*beta.shape[:-1], len(levels_j)))
    stays = np.broadcast_to(np.arange(len(levels_j)), has_root.shape)
    paid = _paid(levels_j, levels_j, uplink_j, tolerance_j)
    deliver = np.where(has_root, stays, np.where(paid < len(levels_j), paid, -1))
    below_j = np.maximum(np.concatenate([[0.0], levels_j[:-1]]) - tolerance_j, 0.0)
    can_fail = ~has_root & (below_j <= uplink_j)
    charge = np.where(can_fail, _level(levels_j, levels_j + harvest_j), -1)
    return _with_disposal(deliver, charge)


def _with_disposal(deliver: Integers, charge: Integers) -> Tables:
    """The best that a node at a level, or at any below it, comes to; −1 stands for nothing."""
    num_levels = deliver.shape[-1]
    best = [np.maximum.accumulate(table, axis=-1) for table in (charge, deliver)]
    charge, deliver = (np.where(table < 0, num_levels, table) for table in best)
    return Tables(charge=charge, deliver=deliver, both=None)
