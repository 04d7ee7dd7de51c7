"""The Lagrangian bound once more, in whole numbers, from the prices alone."""

from __future__ import annotations

import math
from fractions import Fraction

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.check_game import Game
from iout_marl.bounds.prices import Prices
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Parts of a slot of age in which the check counts.
UNITS_PER_SLOT = 2**16
#: More than any sum of ages and payments.
IMPOSSIBLE = 2**60
#: Entries of 8 bytes of what is kept of a slot, and of all payments; steps of the whole check.
MOST_KEPT, MOST_PAYMENTS, MOST_STEPS = 2**25, 2**26, 2**35
#: Entries that are worked on at once: few enough for a processor's cache.
BLOCK_ENTRIES = 2**15


def proven_age_sum(scenario: Scenario, prices: Prices, oldest: int, game: Game) -> Fraction:
    """The sum of ages below which, at these prices, no policy ends.

    Args:
        scenario: the scenario, of TDD.
        prices: any prices that `Certificate.checked` has found to be prices of this scenario.
        oldest: ages from here on count as this, 2 or more.
        game: the scenario's.

    Raises:
        InputError: the check would take too long or too much memory, or its sums could overflow.
    """
    _check_size(scenario, prices, oldest, game)
    between = prices.between()
    naming = np.maximum(_units(between @ prices.naming), 0)
    presence = _units(
        np.einsum(
            "ti,kji,jx->ktx",
            between,
            prices.presence,
            prices.nearness(game.distance_m),
            optimize=True,
        )
    )
    # Whatever was rounded: over nodes the payments must add up to nothing.
    presence[-1] = -presence[:-1].sum(axis=0)
    total = -int(naming.sum())
    for tables, pays in zip(game.tables, presence, strict=True):
        total += _least(scenario, oldest, naming, pays, game, tables)
    return Fraction(total, UNITS_PER_SLOT)


def _check_size(scenario: Scenario, prices: Prices, oldest: int, game: Game) -> None:
    """See that no sum can overflow, and that time and memory do.

    In a slot a node adds no more than A_max, p and the largest |μ|, which is that of the last
    node: with w the largest |w_kj|, K w for each of the K − 1 others. What is rounded is less than
    a slot each. As `IMPOSSIBLE` is added to in one slot before it is set anew, nothing comes to
    more than twice that, a quarter of what 64 bits hold.
    """
    slots, nodes = scenario.num_slots, scenario.num_nodes
    naming, weight = float(prices.naming.max()), float(np.abs(prices.presence).max())
    in_a_slot = scenario.age.maximum + math.ceil(naming) + nodes**2 * math.ceil(weight) + nodes + 1
    if slots * in_a_slot * UNITS_PER_SLOT > IMPOSSIBLE:
        raise InputError(
            "certificate: naming and presence: prices so high cannot be added up in 64 bits"
        )
    cells, num_levels = game.tables[0][0].shape
    kept = cells * (num_levels + 1) * (min(oldest, scenario.age.maximum) + 1)
    payments = slots * max(nodes * cells, len(prices.slots))
    if kept > MOST_KEPT or payments > MOST_PAYMENTS or kept * slots * nodes > MOST_STEPS:
        raise InputError(
            f"certificate: levels_j and oldest: {num_levels - 1} levels and {oldest} ages are too "
            f"many for the check of {nodes} nodes, {cells:,} cells and {slots:,} slots"
        )


def _units(price: Floats) -> Integers:
    return np.rint(price * UNITS_PER_SLOT).astype(np.int64)


def _least(
    scenario: Scenario,
    oldest: int,
    naming: Integers,
    presence: Integers,
    game: Game,
    tables: list[Integers],
) -> int:
    """Least ages and payments of a node, in units, from where the AUV starts."""
    num_cells, num_levels = tables[0].shape
    limit = min(oldest, scenario.age.maximum)
    # Ages 0 (no delivery so far) and 1 … limit.
    value = np.zeros((num_cells, num_levels + 1, limit + 1), dtype=np.int64)
    moved = value[:, :num_levels].copy()
    later = np.minimum(np.arange(limit + 1) + 1, limit)
    later[0] = 0
    step = max(1, BLOCK_ENTRIES // (value.size // num_cells))
    blocks = [slice(first, first + step) for first in range(0, num_cells, step)]
    for slot in range(scenario.num_slots - 1, -1, -1):
        value[:, num_levels] = IMPOSSIBLE
        age = later.copy()
        age[0] = min(scenario.age.initial + slot + 1, scenario.age.maximum)
        for block in blocks:
            after, pays = value[block], presence[slot, block, None, None]
            cells = np.arange(len(after))[:, None]
            kept = after[:, :, later] + age * UNITS_PER_SLOT
            heard = after[:, :, 1] + UNITS_PER_SLOT
            named = np.minimum(
                kept[cells, tables[0][block]], heard[cells, tables[1][block]][:, :, None]
            )
            moved[block] = np.minimum(kept[:, :num_levels], named + naming[slot]) + pays
        for block in blocks:
            neighbours = game.neighbours[block].T
            value[block, :num_levels] = moved[neighbours[0]]
            for column in neighbours[1:]:
                np.minimum(value[block, :num_levels], moved[column], out=value[block, :num_levels])
    return int(value[game.start, 0, 0])
