"""The game of a scenario for checks: in whole numbers, and by other means than the search's.

Energies are those of `iout_marl.core.whole_levels`. Nothing is shared with the search but the
world's own table of links and the levels of energy, for which any would do.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.whole_levels import WholeLevels
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario
from iout_marl.world import World, node_codes

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: What a certificate with levels is refused with where physics overflows.
NOT_COUNTED = "certificate: the scenario's energies are no numbers that could be counted"
#: Entries of all tables, 8 bytes each; levels worked out, of different distances to a node.
MOST_ENTRIES, MOST_OUTCOMES = 2**25, 2**20


class Game(NamedTuple):
    """What can be done in a slot; levels count from 0, the last is without limit.

    Tables are (cells, levels) levels after; the number of levels stands for what cannot be.
    """

    neighbours: Integers  # (cells, choices) where an AUV can be a slot later
    start: int  # the cell in which the AUV starts
    # Of every node, where two are named: the tables for charging, delivering, both; where one is:
    # those for naming it in vain and for naming it so that it delivers.
    tables: list[list[Integers]]
    distance_m: Floats  # (nodes, cells)


def is_covered(scenario: Scenario) -> bool:
    """Whether the bounds by energy and travel hold.

    They are for one AUV that hears the node that it names and no other, for nodes that stay where
    they are, for a duplex part that states what a slot does to levels of energy, for stores with
    which nodes can do nothing that they could not do with empty ones without limits, for vehicles
    and currents likewise, and for levels that do not rise by chance. Packets that get lost only
    remove.
    """
    is_fixed = scenario.nodes.part.redraws == "never"
    limits = [scenario.storage.part, scenario.vehicle.part, scenario.current.part]
    limits.append(scenario.channel.part.fading)
    only_removes = all(part.can_only_remove(scenario) for part in limits)
    has_tables = scenario.duplex.part.has_tables
    hears_one = not scenario.hearing.part.polls
    return bool(scenario.num_auvs == 1 and hears_one and is_fixed and has_tables and only_removes)


def finite_game(scenario: Scenario, levels_j: tuple[float, ...]) -> Game:
    """The game of a scenario of one AUV and fixed nodes.

    Args:
        scenario: the scenario, which `is_covered`.
        levels_j: (levels − 1,) stored energies in J, without the last: numbers from 0
            that rise.

    Raises:
        InputError: the tables would be too large, or the scenario's energies are no numbers.
    """
    world = World(scenario)
    codes = world.grid.encode(world.grid.all_coordinates())
    index = np.zeros(world.grid.num_codes, dtype=np.int64)
    index[codes] = np.arange(len(codes))
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
    offsets, place = np.unique(
        world.link.offset(codes[None, :], state.node_cell[0][:, None]), return_inverse=True
    )
    place = place.reshape(scenario.num_nodes, len(codes))
    num_levels, num_tables = len(levels_j) + 1, scenario.duplex.part.num_choices + 1
    if place.size * num_levels * num_tables > MOST_ENTRIES or (
        len(offsets) * num_levels > MOST_OUTCOMES
    ):
        raise InputError(
            f"certificate: levels_j: {num_levels - 1} are too many for the check of "
            f"{scenario.num_nodes} nodes and {len(codes):,} cells"
        )
    by_offset = _tables(world, offsets, levels_j)
    return Game(
        neighbours=index[np.asarray(world.motion.next_cells(codes[:, None]))[:, 0]],
        start=int(index[state.cell[0, 0]]),
        tables=[[table[row] for table in by_offset] for row in place],
        distance_m=world.link.distance_m[offsets][place],
    )


def _tables(world: World, offsets: Integers, levels_j: tuple[float, ...]) -> list[Integers]:
    """The tables, (offsets, levels) each."""
    link = world.link
    harvest_j, price_j = link.harvested_w[offsets] * link.slot_s, link.slot_uplink_j[offsets]
    largest_j = float(link.harvested_w.max()) * link.slot_s
    if not (math.isfinite(largest_j) and (harvest_j >= 0).all() and (price_j >= 0).all()):
        raise InputError(NOT_COUNTED)
    levels = WholeLevels.from_joules(levels_j, largest_j, world.num_slots)
    try:
        rows = world.duplex.check_tables(levels, offsets)
    except ArithmeticError:
        raise InputError(NOT_COUNTED) from None
    return [np.array(table, dtype=np.int64) for table in zip(*rows, strict=True)]
