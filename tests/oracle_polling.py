"""The oracle's polling: packets of several nodes one after the other, AUVs in step."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from oracle import Oracle


class Polls:
    """The rounds of one slot: every AUV's first packet, then every AUV's second one, and so on."""

    def __init__(self, oracle: Oracle, able: list[list[bool]]) -> None:
        self.oracle, self.able = oracle, able
        self.asked: set[int] = set()
        # AUVs that still listen, and the time that each has left.
        self.left_s = {}
        for auv, event in enumerate(oracle.events):
            if event.heard != oracle.nobody:
                self.left_s[auv] = oracle.duration_s(auv) if event.beta < 1 else 0.0
        # What happened: nodes that several AUVs wanted, and that there was no time for.
        self.rivals = self.too_late = 0

    def hear(self, chosen: dict[int, int]) -> None:
        """Pay for all packets of the slot; `chosen` are the nodes that send as chosen, by AUV."""
        oracle = self.oracle
        self.asked = set(chosen.values())
        lasted = {auv: [] for auv in oracle.auvs}
        most = oracle.scenario.hearing.max_nodes_per_slot
        for number in range(min(most, len(oracle.nodes))):
            senders = self.named(chosen if number == 0 else {})
            collided = oracle.scenario.channel.access.kind == "exclusive" and len(senders) > 1
            for auv, event in enumerate(oracle.events):
                node = senders.get(auv)
                is_chosen = number == 0 and auv in chosen
                polled = oracle.nobody if node is None or is_chosen else node
                energy_j = 0.0 if node is None else oracle.packet_j(auv, node)
                event.polled.append(polled)
                arrives = not collided
                if node is not None:
                    oracle.count_sent()
                    place = 0 if is_chosen else 1 + number
                    arrives = arrives and oracle.sea.arrives(auv, node, place)
                event.polled_delivered.append(polled != oracle.nobody and arrives)
                event.polled_j.append(0.0 if polled == oracle.nobody else energy_j)
                if node is None:
                    continue
                if is_chosen:
                    event.delivered, event.spent_j = arrives, energy_j
                oracle.take(node, energy_j)
                lasts_s = oracle.sound.modem_s(oracle.distance_m(auv, node))
                lasted[auv].append((node, lasts_s))
                self.left_s[auv] -= lasts_s
                if collided:
                    del self.left_s[auv]
        for auv, packets in lasted.items():
            since_s = 0.0  # from the end of the slot backwards
            for node, lasts_s in reversed(packets):
                since_s += lasts_s
                oracle.events[auv].began_s[node] = since_s

    def named(self, senders: dict[int, int]) -> dict[int, int]:
        """The nodes that send in a round, by AUV: who has none yet asks its oldest that can pay."""
        oracle, senders = self.oracle, dict(senders)
        while True:
            bids: dict[int, list[int]] = {}
            for auv in self.left_s:
                if auv not in senders and (node := self.oldest(auv)) is not None:
                    bids.setdefault(node, []).append(auv)
            if not bids:
                return senders
            for node, auvs in bids.items():
                self.rivals += len(auvs) > 1
                near = [(oracle.distance_m(a, node), oracle.auv_cells[a], a) for a in auvs]
                senders[min(near)[-1]] = node
                self.asked.add(node)

    def oldest(self, auv: int) -> int | None:
        oracle, best = self.oracle, None
        for node in oracle.nodes:
            if node in self.asked or not self.able[auv][node] or node in oracle.stores.sleeping:
                continue
            if oracle.sound.modem_s(oracle.distance_m(auv, node)) > self.left_s[auv]:
                self.too_late += 1
            elif best is None or oracle.age[node] > oracle.age[best]:
                best = node
        return best
