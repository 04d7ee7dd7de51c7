"""The oracle's batteries: what AUVs spend, what docks give them, and which are stranded."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oracle import Cell, Oracle


class Vehicles:
    """The batteries of the AUVs over an episode; where there are none, this does nothing."""

    def __init__(self, oracle: Oracle) -> None:
        self.oracle = oracle
        self.settings = oracle.scenario.vehicle
        self.is_limited = self.settings.kind == "battery"
        count = oracle.scenario.num_auvs
        self.propulsion_j, self.hotel_j, self.charging_j = ([0.0] * count for _ in range(3))
        self.docked_j, self.distance_m = [0.0] * count, [0.0] * count
        self.stranded_slots = [0] * count
        self.battery_j: list[float] = []
        if self.is_limited:
            self.battery_j = [self.settings.initial_share * self.settings.capacity_j] * count
        # Of the slot: AUVs that are stranded, that cannot pay for their move, or for charging,
        # and that are recharged; what each has drawn.
        self.stranded: set[int] = set()
        self.halted: set[int] = set()
        self.refused: set[int] = set()
        self.docked: set[int] = set()
        self.drawn_j = [0.0] * count
        self.before: list[Cell] = []
        self.directions = [0] * count

    def begin(self) -> None:
        """Hotel load; an AUV that has not so much names nobody, and all it has is gone."""
        self.stranded, self.halted, self.refused, self.docked = set(), set(), set(), set()
        self.drawn_j = [0.0 for _ in self.drawn_j]
        self.before = list(self.oracle.auv_cells)
        if not self.is_limited:
            return
        asked_j = self.settings.hotel_w * self.oracle.scenario.slot_s
        for auv, has_j in enumerate(self.battery_j):
            paid_j = asked_j
            if has_j < asked_j or has_j == 0:
                self.stranded.add(auv)
                self.stranded_slots[auv] += 1
                event = self.oracle.events[auv]
                event.charged = event.heard = self.oracle.nobody
                paid_j = has_j
            self.draw(auv, paid_j, self.hotel_j)

    def draw(self, auv: int, energy_j: float, cause_j: list[float]) -> None:
        self.battery_j[auv] -= energy_j
        self.drawn_j[auv] += energy_j
        cause_j[auv] += energy_j

    def move_j(self, way_m: float) -> float:
        """Quadratic drag at the speed with which a way takes the whole slot, in sea water."""
        return self.speed_j(way_m / self.oracle.scenario.slot_s)

    def speed_j(self, speed: float) -> float:
        """The same at a speed through the water."""
        way_m, hull = speed * self.oracle.scenario.slot_s, self.settings
        drag_n = 1025 / 2 * hull.drag_coefficient * hull.drag_area_m2 * speed**2
        return drag_n * way_m / hull.propulsion_efficiency

    def made_good_j(self, auv: int, target: Cell, way_m: float) -> float:
        """What the propulsion takes for a slot's way, in a current no more than there is."""
        water, here = self.oracle.water, self.before[auv]
        if not water.flows:
            return self.move_j(way_m)
        if auv in self.stranded | water.drifting or (here == target and water.moored(here)):
            return 0.0
        slots = 1 if here == target else self.oracle.slots_and_cells(self.directions[auv])[0]
        return min(self.speed_j(water.speed(here, target, slots)), self.battery_j[auv])

    def way_m(self, auv: int, target: Cell) -> float:
        """The way of this slot, of a move to a cell that may take several."""
        here = self.before[auv]
        if here == target:
            return 0.0
        if auv in self.oracle.water.drifting:
            return self.oracle.between_m(here, target)
        slots, _ = self.oracle.slots_and_cells(self.directions[auv])
        return self.oracle.between_m(here, target) / slots

    def destination(self, auv: int, direction: int) -> Cell:
        """Where a move ends that nobody stops."""
        cell = self.before[auv]
        for _ in range(self.oracle.slots_and_cells(direction)[1]):
            cell, _ = self.oracle.ahead(cell, direction)
        return cell

    def can_move(self, auv: int, direction: int) -> bool:
        """Whether an AUV moves, or goes on with its move, or tries to leave the grid."""
        self.directions[auv] = direction
        if auv in self.stranded:
            return False
        if self.oracle.water.flows:
            slots, target = (
                self.oracle.slots_and_cells(direction)[0],
                self.destination(auv, direction),
            )
            return self.oracle.water.can(auv, self.before[auv], target, slots)
        if not self.is_limited:
            return True
        if self.battery_j[auv] < self.move_j(self.way_m(auv, self.destination(auv, direction))):
            self.halted.add(auv)
            return False
        return True

    def pay_for_moves(self) -> None:
        if not self.is_limited:
            return
        for auv, cell in enumerate(self.oracle.auv_cells):
            under_way = self.oracle.transit[auv]
            target = self.destination(auv, under_way[0]) if under_way else cell
            way_m = self.way_m(auv, target)
            self.distance_m[auv] += way_m
            self.draw(auv, self.made_good_j(auv, target, way_m), self.propulsion_j)

    def pay_for_charging(self) -> None:
        """An AUV that has too little charges nobody, and in TDD hears nobody then."""
        if not self.is_limited:
            return
        scenario = self.oracle.scenario
        for auv, event in enumerate(self.oracle.events):
            if event.charged == self.oracle.nobody:
                continue
            share = 1.0 if scenario.duplex.kind == "fdd" else event.beta
            asked_j = share * scenario.slot_s * scenario.charging.power_w
            if self.battery_j[auv] >= asked_j:
                self.draw(auv, asked_j, self.charging_j)
                continue
            self.refused.add(auv)
            event.charged, event.beta = self.oracle.nobody, 0.0
            if scenario.duplex.kind == "tdd":
                event.heard = self.oracle.nobody

    def dock(self) -> None:
        """At the end of the slot: AUVs in docks are recharged, as far as there is room."""
        if not self.is_limited:
            return
        for auv, cell in enumerate(self.oracle.auv_cells):
            if self.oracle.transit[auv]:
                continue
            if cell in [tuple(dock) for dock in self.settings.docks]:
                given_j = self.settings.dock_power_w * self.oracle.scenario.slot_s
                given_j = min(given_j, self.settings.capacity_j - self.battery_j[auv])
                self.battery_j[auv] += given_j
                self.docked_j[auv] += given_j
                if given_j > 0:
                    self.docked.add(auv)

    def metrics(self) -> dict[str, float]:
        """Figures of the episode so far."""
        if not self.is_limited:
            return {}
        count = len(self.battery_j)
        spent_j = math.fsum((*self.propulsion_j, *self.hotel_j, *self.charging_j))
        return {
            "packet_wh": spent_j / 3600 / max(sum(self.oracle.deliveries), 1),
            "charging_kj_per_j": sum(self.charging_j) / 1000 / max(self.oracle.harvested_j, 1),
            "distance_m": math.fsum(self.distance_m),
            "propulsion_kj": sum(self.propulsion_j) / 1000,
            "hotel_kj": sum(self.hotel_j) / 1000,
            "charging_kj": sum(self.charging_j) / 1000,
            "docked_kj": sum(self.docked_j) / 1000,
            "battery_share": sum(self.battery_j) / count / self.settings.capacity_j,
            "stranded_share": sum(self.stranded_slots) / count / self.oracle.slot,
        }

    def reward_terms(self) -> dict[str, list[float]]:
        """What energy and an empty battery cost in the slot just stepped."""
        reward = self.oracle.scenario.reward
        if not self.is_limited:
            return {}
        terms = {}
        if reward.vehicle_energy_penalty_per_kj:
            weight = -reward.vehicle_energy_penalty_per_kj / 1000
            terms["vehicle_energy"] = [weight * drawn_j for drawn_j in self.drawn_j]
        if reward.stranded_penalty:
            terms["stranded"] = [
                -reward.stranded_penalty * (auv in self.stranded)
                for auv in range(len(self.drawn_j))
            ]
        return terms
