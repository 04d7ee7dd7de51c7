"""The opening bound once more: every way through the first slots, in whole numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.check_game import Game, Integers
from iout_marl.scenario import Scenario

#: Whole numbers of any size.
Rows = npt.NDArray[Any]
#: By the node that delivers, if any: the ways to it, each as tables by which nodes' levels move.
Outcomes = dict[int | None, list[list[tuple[int, Integers]]]]


def oldest_first(ages: Rows, num_slots: int, maximum: int, resets: int) -> Integers:
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


def check_opening(scenario: Scenario, game: Game, target: int) -> None:
    """See that every way through the first slots comes to nothing below the target.

    Raises:
        ValueError: some do not.
    """
    num_nodes, maximum = scenario.num_nodes, scenario.age.maximum
    outcomes = _outcomes(game)
    dead = game.tables[0][0].shape[1]
    if num_nodes * scenario.num_slots * maximum >= np.iinfo(np.int32).max:
        raise ValueError("sums of ages may be too large for the check")
    # A row: cell, levels, ages, sum of ages.
    rows: Rows = np.array(
        [[game.start] + [0] * num_nodes + [scenario.age.initial] * num_nodes + [0]], dtype=np.int32
    )
    for slot in range(scenario.num_slots):
        rows = _distinct(np.concatenate([_moved(rows, column) for column in game.neighbours.T]))
        after = []
        for heard, choices in outcomes.items():
            new = rows[_able(rows, heard, choices, dead)]
            ages = new[:, 1 + num_nodes : -1]
            ages += 1
            if heard is not None:
                ages[:, heard] = 1
            np.minimum(ages, maximum, out=ages)
            new[:, -1] += ages.sum(axis=1)
            least = new[:, -1] + oldest_first(
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


def _able(
    rows: Rows, heard: int | None, choices: list[list[tuple[int, Integers]]], dead: int
) -> npt.NDArray[np.bool_]:
    """In which rows the node heard can pay in any of the ways."""
    able = np.full(len(rows), heard is None)
    for table in {id(t): t for tables in choices for node, t in tables if node == heard}.values():
        able |= table[rows[:, 0], rows[:, 1 + (heard or 0)]] < dead
    return able


def _moved(rows: Rows, next_cell: Integers) -> Rows:
    moved = rows.copy()
    moved[:, 0] = next_cell[rows[:, 0]]
    return moved


def _distinct(rows: Rows) -> Rows:
    packed = np.ascontiguousarray(rows)
    _, first = np.unique(packed.view(f"V{packed.itemsize * rows.shape[1]}"), return_index=True)
    return rows[first]


def _outcomes(game: Game) -> Outcomes:
    if len(game.tables[0]) == 2:
        return _named_outcomes(game.tables)
    return _charged_and_heard(game.tables)


def _named_outcomes(per_node: list[list[Integers]]) -> Outcomes:
    outcomes: Outcomes = {None: [[(node, table[0])] for node, table in enumerate(per_node)]}
    return outcomes | {node: [[(node, table[1])]] for node, table in enumerate(per_node)}


def _charged_and_heard(per_node: list[list[Integers]]) -> Outcomes:
    charges = [(node, charge) for node, (charge, _, _) in enumerate(per_node)]
    outcomes: Outcomes = {None: [[charged] for charged in charges]}
    for heard, (_, deliver, both) in enumerate(per_node):
        others = [charged for charged in charges if charged[0] != heard]
        outcomes[heard] = [[(heard, both)], *([(heard, deliver), other] for other in others)]
    return outcomes
