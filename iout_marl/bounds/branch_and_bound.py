"""The branch-and-bound bound: every way to begin an episode, with what must follow at least.

At the start no node has energy, and the AUV is where it is: what can be delivered in the
first slots is little. Layer by layer, slot by slot, all states of the game of `FiniteGame` are
listed that can still end below a target; what follows a state costs at least what
scheduling alone would, `least_remaining_ages`. Once no state is left, no policy ends below
the target.
"""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.bounds.deadline import OutOfTime, check_time
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.scheduling import least_remaining_ages

Integers = npt.NDArray[np.int64]

#: States that a layer may hold; beyond, those nearest to the target are given up, and the
#: target with them.
WIDTH = 150_000
#: By how much the first target lies above what is proven; the next by twice as much.
FIRST_STRIDE = 4
#: Rows that are compared with each row of their group in the search for one that is better.
STRIDES = (*range(1, 9), 12, 16, 24, 32, 48, 64, 1, 2, 3, 4)


class Layer(NamedTuple):
    """States before a slot, (states, …) each."""

    cell: Integers  # (states,)
    ages: Integers  # (states, nodes) in slots
    levels: Integers  # (states, nodes) stored energies, see `FiniteGame`
    total: Integers  # (states,) sum of ages so far
    least: Integers  # (states,) least sum of ages at the end of the episode

    def at(self, rows: npt.NDArray[np.bool_] | Integers | slice) -> Layer:
        """Some of the states."""
        return Layer(*(array[rows] for array in self))


def first_layer(field: FiniteGame) -> Layer:
    """The start of an episode."""
    scenario = field.scenario
    ages = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    return Layer(
        cell=np.array([field.start]),
        ages=ages,
        levels=np.zeros_like(ages),
        total=np.zeros(1, dtype=np.int64),
        least=_least(field, np.zeros(1, dtype=np.int64), ages, 0),
    )


def next_layer(
    field: FiniteGame, layer: Layer, slot: int, target: int, deadline: float = math.inf
) -> Layer:
    """All states that one slot leads to and that may end below the target; some may be alike.

    Args:
        field: the game.
        layer: the states before the slot.
        slot: the slot, from 0.
        target: a sum of ages.
        deadline: when to give up, by `time.monotonic`.

    Raises:
        OutOfTime: it has come.
    """
    cells = field.next_cells[layer.cell]
    pairs = np.unique(np.arange(len(cells))[:, None] * len(field.next_cells) + cells)
    origin, cell = np.divmod(pairs, len(field.next_cells))
    before = layer.at(origin)._replace(cell=cell)
    parts = []
    best = field.tables.both if field.tables.both is not None else field.tables.deliver
    for heard in (None, *range(field.scenario.num_nodes)):
        check_time(deadline)
        able = before
        if heard is not None:
            able = able.at(best[heard, able.cell, able.levels[:, heard]] < field.num_levels)
        ages = np.minimum(able.ages + 1, field.scenario.age.maximum)
        if heard is not None:
            ages[:, heard] = 1
        total = able.total + ages.sum(axis=1)
        least = _least(field, total, ages, slot + 1)
        after = Layer(able.cell, ages, able.levels, total, least).at(least < target)
        parts.extend(_with_energy(field, after, heard))
    return Layer(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _with_energy(field: FiniteGame, layer: Layer, heard: int | None) -> list[Layer]:
    """The states after every choice of whom to charge, where the node heard can pay.

    Nobody is one of them where the scenario says so. It matters in TDD: naming a node that is rich
    may cost it what it has.
    """
    charge, deliver, both = field.tables
    nodes = range(field.scenario.num_nodes)
    may_be_idle = field.scenario.may_be_idle
    if heard is None:
        idle = [layer] if may_be_idle else []
        return [*idle, *(_moved(field, layer, charged, charge) for charged in nodes)]
    paid = _moved(field, layer, heard, deliver)
    if both is None:
        return [paid]
    idle = [paid] if may_be_idle else []
    others = [_moved(field, paid, charged, charge) for charged in nodes if charged != heard]
    return [_moved(field, layer, heard, both), *idle, *others]


def _moved(field: FiniteGame, layer: Layer, node: int, table: Integers) -> Layer:
    """The states with one node's level moved as a table says, where it says anything."""
    level = table[node, layer.cell, layer.levels[:, node]]
    levels = layer.levels.copy()
    levels[:, node] = level
    return layer._replace(levels=levels).at(level < field.num_levels)


def _least(field: FiniteGame, total: Integers, ages: Integers, slots_over: int) -> Integers:
    scenario = field.scenario
    left = scenario.num_slots - slots_over
    return total + least_remaining_ages(ages, left, scenario.age.maximum, 1)


def without_worse(layer: Layer, deadline: float = math.inf) -> Layer:
    """The states, without some for which another is at least as good.

    A state is no better than one in the same cell with the same ages, no more ages so far
    and no less energy anywhere. At the deadline, by `time.monotonic`, the others are left in.
    """
    keys = np.concatenate([layer.cell[:, None], layer.ages], axis=1)
    group = keys @ np.random.default_rng(0).integers(1, 2**40, keys.shape[1])
    layer = layer.at(np.lexsort((-layer.levels.sum(axis=1), layer.total, group)))
    for stride in STRIDES:
        if time.monotonic() > deadline:
            break
        better, worse = layer.at(slice(None, -stride)), layer.at(slice(stride, None))
        near = np.flatnonzero(better.total <= worse.total)
        better, worse = better.at(near), worse.at(near)
        is_worse = (
            (better.levels >= worse.levels).all(axis=1)
            & (better.cell == worse.cell)
            & (better.ages == worse.ages).all(axis=1)
        )
        keep = np.ones(len(layer.cell), dtype=np.bool_)
        keep[near[is_worse] + stride] = False
        layer = layer.at(keep)
    return layer


def search(field: FiniteGame, proven: int, best_known: int, seconds: float) -> int:
    """The highest sum of ages found below which no policy ends.

    Args:
        field: the game.
        proven: a sum of ages that is a bound already, such as `least_age_sum`.
        best_known: a sum of ages that some policy reaches: no bound is higher.
        seconds: time to spend; a step that has begun takes up to a second more.

    Returns:
        the bound: a sum of ages over nodes and slots.
    """
    deadline = time.monotonic() + seconds
    target, stride = proven, FIRST_STRIDE
    while target < best_known and time.monotonic() < deadline:
        target = min(target + stride, best_known)
        reached = _reached(field, target, deadline)
        proven = max(proven, reached)
        if reached < target:
            break
        stride *= 2
    return proven


def _reached(field: FiniteGame, target: int, deadline: float) -> int:
    """The target, or what is left of it when layers grow too wide or time is over."""
    layer = first_layer(field)
    for slot in range(field.scenario.num_slots):
        try:
            layer = next_layer(field, layer, slot, target, deadline)
            check_time(deadline)
        except OutOfTime:
            break
        layer = without_worse(layer, deadline)
        if len(layer.least) > WIDTH:
            target = min(target, int(np.partition(layer.least, WIDTH)[WIDTH]))
            layer = layer.at(layer.least < target)
        if len(layer.least) == 0:
            return target
    return int(layer.least.min(initial=target))
