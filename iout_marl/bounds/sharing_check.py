"""The sharing bound once more, in whole numbers, from the prices alone."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.check_game import Game
from iout_marl.bounds.sharing import Prices
from iout_marl.scenario import Scenario

Integers = npt.NDArray[np.int64]

#: Parts of a slot of age in which the check counts.
UNITS_PER_SLOT = 2**16
#: More than any sum of ages and payments.
IMPOSSIBLE = 2**60


def proven_age_sum(scenario: Scenario, prices: Prices, oldest: int, game: Game) -> Fraction:
    """The sum of ages below which, at these prices, no policy ends.

    Args:
        scenario: the scenario, of TDD.
        prices: any prices.
        oldest: ages from here on count as this.
        game: the scenario's.
    """
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
        total += _least(scenario, oldest, naming, pays, game.neighbours, tables)[game.start]
    return Fraction(total, UNITS_PER_SLOT)


def _units(price: npt.NDArray[np.float64]) -> Integers:
    return np.rint(price * UNITS_PER_SLOT).astype(np.int64)


def _least(
    scenario: Scenario,
    oldest: int,
    naming: Integers,
    presence: Integers,
    neighbours: Integers,
    tables: list[Integers],
) -> list[int]:
    """Least ages and payments of a node, in units, by the cell from which the AUV starts."""
    num_cells, num_levels = tables[0].shape
    cells = np.arange(num_cells)[:, None]
    limit = min(oldest, scenario.age.maximum)
    # Ages 0 (no delivery so far) and 1 … limit.
    value = np.zeros((num_cells, num_levels + 1, limit + 1), dtype=np.int64)
    later = np.minimum(np.arange(limit + 1) + 1, limit)
    later[0] = 0
    for slot in range(scenario.num_slots - 1, -1, -1):
        value[:, num_levels] = IMPOSSIBLE
        age = later.copy()
        age[0] = min(scenario.age.initial + slot + 1, scenario.age.maximum)
        kept = value[:, :, later] + age * UNITS_PER_SLOT
        named = np.minimum(
            kept[cells, tables[0]],
            (value[:, :, 1] + UNITS_PER_SLOT)[cells, tables[1]][:, :, None],
        )
        value[:, :num_levels] = np.minimum(kept[:, :num_levels], named + naming[slot])
        value[:, :num_levels] += presence[slot][:, None, None]
        value = np.min([value[column] for column in neighbours.T], axis=0)
    return [int(least) for least in value[:, 0, 0]]
