"""The Lagrangian bound for TDD: every node plans for itself, and pays for the AUV's time.

A slot serves one node, and the AUV is in one place. Take both rules away, and every node k may
have the AUV where it likes; but it pays p_t for each slot t in which it is named, and μ_kt(x)
for having the AUV in cell x. The prices p_t ≥ 0 are paid back once a slot, and the μ add up to 0
over nodes. Whatever a policy does, the nodes could all do too, and would pay nothing on
balance, or less than is paid back where an AUV names nobody (`auvs.idle_choices`): so the sum over
nodes of the least of ages and payments, less Σ p_t, is a lower bound for any prices (Lagrangian
relaxation; Geoffrion, 1974). The least for one node is a dynamic programme over (slot, cell, level
of energy, age).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.deadline import check_time
from iout_marl.bounds.finite_game import FiniteGame

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
#: (cells, levels, entries): of every age up to the oldest, and of a node without any delivery.
Values = npt.NDArray[np.float32]

#: Entries of 4 bytes that are worked on at once.
BLOCK_ENTRIES = 2**16
#: Ages from so many times the number of nodes on count as that.
OLDEST_PER_NODE = 6
#: Values that are kept, of 4 bytes each.
MOST_STATES = 5 * 10**8
#: No age.
IMPOSSIBLE = np.float32(1e9)


class Wish(NamedTuple):
    """What one node would have the AUV do at given prices."""

    value: float  # its ages and payments
    path: Integers  # (slots,) cells
    named: Integers  # (slots,) 1 where it is named, else 0


class Programme:
    """The dynamic programme of one node at a time.

    Args:
        field: the game, of a TDD scenario.
        oldest: age from which on none are told apart.
    """

    def __init__(self, field: FiniteGame, oldest: int) -> None:
        assert field.tables.both is None
        self._field = field
        scenario = field.scenario
        self._oldest = oldest
        self._num_cells, self._num_levels = len(field.next_cells), field.num_levels
        # Ages 1 … oldest, and a last entry for nodes that have not delivered so far.
        shape = (self._num_cells, self._num_levels, self._oldest + 1)
        self._value = np.zeros((scenario.num_slots + 1, *shape), dtype=np.float32)
        # Cells are taken in blocks that fit into a processor's cache.
        cells = max(1, BLOCK_ENTRIES // (shape[1] * shape[2]))
        self._blocks = [slice(i, i + cells) for i in range(0, shape[0], cells)]
        self._row = (np.arange(shape[0]) % cells)[:, None] * (shape[1] + 1)
        self._after_move = np.empty(shape, dtype=np.float32)
        self._kept = np.empty((cells, *shape[1:]), dtype=np.float32)
        # One more level, which stands for what cannot be.
        self._named = np.empty((cells, shape[1] + 1, shape[2]), dtype=np.float32)

    def wish(self, node: int, naming: Floats, presence: Floats, deadline: float = math.inf) -> Wish:
        """The best for a node at prices of (slots,) and (slots, cells).

        Raises:
            OutOfTime: the deadline, by `time.monotonic`, has come.
        """
        charge, deliver = (table[node] + self._row for table in self._field.tables[:2])
        payments = presence.astype(np.float32)
        for slot in range(len(naming) - 1, -1, -1):
            check_time(deadline)
            for block in self._blocks:
                self._after_move[block] = self._best(
                    self._value[slot + 1, block],
                    slot,
                    np.float32(naming[slot]),
                    payments[slot, block, None],
                    charge[block],
                    deliver[block],
                )
            for block in self._blocks:
                self._least_of_neighbours(self._field.next_cells[block], self._value[slot, block])
        return self._trace(node, naming, presence)

    def _best(
        self,
        after: Values,
        slot: int,
        price: np.float32,
        payment: Values,
        charge: Integers,
        deliver: Integers,
    ) -> Values:
        """Value once the AUV has moved: the best of leaving, charging and hearing the node.

        Args:
            after: (cells, levels, entries) value after the slot.
            slot: the slot.
            price: of being named.
            payment: (cells, 1) for the AUV's presence.
            charge, deliver: (cells, levels) the rows of cell and level that they lead to.
        """
        ages, first = self._ages(slot)
        kept, named = self._kept[: len(after)], self._named[: len(after)]
        np.add(after[:, :, 1:-1], ages[1:] + payment[..., None], out=kept[:, :, :-2])
        np.add(after[:, :, -2], ages[-1] + payment, out=kept[:, :, -2])
        np.add(after[:, :, -1], first + payment, out=kept[:, :, -1])
        np.add(kept, price, out=named[:, :-1])
        named[:, -1] = IMPOSSIBLE
        served = np.full(named.shape[:2], IMPOSSIBLE)
        served[:, :-1] = after[:, :, 0] + (1 + price + payment)
        best = named.reshape(-1, named.shape[2]).take(charge, axis=0, mode="clip")
        np.minimum(best, kept, out=best)
        return np.minimum(best, served.take(deliver)[:, :, None], out=best)

    def _least_of_neighbours(self, next_cells: Integers, least: Values) -> None:
        """The least, for every cell, over those that it leads to."""
        other = self._kept[: len(least)]
        for direction, cells in enumerate(next_cells.T):
            out = other if direction else least
            np.take(self._after_move, cells, axis=0, out=out, mode="clip")
            np.minimum(least, out, out=least)

    def _ages(self, slot: int) -> tuple[npt.NDArray[np.float32], np.float32]:
        """Ages 1 … oldest, and that, after the slot, of a node which has not delivered."""
        age = self._field.scenario.age
        ages = np.minimum(np.arange(1, self._oldest + 1), age.maximum).astype(np.float32)
        return ages, np.float32(min(age.initial + slot + 1, age.maximum))

    def _trace(self, node: int, naming: Floats, presence: Floats) -> Wish:
        """Follow the best choices from the start."""
        charge, deliver = (table[node] for table in self._field.tables[:2])
        cell, level, entry = self._field.start, 0, self._oldest
        path, named = np.zeros((2, len(naming)), dtype=np.int64)
        total = float(self._value[0, cell, level, entry])
        for slot, price in enumerate(naming):
            value = self._value[slot + 1]
            ages, first = self._ages(slot)
            older = entry if entry == self._oldest else min(entry + 1, self._oldest - 1)
            age = first if entry == self._oldest else ages[older]
            choices = []
            for to in self._field.next_cells[cell]:
                pays = presence[slot, to]
                choices.append((value[to, level, older] + age + pays, to, level, older, 0))
                for table, after, cost in ((charge, older, age), (deliver, 0, 1)):
                    new = table[to, level]
                    if new < self._num_levels:
                        cost = value[to, new, after] + cost + pays + price  # noqa: PLW2901
                        choices.append((cost, to, new, after, 1))
            _, cell, level, entry, named[slot] = min(choices)
            path[slot] = cell
        return Wish(total, path, named)


def oldest_age(field: FiniteGame, per_node: int = OLDEST_PER_NODE) -> int:
    """Up to which age nodes are told apart."""
    scenario = field.scenario
    return max(2, min(per_node * scenario.num_nodes, scenario.age.maximum))


def fits(field: FiniteGame) -> bool:
    """Whether the programme fits into memory."""
    states = len(field.next_cells) * field.num_levels * (oldest_age(field) + 1)
    return states * (field.scenario.num_slots + 1) <= MOST_STATES
