"""Bounds checked once more from the scenario alone, in whole numbers and by other means.

Ages are whole numbers anyway. Energies become whole numbers of a tiny unit: harvests rounded
up, prices of uplinks down, so that no rounding can make the check too strict for the world.
Nothing here is shared with the search but the world's own table of links and the ladder of
levels, which any ladder may stand in for.
"""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.optimize import minimize_scalar

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, Tdd
from iout_marl.world import World, node_codes

Integers = npt.NDArray[np.int64]

#: Parts of a joule in which the check counts.
UNITS_PER_J = 2**40
#: What the world's floating-point sums may add in a slot, as a share of the energies.
ROUNDING = Fraction(1, 10**11)


@dataclass(frozen=True)
class Certificate:
    """What is claimed, and what it takes to check it.

    Attributes:
        world_hash: the scenario's, without reward and training.
        age_sum: no policy's ages, summed over nodes and slots, are less than this.
        levels_j: (levels,) ladder of stored energies in J, without the last, which is
            infinite, for the opening bound; None for the scheduling bound.
    """

    world_hash: str
    age_sum: int
    levels_j: tuple[float, ...] | None = None

    def to_json(self) -> dict[str, Any]:
        """The certificate as JSON has it."""
        return {
            "kind": "scheduling" if self.levels_j is None else "opening",
            "world_hash": self.world_hash,
            "age_sum": self.age_sum,
            "levels_j": None if self.levels_j is None else list(self.levels_j),
        }


def verified_age_sum(scenario: Scenario, certificate: Certificate) -> int:
    """The claim of a certificate, once it is found to hold.

    Raises:
        InputError: the certificate is of another scenario.
        ValueError: it does not prove its claim.
    """
    if certificate.world_hash != scenario.world_hash:
        raise InputError(
            f"certificate: is of world {certificate.world_hash}, not of {scenario.world_hash}"
        )
    claimed = certificate.age_sum
    start = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    resets = 1 if scenario.channel.access == "exclusive" else scenario.num_auvs
    proven = int(_oldest_first(start, scenario.num_slots, scenario.age.maximum, resets)[0])
    if claimed > proven:
        if certificate.levels_j is None or scenario.num_auvs != 1:
            raise ValueError(f"scheduling proves no more than {proven}, not {claimed}")
        _check_opening(scenario, certificate.levels_j, claimed)
    return claimed


def _oldest_first(ages: Integers, num_slots: int, maximum: int, resets: int) -> Integers:
    """Sums of ages if the oldest are reset in every slot, played out slot by slot."""
    total = np.zeros(len(ages), dtype=np.int64)
    for slot in range(num_slots):
        ages = np.minimum(np.sort(ages, axis=1) + 1, maximum)
        ages[:, -resets:] = 1
        total += ages.sum(axis=1)
        if slot >= ages.shape[1]:
            # All nodes have been reset: from now on every row is the same.
            ages = ages[:1]
    return total


def _check_opening(scenario: Scenario, levels_j: tuple[float, ...], target: int) -> None:
    """See that every way through the first slots comes to nothing below the target."""
    num_nodes, maximum = scenario.num_nodes, scenario.age.maximum
    neighbours, start, outcomes = _tables(scenario, levels_j)
    dead = len(levels_j) + 1
    # A row: cell, levels, ages, sum of ages.
    rows = np.array([[start] + [0] * num_nodes + [scenario.age.initial] * num_nodes + [0]])
    for slot in range(scenario.num_slots):
        rows = _distinct(np.concatenate([_moved(rows, column) for column in neighbours.T]))
        after = []
        for heard, choices in outcomes.items():
            new = rows.copy()
            ages = new[:, 1 + num_nodes : -1]
            ages += 1
            if heard is not None:
                ages[:, heard] = 1
            np.minimum(ages, maximum, out=ages)
            new[:, -1] += ages.sum(axis=1)
            least = new[:, -1] + _oldest_first(
                ages, scenario.num_slots - slot - 1, maximum, resets=1
            )
            new = new[least < target]
            for tables in choices:
                chosen = new.copy()
                for node, table in tables:
                    chosen[:, 1 + node] = table[chosen[:, 0], chosen[:, 1 + node]]
                    chosen = chosen[chosen[:, 1 + node] < dead]
                after.append(chosen)
        rows = _distinct(np.concatenate(after))
        if len(rows) == 0:
            return
    raise ValueError(f"{len(rows)} ways through the episode may end below {target}")


def _moved(rows: Integers, next_cell: Integers) -> Integers:
    moved = rows.copy()
    moved[:, 0] = next_cell[rows[:, 0]]
    return moved


def _distinct(rows: Integers) -> Integers:
    packed = np.ascontiguousarray(rows.astype(np.int32))
    _, first = np.unique(packed.view(f"V{packed.itemsize * rows.shape[1]}"), return_index=True)
    return rows[first]


Table = npt.NDArray[np.int64]
#: By the node that delivers, if any: the ways to it, each as tables by which nodes' levels move.
Outcomes = dict[int | None, list[list[tuple[int, Table]]]]


def _tables(scenario: Scenario, levels_j: tuple[float, ...]) -> tuple[Integers, int, Outcomes]:
    """Neighbours of every cell, the cell of the start, and all that an AUV can do in a slot."""
    world = World(scenario)
    codes = world.grid.encode(world.grid.all_coordinates()).tolist()
    index = {code: i for i, code in enumerate(codes)}
    targets = np.asarray(world.motion.neighbours(np.array(codes)[:, None]))[:, 0]
    neighbours = np.array([[index[code] for code in row] for row in targets.tolist()])
    state = world.reset(node_codes(scenario, world.grid, [np.random.default_rng(0)]))
    levels = [int(Fraction(level) * UNITS_PER_J) for level in levels_j]
    make = _time_division if isinstance(scenario.duplex, Tdd) else _frequency_division
    per_node = []
    for node_code in state.node_cell[0].tolist():
        known: dict[int, list[list[int]]] = {}
        rows = []
        for code in codes:
            offset = int(world.link.offset(code, node_code))
            if offset not in known:
                known[offset] = make(world, offset, levels)
            rows.append(known[offset])
        per_node.append([np.array(table) for table in zip(*rows, strict=True)])
    if isinstance(scenario.duplex, Tdd):
        return neighbours, index[int(state.cell[0, 0])], _named_outcomes(per_node)
    return neighbours, index[int(state.cell[0, 0])], _charged_and_heard(per_node)


def _named_outcomes(per_node: list[list[Table]]) -> Outcomes:
    outcomes: Outcomes = {None: [[(node, table[0])] for node, table in enumerate(per_node)]}
    return outcomes | {node: [[(node, table[1])]] for node, table in enumerate(per_node)}


def _charged_and_heard(per_node: list[list[Table]]) -> Outcomes:
    charges = [(node, charge) for node, (charge, _, _) in enumerate(per_node)]
    outcomes: Outcomes = {None: [[charged] for charged in charges]}
    for heard, (_, deliver, both) in enumerate(per_node):
        others = [charged for charged in charges if charged[0] != heard]
        outcomes[heard] = [[(heard, both)], *([(heard, deliver), other] for other in others)]
    return outcomes


def _units(energy_j: float) -> int:
    """Whole units, rounded down."""
    return int(Fraction(energy_j) * UNITS_PER_J // 1)


def _tolerance(world: World, levels: list[int]) -> int:
    largest = max(_units(p * world.link.slot_s) for p in world.link.harvested_w.tolist())
    return int(world.num_slots * ROUNDING * (levels[-1] + largest)) + 1


def _frequency_division(world: World, offset: int, levels: list[int]) -> list[list[int]]:
    """Levels after charging, after delivering, and after both."""
    harvest = _units(float(world.link.harvested_w[offset]) * world.link.slot_s) + 1
    price = _units(float(world.link.slot_uplink_j[offset]))
    tolerance = _tolerance(world, levels)
    infinite = len(levels)

    def paid(energy: int) -> int:
        return bisect_left(levels, energy - price) if energy + tolerance > price else infinite + 1

    return [
        [*(bisect_left(levels, level + harvest) for level in levels), infinite],
        [*(paid(level) for level in levels), infinite],
        [*(paid(level + harvest) for level in levels), infinite],
    ]


def _time_division(world: World, offset: int, levels: list[int]) -> list[list[int]]:
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
    tolerance = _tolerance(world, levels)
    least, most = _units(gain_j(low)), _units(most_j) + tolerance
    # The paper's rule has a root where the gain rises through 0, whatever is stored.
    has_root = duplex.beta_rule == "paper" and least <= tolerance and most >= -tolerance
    deliver, charge = [], []
    for i, level in enumerate([*levels, None]):
        below = levels[i - 1] if i else 0
        left: list[int] = []
        if level is None:
            deliver.append(len(levels))
        else:
            if level + tolerance > price:
                left.append(level - price)
            if has_root:
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
