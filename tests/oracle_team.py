"""The oracle's team: what each AUV knows of the network and of the others, and what it adds."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from oracle_tables import Table

if TYPE_CHECKING:
    from oracle import Oracle


class Notebook:
    """What one AUV has seen and brought in, over an episode."""

    def __init__(self, oracle: Oracle, auv: int) -> None:
        self.oracle, self.auv = oracle, auv
        self.seen_age = list(oracle.age)
        self.seen_energy_j = list(oracle.energy_j)
        self.seen_slot = [0 for _ in oracle.nodes]
        # The network as it would be had nothing ever reached this AUV.
        self.age_without = list(oracle.age)
        self.deliveries_without = [0 for _ in oracle.nodes]

    def turn_page(self) -> None:
        """After a slot of the oracle."""
        oracle, reach_m = self.oracle, self.oracle.scenario.observation.view_range_m
        for node in oracle.nodes:
            takers = [a for a, e in enumerate(oracle.events) if node in e.received]
            if reach_m is not None and (
                takers == [self.auv] or oracle.distance_m(self.auv, node) <= reach_m
            ):
                self.seen_age[node] = oracle.age[node]
                self.seen_energy_j[node] = oracle.energy_j[node]
                self.seen_slot[node] = oracle.slot
            if takers and takers != [self.auv]:
                self.age_without[node] = oracle.age[node]
                self.deliveries_without[node] += 1
            else:
                older = self.age_without[node] + 1
                self.age_without[node] = min(older, oracle.scenario.age.maximum)

    def observation(self) -> list[float]:
        """Eq. `state space` of this AUV, and what the scenario appends to it."""
        oracle, settings = self.oracle, self.oracle.scenario.observation
        own, limited = oracle.auv_cells[self.auv], settings.view_range_m is not None
        if settings.kind == "table":
            known = self.seen_age, self.seen_energy_j
            age, energy_j = known if limited else (oracle.age, oracle.energy_j)
            slots = [(oracle.slot - s) / oracle.scenario.num_slots for s in self.seen_slot]
            return Table(oracle, self.auv, age, energy_j).flat(slots if limited else None)
        seen = self._position(own)
        seen += [self._age(age) for age in (self.seen_age if limited else oracle.age)]
        energies_j = self.seen_energy_j if limited else oracle.energy_j
        seen += [self._energy(energy_j) for energy_j in energies_j]
        if settings.node_positions:
            for cell in oracle.node_cells:
                seen += self._position(cell)
        if settings.time:
            seen.append(oracle.slot / oracle.scenario.num_slots)
        if settings.other_auvs:
            steps = []
            for other in oracle.auvs:
                if other != self.auv:
                    pairs = zip(oracle.auv_cells[other], own, strict=True)
                    steps.append(tuple(theirs - mine for theirs, mine in pairs))
            # Of equally near ones the first in x, y and z.
            here = (0, 0, 0)
            for step in sorted(steps, key=lambda s: (oracle.squared_shortest(s, here), s)):
                seen += self._step(step)
        if limited:
            whole = oracle.scenario.num_slots if self._is_scaled else 1
            seen += [(oracle.slot - slot) / whole for slot in self.seen_slot]
        if settings.agent_index:
            seen += [float(other == self.auv) for other in oracle.auvs]
        for entry in settings.entries:
            if entry.kind == "transit":
                _, slots_left = oracle.transit[self.auv] or (0, 0)
                longest = max(oracle.slots_and_cells(i)[0] for i in range(len(oracle.steps))) - 1
                seen.append(slots_left / (longest if self._is_scaled else 1))
            elif entry.kind == "harvests":
                distances_m = [oracle.distance_m(self.auv, node) for node in oracle.nodes]
                slot_s = oracle.scenario.slot_s
                seen += [self._energy(oracle.sound.harvested_j(m, slot_s)) for m in distances_m]
            elif entry.kind == "current":
                unit = oracle.scenario.vehicle.max_speed_m_per_s
                seen += [each / unit for each in oracle.water.velocity(own)]
            else:
                seen += self._batteries(of_others=entry.kind == "batteries")
        return seen

    def _batteries(self, *, of_others: bool) -> list[float]:
        """Shares left in the own battery, or in those of the others, from the nearest on."""
        oracle = self.oracle
        share = [has_j / oracle.scenario.vehicle.capacity_j for has_j in oracle.vehicles.battery_j]
        if not of_others:
            return [share[self.auv]]
        own = oracle.auv_cells[self.auv]
        found = []
        for other, cell in enumerate(oracle.auv_cells):
            if other != self.auv:
                step = tuple(theirs - mine for theirs, mine in zip(cell, own, strict=True))
                found.append((oracle.squared_shortest(step, (0, 0, 0)), step, other, share[other]))
        return [each for *_, each in sorted(found)]

    @property
    def _is_scaled(self) -> bool:
        return self.oracle.scenario.observation.kind == "scaled"

    def _position(self, cell: tuple[int, int, int]) -> list[float]:
        if not self._is_scaled:
            return [*cell]
        return self._step([coordinate - 1 for coordinate in cell])

    def _step(self, step: Sequence[int]) -> list[float]:
        if not self._is_scaled:
            return [*step]
        cells = self.oracle.scenario.grid.cells
        return [far / max(size - 1, 1) for far, size in zip(step, cells, strict=True)]

    def _age(self, age: float) -> float:
        return age / self.oracle.scenario.age.maximum if self._is_scaled else age

    def _energy(self, energy_j: float) -> float:
        """Beside that of an uplink over half the grid."""
        if not self._is_scaled:
            return energy_j
        oracle = self.oracle
        half_m = oracle.between_m(oracle.scenario.grid.cells, (0, 0, 0)) / 2
        uplink_j = self.oracle.sound.required_j(half_m, self.oracle.scenario.slot_s)
        return energy_j / (energy_j + uplink_j)

    def jain_without(self) -> float:
        squares = math.fsum(n**2 for n in self.deliveries_without)
        total = sum(self.deliveries_without)
        return total**2 / (len(self.oracle.nodes) * squares) if squares else 0.0
