"""The branch-and-bound bound once more: every way through the first slots, in whole numbers."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.check_game import Game, Integers
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario

#: Whole numbers of any size.
Rows = npt.NDArray[Any]
#: By the node that delivers, if any: the ways to it, each as tables by which nodes' levels move.
Outcomes = dict[int | None, list[list[tuple[int, Integers]]]]

#: Sums of ages and cells are counted in 32 bits.
MOST_COUNTED = 2**31 - 1
#: Rows that are compared with each row of their group in the search for one that is better.
STRIDES = (1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 64, 1, 2)
#: Entries of 4 bytes that are worked on at once, and in the whole check. The certificates of
#: four minutes' search take a quarter of the first and a tenth of the second.
MOST_AT_ONCE, MOST_IN_ALL = 2**27, 2**32
#: What a slot costs at least, in entries.
SLOT_ENTRIES = 2**12


def oldest_first(ages: Rows, num_slots: int, maximum: int, resets: int) -> Integers:
    """Sums of ages if the oldest are reset in every slot, played out slot by slot.

    Args:
        ages: (rows, nodes) ages now, in slots.
        num_slots: slots to come.
        maximum: A_max in slots.
        resets: nodes reset in a slot, 1 or more.
    """
    total = np.zeros(len(ages), dtype=np.int64)
    # (nodes, rows): the oldest last. Once reset it is the youngest, so that turns go round.
    ages = np.ascontiguousarray(np.sort(ages, axis=1).T)
    num_nodes = len(ages)
    for slot in range(num_slots):
        np.minimum(ages + 1, maximum, out=ages)
        for turn in range(slot * resets, slot * resets + min(resets, num_nodes)):
            ages[-1 - turn % num_nodes] = 1
        total += ages.sum(axis=0, dtype=np.int64)
        if slot >= num_nodes:
            # All nodes have been reset: from now on every row and every slot is the same.
            return total + (num_slots - slot - 1) * ages[:, :1].sum(axis=0, dtype=np.int64)
    return total


def check_branch_and_bound(scenario: Scenario, game: Game, target: int) -> None:
    """See that every way through the first slots comes to nothing below the target.

    Raises:
        InputError: some do not, or there are too many.
    """
    num_nodes, maximum = scenario.num_nodes, scenario.age.maximum
    outcomes = _outcomes(game, idle_choices=scenario.may_be_idle)
    dead = game.tables[0][0].shape[1]
    highest = num_nodes * scenario.num_slots * maximum
    if max(highest, len(game.neighbours)) > MOST_COUNTED:
        raise InputError("certificate: the scenario's ages are too many to be counted in 32 bits")
    # A row: cell, levels, ages, sum of ages.
    rows: Rows = np.array(
        [[game.start] + [0] * num_nodes + [scenario.age.initial] * num_nodes + [0]], dtype=np.int32
    )
    budget = _Budget()
    for slot in range(scenario.num_slots):
        budget.spend(rows.size * game.neighbours.shape[1])
        rows = _distinct(np.concatenate([_moved(rows, column) for column in game.neighbours.T]))
        after: list[Rows] = []
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
            budget.spend(new.size * len(choices), sum(rows.size for rows in after))
            for tables in choices:
                chosen = new.copy()
                for node, table in tables:
                    chosen[:, 1 + node] = table[chosen[:, 0], chosen[:, 1 + node]]
                    chosen = chosen[chosen[:, 1 + node] < dead]
                after.append(chosen)
        rows = _without_worse(_distinct(np.concatenate(after)), num_nodes)
        if len(rows) == 0:
            return
    raise InputError(
        f"certificate: age_sum: {len(rows)} ways through the episode may end below {target}"
    )


class _Budget:
    """Entries that the check may still look at."""

    def __init__(self) -> None:
        self._left = MOST_IN_ALL

    def spend(self, entries: int, beside: int = 0) -> None:
        """Take so many entries, which are kept beside others.

        Raises:
            InputError: there are not so many left.
        """
        self._left -= entries + SLOT_ENTRIES
        if self._left < 0 or entries + beside > MOST_AT_ONCE:
            raise InputError(
                "certificate: age_sum: not proven, for there are more ways through the first slots "
                "than the check lists"
            )


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


def _without_worse(rows: Rows, num_nodes: int) -> Rows:
    """The rows, without some for which another is at least as good.

    That is one in the same cell at the same ages with no more ages behind it and no less energy
    anywhere: whatever can be done from the worse one can be done from it, as no table leads a
    node of more energy to less. Rows are compared with some before them in an order in which the
    better stand first, so that the best of all is never left out.
    """
    energies = slice(1, 1 + num_nodes)
    alike = np.ascontiguousarray(np.delete(rows, [*range(1, 1 + num_nodes), -1], axis=1))
    packed = alike.view(f"V{alike.itemsize * alike.shape[1]}")[:, 0]
    _, group = np.unique(packed, return_inverse=True)
    order = np.lexsort((-rows[:, energies].sum(axis=1), rows[:, -1], group))
    rows, group = rows[order], group[order]
    for stride in STRIDES:
        better, worse = rows[:-stride], rows[stride:]
        near = np.flatnonzero(group[stride:] == group[:-stride])
        better, worse = better[near], worse[near]
        # By the order, the better has no more ages behind it.
        is_worse = (better[:, energies] >= worse[:, energies]).all(axis=1)
        keep = np.ones(len(rows), dtype=np.bool_)
        keep[near[is_worse] + stride] = False
        rows, group = rows[keep], group[keep]
    return rows


def _outcomes(game: Game, *, idle_choices: bool) -> Outcomes:
    if len(game.tables[0]) == 2:
        outcomes = _named_outcomes(game.tables)
    else:
        outcomes = _charged_and_heard(game.tables)
    if idle_choices:
        # Nobody charged: a node heard pays for itself, and without one nothing changes. Not all
        # tables make charging better than that: in TDD naming a node may cost it its store.
        outcomes[None].append([])
        if len(game.tables[0]) > 2:
            for node, (_, deliver, _) in enumerate(game.tables):
                outcomes[node].append([(node, deliver)])
    return outcomes


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
