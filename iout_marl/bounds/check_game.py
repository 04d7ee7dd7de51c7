"""The game of a scenario for checks: in whole numbers, and by other means than the search's.

Energies are whole numbers of a tiny unit: harvests rounded up, prices of uplinks down, so
that no rounding can make a check too strict for the world. They are Python's, which do not
overflow. Nothing is shared with the search but the world's own table of links and the ladder of
levels, for which any ladder would do.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.scenario import RandomNodes, Scenario, Tdd
from iout_marl.world import World, node_codes

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: The largest harvest of a slot is at least 2 to this many units.
HARVEST_BITS = 60
#: In units, more than any double-precision number of joules is.
BEYOND = 2**2200
#: What the world's floating-point sums may add in a slot, as a share of the energies; as much
#: again is left out where an energy is all but at a level.
ROUNDING = Fraction(1, 10**11)
#: What a certificate with levels is refused with where physics overflows.
NOT_COUNTED = "certificate: levels_j: the scenario's energies are no numbers that can be counted"
#: Steps in the search for the best β, each of which leaves 0.62 of an interval: to the last digit.
GOLDEN_STEPS, GOLDEN_RATIO = 90, (math.sqrt(5) - 1) / 2
#: Entries of all tables, 8 bytes each; levels worked out, of different distances to a node.
MOST_ENTRIES, MOST_OUTCOMES = 2**25, 2**20


class Game(NamedTuple):
    """What can be done in a slot; levels count from 0, the last is without limit.

    Tables are (cells, levels) levels after; the number of levels stands for what cannot be.
    """

    neighbours: Integers  # (cells, directions) the cell that each direction leads to
    start: int  # the cell in which the AUV starts
    # Of every node, in FDD: the tables for charging, delivering, both; in TDD: those for
    # naming it in vain and for naming it so that it delivers.
    tables: list[list[Integers]]
    distance_m: Floats  # (nodes, cells)


def is_covered(scenario: Scenario) -> bool:
    """Whether the bounds by energy and travel hold: one AUV, nodes that stay where they are."""
    return scenario.num_auvs == 1 and not isinstance(scenario.nodes, RandomNodes)


def finite_game(scenario: Scenario, levels_j: tuple[float, ...]) -> Game:
    """The game of a scenario of one AUV and fixed nodes.

    Args:
        scenario: the scenario, which `is_covered`.
        levels_j: (levels − 1,) ladder of stored energies in J, without the last: numbers from 0
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
    num_levels, num_tables = len(levels_j) + 1, 2 if isinstance(scenario.duplex, Tdd) else 3
    if place.size * num_levels * num_tables > MOST_ENTRIES or (
        len(offsets) * num_levels > MOST_OUTCOMES
    ):
        raise InputError(
            f"certificate: levels_j: {num_levels - 1} are too many for the check of "
            f"{scenario.num_nodes} nodes and {len(codes):,} cells"
        )
    by_offset = _tables(world, offsets, levels_j)
    return Game(
        neighbours=index[np.asarray(world.motion.neighbours(codes[:, None]))[:, 0]],
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
        raise InputError(
            "certificate: the scenario's energies are no numbers that could be counted"
        )
    ladder = _Ladder.of(levels_j, largest_j, world.num_slots)
    if isinstance(world.scenario.duplex, Tdd):
        rows = _time_division(world, offsets, ladder)
    else:
        pairs = zip(harvest_j.tolist(), price_j.tolist(), strict=True)
        rows = [_frequency_division(ladder, *pair) for pair in pairs]
    return [np.array(table, dtype=np.int64) for table in zip(*rows, strict=True)]


class _Ladder(NamedTuple):
    """The ladder of levels in whole units."""

    units_per_j: Fraction  # a power of two
    levels: list[int]  # without the last
    slack: int  # what is left out in a slot
    tolerance: int  # by how much a node may be richer than its level by the end of an episode

    @classmethod
    def of(cls, levels_j: tuple[float, ...], largest_j: float, num_slots: int) -> _Ladder:
        """The ladder, and a unit so small that rounding to it is far below the tolerance.

        A node on a level, not the last, has never had more than that and a harvest.
        """
        units_per_j = Fraction(2) ** (HARVEST_BITS - math.frexp(largest_j)[1] + 1)
        ladder = cls(units_per_j, [], 0, 0)
        levels = [ladder.down(level) for level in levels_j]
        most = levels[-1] + ladder.up(largest_j)
        slack = int(ROUNDING * most) + 1
        return cls(units_per_j, levels, slack, 2 * num_slots * slack)

    def down(self, energy_j: float) -> int:
        """Whole units, rounded down; what is infinite ends at more than any number."""
        if math.isinf(energy_j):
            return BEYOND if energy_j > 0 else -BEYOND
        return math.floor(Fraction(energy_j) * self.units_per_j)

    def up(self, energy_j: float) -> int:
        """Whole units, rounded up."""
        return -self.down(-energy_j)

    def at_least(self, energy: int) -> int:
        """The lowest level that is not below, or by no more than the slack."""
        return bisect_left(self.levels, energy - self.slack)


def _frequency_division(ladder: _Ladder, harvest_j: float, price_j: float) -> list[list[int]]:
    """Levels after charging, after delivering, and after both."""
    harvest, price = ladder.up(harvest_j), ladder.down(price_j)
    infinite = len(ladder.levels)

    def paid(energy: int) -> int:
        pays = energy + ladder.tolerance > price
        return ladder.at_least(energy - price) if pays else infinite + 1

    return [
        [*(ladder.at_least(level + harvest) for level in ladder.levels), infinite],
        [*(paid(level) for level in ladder.levels), infinite],
        [*(paid(level + harvest) for level in ladder.levels), infinite],
    ]


def _time_division(world: World, offsets: Integers, ladder: _Ladder) -> list[list[list[int]]]:
    """Levels after naming the node in vain, and after it has delivered."""
    link, duplex = world.link, world.scenario.duplex
    assert isinstance(duplex, Tdd)
    harvested_w, cost_w = link.harvested_w[offsets], link.power_per_snr_w[offsets]

    def gain_j(beta: Floats) -> Floats:
        required_j = link.budget.required_energy_j(cost_w, (1 - beta) * link.slot_s)
        return np.asarray(beta * link.slot_s * harvested_w - required_j)

    low, high = (np.full(len(offsets), beta) for beta in (duplex.beta_min, duplex.beta_max))
    # What overflows is an uplink that nothing pays.
    with np.errstate(over="ignore", invalid="ignore"):
        least_j, most_j = gain_j(low), _highest(gain_j, low, high)
    if np.isnan(least_j).any() or np.isnan(most_j).any():
        raise InputError(
            "certificate: the scenario's energies are no numbers that could be counted"
        )
    energies_j = (harvested_w * link.slot_s, link.slot_uplink_j[offsets], least_j, most_j)
    rule = _stored_rule if duplex.beta_rule == "stored" else _paper_rule
    return [
        rule(ladder, *row)
        for row in zip(*(energy_j.tolist() for energy_j in energies_j), strict=True)
    ]


def _highest(function: Callable[[Floats], Floats], low: Floats, high: Floats) -> Floats:
    """The highest values of concave functions, one for each entry, by golden sections."""
    best = np.maximum(function(low), function(high))
    for _ in range(GOLDEN_STEPS):
        width = GOLDEN_RATIO * (high - low)
        left, right = function(high - width), function(low + width)
        best = np.maximum(best, np.maximum(left, right))
        rises = left < right
        low, high = np.where(rises, high - width, low), np.where(rises, high, low + width)
    return best


def _paper_rule(
    ladder: _Ladder, harvest_j: float, price_j: float, least_j: float, most_j: float
) -> list[list[int]]:
    """With β*: the root where the gain rises through 0, whatever is stored.

    Args:
        ladder: the levels.
        harvest_j, price_j: what a whole slot brings, and what an uplink of a whole slot takes.
        least_j, most_j: what the node gains from charging and uplink together at β_min, and at
            the best β.
    """
    harvest, price, tolerance = ladder.up(harvest_j), ladder.down(price_j), ladder.tolerance
    least, most = ladder.up(least_j), ladder.up(most_j)
    may_have_root = least <= tolerance and most >= -tolerance
    has_root = may_have_root and least < -tolerance and most > 2 * tolerance
    deliver, charge = [], []
    for below, level in _rungs(ladder):
        left = [level] if may_have_root else []
        if level + tolerance > price:
            left.append(level - price)
        deliver.append(ladder.at_least(max(left)) if left else -1)
        can_fail = not has_root and below - tolerance <= price
        charge.append(ladder.at_least(level + harvest) if can_fail else -1)
    return [_best_so_far(ladder, charge), _best_so_far(ladder, deliver)]


def _stored_rule(
    ladder: _Ladder, harvest_j: float, price_j: float, least_j: float, most_j: float
) -> list[list[int]]:
    """With the smallest β that pays; args as for `_paper_rule`."""
    harvest, price, tolerance = ladder.up(harvest_j), ladder.down(price_j), ladder.tolerance
    least, most = ladder.up(least_j), ladder.up(most_j)
    # Only a node whose store alone does not pay charges for β_min first.
    poorest = ladder.up(price_j)
    deliver, charge = [], []
    for below, level in _rungs(ladder):
        left = [level - price] if level + tolerance > price else []
        if level + most + 2 * tolerance >= 0:
            left.append(max(min(level, poorest) + least, 0))
        deliver.append(ladder.at_least(max(left)) if left else -1)
        can_fail = below - tolerance <= price and below + most <= 2 * tolerance
        charge.append(ladder.at_least(level + harvest) if can_fail else -1)
    return [_best_so_far(ladder, charge), _best_so_far(ladder, deliver)]


def _rungs(ladder: _Ladder) -> list[tuple[int, int]]:
    """The energies that each level stands for: above the first, up to the second."""
    tops = [*ladder.levels, 2 * BEYOND]
    return list(zip([0, *ladder.levels], tops, strict=True))


def _best_so_far(ladder: _Ladder, table: list[int]) -> list[int]:
    """A node may throw energy away, which makes more of it never worse; −1 stands for nothing."""
    best = np.maximum.accumulate(np.array(table))
    return np.where(best < 0, len(ladder.levels) + 1, best).tolist()
