"""The oracle's node tables: what an AUV sees, row by row, in plain numbers."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oracle import Cell, Oracle

#: What counts as 1: so many cells, and half of what grows without end: so many slots.
CELLS, HALF = 10, 50


def doublings(energy_j: float, price_j: float) -> float:
    """How many times one doubles the other, in quarters, up to 8 doublings either way."""
    ratio = math.log2(max(energy_j, 1e-30)) - math.log2(max(price_j, 1e-30))
    return max(min(ratio, 8), -8) / 4


def steps(one: Cell, other: Cell) -> list[float]:
    """From one cell to another along x, y, z, and how far, in tens of cells."""
    far = [b - a for a, b in zip(one, other, strict=True)]
    return [each / CELLS for each in (*far, math.hypot(*far))]


class Table:
    """What one AUV of the oracle sees of ages and energies that it knows."""

    def __init__(self, oracle: Oracle, auv: int, age: list[float], energy_j: list[float]) -> None:
        self.oracle, self.auv = oracle, auv
        self.age, self.energy_j = age, energy_j
        self.own = oracle.auv_cells[auv]
        self.others = [other for other in oracle.auvs if other != auv]
        self.k, self.m = len(oracle.nodes), len(oracle.auvs)

    def flat(self, unseen_for: list[float] | None) -> list[float]:
        """All of it as one vector: columns of a row's kind one after the other."""
        auvs = [self.of_auv(other) for other in self.others]
        nodes = [self.of_node(node) for node in self.oracle.nodes]
        if unseen_for is not None:
            nodes = [[*row, slots] for row, slots in zip(nodes, unseen_for, strict=True)]
        seen = self.context()
        for rows in (auvs, nodes):
            seen += [number for column in zip(*rows, strict=True) for number in column]
        directions = range(len(self.oracle.steps))
        moves = [[self.of_move(d, node) for node in self.oracle.nodes] for d in directions]
        for column in range(3):
            seen += [row[column] for rows in moves for row in rows]
        return seen

    def rank(self, auv: int) -> int:
        """How many AUVs come before, by their cells in x, y, z, and then by their numbers."""
        cells = self.oracle.auv_cells
        return sum((cells[other], other) < (cells[auv], auv) for other in self.oracle.auvs)

    def charge(self, auv: int) -> float:
        vehicle = self.oracle.scenario.vehicle
        if vehicle.kind == "unlimited":
            return 1.0
        return self.oracle.vehicles.battery_j[auv] / vehicle.capacity_j

    def price_j(self, cell: Cell, node: int) -> float:
        """Of an uplink from a node to a cell, over a whole slot."""
        oracle = self.oracle
        d = oracle.between_m(cell, oracle.node_cells[node])
        return oracle.sound.required_j(d, oracle.scenario.slot_s)

    def in_turns(self, age: float) -> float:
        """Beside the age at which nodes in turn are heard, twice the mean."""
        return min(age * self.m / (2 * self.k), 4)

    def context(self) -> list[float]:
        oracle = self.oracle
        sizes = oracle.scenario.grid.cells
        behind = [(c - 1) / CELLS for c in self.own]
        ahead = [(size - c) / CELLS for size, c in zip(sizes, self.own, strict=True)]
        counts = [math.log2(n) / 5 for n in (self.k, self.m, self.k / self.m)]
        over, left = oracle.slot, oracle.scenario.num_slots - oracle.slot
        pay = sum(self.energy_j[n] > self.price_j(self.own, n) for n in oracle.nodes)
        return [
            *(*behind, *ahead),
            *(*counts, self.rank(self.auv) / self.m, self.charge(self.auv)),
            *(left / (left + HALF), over / (over + HALF)),
            *(self.in_turns(math.fsum(self.age) / self.k), self.in_turns(max(self.age))),
            pay / self.k,
        ]

    def of_auv(self, other: int) -> list[float]:
        ahead = (self.rank(other) - self.rank(self.auv)) / self.m
        return [*steps(self.own, self.oracle.auv_cells[other]), ahead, self.charge(other)]

    def of_node(self, node: int) -> list[float]:
        oracle, age, has_j = self.oracle, self.age[node], self.energy_j[node]
        cell, weights = oracle.node_cells[node], oracle.scenario.node_weights
        turn = sum(other > age for other in self.age) - self.rank(self.auv)
        near_j, here_j = self.price_j(cell, node), self.price_j(self.own, node)
        storage = oracle.scenario.storage
        full = 0.0 if storage.kind == "unlimited" else has_j / storage.capacity_j
        way = steps(self.own, cell)
        return [
            *way,
            *(self.in_turns(age), age / (age + HALF), turn / self.k, float(turn == 0)),
            weights[node] / (math.fsum(weights) / self.k),
            *(doublings(has_j, near_j), doublings(has_j, here_j), float(has_j > here_j), full),
            *self.rivals(cell, way[-1]),
        ]

    def rivals(self, cell: Cell, own: float) -> Iterator[float]:
        """How much farther than the nearest other AUV, and the share of AUVs that are nearer."""
        far = [steps(self.oracle.auv_cells[other], cell)[-1] for other in self.others]
        yield own - min(far) if far else 0.0
        yield sum(each < own for each in far) / self.m

    def of_move(self, direction: int, node: int) -> list[float]:
        """What a node is from the cell that a move leads to."""
        oracle, has_j = self.oracle, self.energy_j[node]
        cell, _ = oracle.ahead(self.own, direction)
        price_j, slot_s = self.price_j(cell, node), oracle.scenario.slot_s
        d = oracle.between_m(cell, oracle.node_cells[node])
        harvest_j = oracle.sound.harvested_j(d, slot_s)
        return [
            doublings(has_j, price_j),
            doublings(harvest_j, price_j),
            float(self.delivers(cell, node)),
        ]

    def delivers(self, cell: Cell, node: int) -> bool:
        """Whether a node does that is charged and heard from a cell, alone, in this slot."""
        oracle, slot_s = self.oracle, self.oracle.scenario.slot_s
        d, has_j = oracle.between_m(cell, oracle.node_cells[node]), self.energy_j[node]
        if oracle.scenario.duplex.kind == "fdd":
            return has_j + oracle.sound.harvested_j(d, slot_s) > self.price_j(cell, node)
        beta = oracle.splitting_at(d, has_j)
        if beta == 1:
            return False
        has_j += oracle.sound.harvested_j(d, beta * slot_s)
        # Of a root, where both are equal, rounding must not decide.
        return has_j >= oracle.sound.required_j(d, (1 - beta) * slot_s) * (1 - 1e-9)
