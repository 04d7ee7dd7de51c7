"""The oracle's stores with limits: what they hold, spill and lose, and which nodes sleep."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oracle import Oracle


class Stores:
    """The nodes' stores over an episode; those without limits do nothing."""

    def __init__(self, oracle: Oracle) -> None:
        self.oracle = oracle
        self.settings = oracle.scenario.storage
        self.is_limited = self.settings.kind == "capacitor"
        self.initial_j = self.settings.initial_j if self.is_limited else 0.0
        count = oracle.scenario.num_nodes
        self.spilled_j, self.leaked_j, self.idle_j = ([0.0] * count for _ in range(3))
        self.asleep_slots = [0] * count
        # Of the slot: nodes that spill, that sleep, that cannot pay their idle draw in the end,
        # and AUVs that a full store keeps waiting.
        self.spilling: set[int] = set()
        self.sleeping: set[int] = set()
        self.starved: set[int] = set()
        self.refused: set[int] = set()

    def fill(self) -> None:
        """After charging: nodes keep what there is room for; those with nothing then sleep."""
        self.spilling, self.sleeping, self.refused = set(), set(), set()
        if not self.is_limited:
            return
        energy_j = self.oracle.energy_j
        for node, stored_j in enumerate(energy_j):
            if stored_j > self.settings.capacity_j:
                self.spilling.add(node)
                self.spilled_j[node] += stored_j - self.settings.capacity_j
                energy_j[node] = self.settings.capacity_j
            if self.settings.idle_w > 0 and stored_j == 0:
                self.sleeping.add(node)
                self.asleep_slots[node] += 1

    def can_send(self, auv: int, node: int) -> bool:
        """Whether a node sends that would by the rule for the slot, which knows of no stores."""
        if node in self.spilling and (self.oracle.alone_j(auv, node) > self.oracle.energy_j[node]):
            self.refused.add(auv)
            return False
        return node not in self.sleeping

    def rest(self) -> None:
        """After the uplinks: stores leak and nodes draw; of too little both get less alike."""
        self.starved = set()
        if not self.is_limited:
            return
        slot_s = self.oracle.scenario.slot_s
        leak_j, draw_j = self.settings.leakage_w * slot_s, self.settings.idle_w * slot_s
        for node, stored_j in enumerate(self.oracle.energy_j):
            asked_j = leak_j + draw_j
            share = 1.0
            if stored_j < asked_j:
                share = stored_j / asked_j
                self.starved.add(node)
            self.leaked_j[node] += share * leak_j
            self.idle_j[node] += share * draw_j
            self.oracle.energy_j[node] = stored_j - asked_j if share == 1 else 0.0

    def metrics(self) -> dict[str, float]:
        """Figures of the episode so far."""
        if not self.is_limited:
            return {}
        node_slots = self.oracle.slot * len(self.asleep_slots)
        return {
            "spilled_j": sum(self.spilled_j),
            "leaked_j": sum(self.leaked_j),
            "idle_j": sum(self.idle_j),
            "asleep_share": sum(self.asleep_slots) / node_slots,
            "stored_j_per_day": (self.oracle.harvested_j - sum(self.spilled_j))
            / (node_slots * self.oracle.scenario.slot_s)
            * 24
            * 3600,
            **self.survival(),
        }

    def survival(self) -> dict[str, float]:
        """Where something drains the stores: for how long what is left would do."""
        storage = self.oracle.scenario.storage
        joules_a_day = (storage.leakage_w + storage.idle_w) * 24 * 3600
        if not joules_a_day:
            return {}
        days = [energy_j / joules_a_day for energy_j in self.oracle.energy_j]
        return {"survival_days": math.fsum(days) / len(days)}
