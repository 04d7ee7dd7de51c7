"""The sharing bound for TDD: every node plans for itself, and pays for the AUV's time.

A slot serves one node, and the AUV is in one place. Take both rules away, and every node k may
have the AUV where it likes; but it pays p_t for each slot t in which it is named, and μ_kt(x)
for having the AUV in cell x. The prices p_t ≥ 0 are paid back once a slot, and the μ add up to 0
over nodes. Whatever a policy does, the nodes could all do too, and would pay nothing on
balance: so the sum over nodes of the least of ages and payments, less Σ p_t, is a lower bound
for any prices (Lagrangian relaxation; Geoffrion, 1974). The least for one node is a dynamic
programme over (slot, cell, level of energy, age).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.field import Field

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

#: Ages from so many times the number of nodes on count as that.
OLDEST_PER_NODE = 6
#: Values that are kept, of 4 bytes each.
MOST_STATES = 5 * 10**8
#: No age.
IMPOSSIBLE = np.float32(1e9)


@dataclass(frozen=True)
class Prices:
    """p_t and μ_kt(x), as few numbers.

    Between the `slots` listed prices run straight. μ_kt(x) is Σ_j w_kjt exp(−d_j(x)/reach),
    where d_j(x) is the distance from x to node j.

    Attributes:
        slots: (times,) slots at which prices are given; the last is the last of the episode.
        naming: (times,) p, in slots of age, from 0.
        presence: (nodes, nodes, times) w_kj; over k they add up to 0.
        reach_m: the reach in m.
    """

    slots: tuple[int, ...]
    naming: Floats
    presence: Floats
    reach_m: float

    def between(self) -> Floats:
        """(slots, times) the weight of each listed slot in every slot."""
        every = np.arange(self.slots[-1] + 1)
        unit = np.eye(len(self.slots))
        return np.stack([np.interp(every, self.slots, row) for row in unit], axis=1)

    def nearness(self, distance_m: Floats) -> Floats:
        """exp(−d_j(x)/reach) from (nodes, cells) distances."""
        return np.exp(-distance_m / self.reach_m)


class Wish(NamedTuple):
    """What one node would have the AUV do at given prices."""

    value: float  # its ages and payments
    path: Integers  # (slots,) cells
    named: Integers  # (slots,) 1 where it is named, else 0


class Programme:
    """The dynamic programme of one node at a time.

    Args:
        field: the game, of a TDD scenario.
    """

    def __init__(self, field: Field) -> None:
        assert field.tables.both is None
        self._field = field
        scenario = field.scenario
        self.oldest = oldest_age(field)
        self._num_cells, self._num_levels = len(field.next_cells), field.num_levels
        # Ages 1 … oldest, and a last entry for nodes that have not delivered so far.
        shape = (self._num_cells, self._num_levels, self.oldest + 1)
        self._value = np.zeros((scenario.num_slots + 1, *shape), dtype=np.float32)
        self._next = np.empty(shape, dtype=np.float32)
        self._named = np.empty((self._num_cells * self._num_levels, shape[2]), dtype=np.float32)

    def wish(self, node: int, naming: Floats, presence: Floats) -> Wish:
        """The best for a node at prices of (slots,) and (slots, cells)."""
        charge, deliver = (
            table[node] + np.arange(self._num_cells)[:, None] * (self._num_levels + 1)
            for table in self._field.tables[:2]
        )
        values, payments = self._value, presence.astype(np.float32)
        for slot in range(len(naming) - 1, -1, -1):
            kept = self._kept(values[slot + 1], slot)
            named = self._named.reshape(kept.shape)
            padded = np.concatenate([kept, np.full_like(kept[:, :1], IMPOSSIBLE)], axis=1).reshape(
                -1, kept.shape[2]
            )
            np.take(padded, charge.ravel(), axis=0, out=self._named, mode="clip")
            served = np.concatenate(
                [values[slot + 1][:, :, 0] + 1, np.full((self._num_cells, 1), IMPOSSIBLE)], axis=1
            )
            np.minimum(named, served.ravel()[deliver][:, :, None], out=named)
            named += np.float32(naming[slot])
            np.minimum(named, kept, out=named)
            named += payments[slot][:, None, None]
            values[slot] = _least_of_neighbours(named, self._field.next_cells)
        return self._trace(node, naming, presence)

    def _kept(self, value: npt.NDArray[np.float32], slot: int) -> npt.NDArray[np.float32]:
        """Value after a slot without delivery, this slot's age included."""
        ages, first = self._ages(slot)
        kept = self._next
        np.add(value[:, :, 1:-1], ages[1:], out=kept[:, :, :-2])
        np.add(value[:, :, -2], ages[-1], out=kept[:, :, -2])
        np.add(value[:, :, -1], first, out=kept[:, :, -1])
        return kept

    def _ages(self, slot: int) -> tuple[npt.NDArray[np.float32], np.float32]:
        """Ages 1 … oldest, and that, after the slot, of a node which has not delivered."""
        age = self._field.scenario.age
        ages = np.minimum(np.arange(1, self.oldest + 1), age.maximum).astype(np.float32)
        return ages, np.float32(min(age.initial + slot + 1, age.maximum))

    def _trace(self, node: int, naming: Floats, presence: Floats) -> Wish:
        """Follow the best choices from the start."""
        charge, deliver = (table[node] for table in self._field.tables[:2])
        cell, level, entry = self._field.start, 0, self.oldest
        path, named = np.zeros((2, len(naming)), dtype=np.int64)
        total = float(self._value[0, cell, level, entry])
        for slot, price in enumerate(naming):
            value = self._value[slot + 1]
            ages, first = self._ages(slot)
            older = entry if entry == self.oldest else min(entry + 1, self.oldest - 1)
            age = first if entry == self.oldest else ages[older]
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


def oldest_age(field: Field) -> int:
    """Up to which age nodes are told apart."""
    scenario = field.scenario
    return max(2, min(OLDEST_PER_NODE * scenario.num_nodes, scenario.age.maximum))


def fits(field: Field) -> bool:
    """Whether the programme fits into memory."""
    states = len(field.next_cells) * field.num_levels * (oldest_age(field) + 1)
    return states * (field.scenario.num_slots + 1) <= MOST_STATES


def _least_of_neighbours(
    value: npt.NDArray[np.float32], next_cells: Integers
) -> npt.NDArray[np.float32]:
    """The least, for every cell, over those that it leads to."""
    least = value[next_cells[:, 0]]
    for cells in next_cells.T[1:]:
        np.minimum(least, value[cells], out=least)
    return least
