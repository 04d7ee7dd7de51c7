"""The game of a scenario for checks: in whole numbers, and by other means than the search's.

Energies are whole numbers of a tiny unit: harvests rounded up, prices of uplinks down, so
that no rounding can make a check too strict for the world. Nothing is shared with the search
but the world's own table of links and the ladder of levels, for which any ladder would do.
"""

from __future__ import annotations

from bisect import bisect_left
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from iout_marl.scenario import Scenario, Tdd
from iout_marl.world import World, node_codes

Integers = npt.NDArray[np.int64]

#: Parts of a joule in which the check counts.
UNITS_PER_J = 2**40
#: No level, harvest or affordable uplink comes near to this many joules.
BEYOND_J = 1e100
#: What the world's floating-point sums may add in a slot, as a share of the energies.
ROUNDING = Fraction(1, 10**11)


class Game(NamedTuple):
    """What can be done in a slot; levels count from 0, the last is without limit.

    Tables are (cells, levels) levels after; the number of levels stands for what cannot be.
    """

    neighbours: Integers  # (cells, directions) the cell that each direction leads to
    start: int  # the cell in which the AUV starts
    # Of every node, in FDD: the tables for charging, delivering, both; in TDD: those for
    # naming it in vain and for naming it so that it delivers.
    tables: list[list[Integers]]
    distance_m: npt.NDArray[np.float64]  # (nodes, cells)


def finite_game(scenario: Scenario, levels_j: tuple[float, ...]) -> Game:
    """The game of a scenario of one AUV and fixed nodes.

    Args:
        scenario: the scenario.
        levels_j: (levels − 1,) ladder of stored energies in J, without the last.
    """
    world = World(scenario)
    codes = world.grid.encode(world.grid.all_coordinates()).tolist()
    index = {code: i for i, code in enumerate(codes)}
    targets = np.asarray(world.motion.neighbours(np.array(codes)[:, None]))[:, 0]
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
    levels = [_units(level) for level in levels_j]
    make = _time_division if isinstance(scenario.duplex, Tdd) else _frequency_division
    tolerance = _tolerance(world, levels)
    tables, distances = [], []
    known: dict[int, list[list[int]]] = {}
    for node_code in state.node_cell[0].tolist():
        offsets = [int(world.link.offset(code, node_code)) for code in codes]
        for offset in offsets:
            if offset not in known:
                known[offset] = make(world, offset, levels, tolerance)
        rows = zip(*(known[offset] for offset in offsets), strict=True)
        tables.append([np.array(table) for table in rows])
        distances.append(world.link.distance_m[offsets])
    return Game(
        neighbours=np.array([[index[code] for code in row] for row in targets.tolist()]),
        start=index[int(state.cell[0, 0])],
        tables=tables,
        distance_m=np.array(distances),
    )


def _units(energy_j: float) -> int:
    """Whole units, rounded down; what is beyond all measure ends at a measure."""
    return int(Fraction(max(min(energy_j, BEYOND_J), -BEYOND_J)) * UNITS_PER_J // 1)


def _tolerance(world: World, levels: list[int]) -> int:
    largest = _units(float(world.link.harvested_w.max()) * world.link.slot_s)
    return int(world.num_slots * ROUNDING * (levels[-1] + largest)) + 1


def _frequency_division(
    world: World, offset: int, levels: list[int], tolerance: int
) -> list[list[int]]:
    """Levels after charging, after delivering, and after both."""
    harvest = _units(float(world.link.harvested_w[offset]) * world.link.slot_s) + 1
    price = _units(float(world.link.slot_uplink_j[offset]))
    infinite = len(levels)

    def paid(energy: int) -> int:
        return bisect_left(levels, energy - price) if energy + tolerance > price else infinite + 1

    return [
        [*(bisect_left(levels, level + harvest) for level in levels), infinite],
        [*(paid(level) for level in levels), infinite],
        [*(paid(level + harvest) for level in levels), infinite],
    ]


def _time_division(world: World, offset: int, levels: list[int], tolerance: int) -> list[list[int]]:
    """Levels after naming the node in vain, and after it has delivered."""
    scenario, link = world.scenario, world.link
    duplex = scenario.duplex
    assert isinstance(duplex, Tdd)
    harvested_w, cost_w = float(link.harvested_w[offset]), float(link.power_per_snr_w[offset])

    def gain_j(beta: float) -> float:
        required = link.channel.required_energy_j(cost_w, (1 - beta) * link.slot_s)
        return beta * link.slot_s * harvested_w - float(required)

    low, high = duplex.beta_min, duplex.beta_max
    peak = minimize_scalar(lambda b: -gain_j(b), bounds=(low, high), method="bounded")
    most_j = max(-float(peak.fun), gain_j(low), gain_j(high))
    harvest, price = (
        _units(harvested_w * link.slot_s) + 1,
        _units(float(link.slot_uplink_j[offset])),
    )
    least, most = _units(gain_j(low)), _units(most_j) + tolerance
    # The paper's rule has a root where the gain rises through 0, whatever is stored.
    may_have_root = duplex.beta_rule == "paper" and least <= tolerance and most >= 0
    has_root = may_have_root and least < -tolerance and most > 3 * tolerance
    deliver, charge = [], []
    for i, level in enumerate([*levels, None]):
        below = levels[i - 1] if i else 0
        left: list[int] = []
        if level is None:
            deliver.append(len(levels))
        else:
            if level + tolerance > price:
                left.append(level - price)
            if may_have_root:
                left.append(level)
            if duplex.beta_rule == "stored" and level + most + tolerance >= 0:
                left.append(max(min(level, price) + least, 0))
            deliver.append(bisect_left(levels, max(left)) if left else -1)
        can_fail = below - tolerance <= price and not (
            has_root or (duplex.beta_rule == "stored" and below + most > 3 * tolerance)
        )
        top = len(levels) if level is None else bisect_left(levels, level + harvest)
        charge.append(top if can_fail else -1)
    # A node may throw energy away, which makes more of it never worse.
    return [_best_so_far(charge, len(levels) + 1), _best_so_far(deliver, len(levels) + 1)]


def _best_so_far(table: list[int], nothing: int) -> list[int]:
    best = np.maximum.accumulate(np.array(table))
    return np.where(best < 0, nothing, best).tolist()
