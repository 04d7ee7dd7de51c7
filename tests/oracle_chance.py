"""The oracle's sea that changes: shadowing, wind and packets that get lost, number by number.

Fed with the numbers that are drawn, one slot after the other. Three functions are rounded in the
package as its documentation says: what a harvest loses to whole thousandths of a dB, upwards; what
a packet arrives with to hundredths of a dB; the root of the wind to thousandths.
"""

from __future__ import annotations

import csv
import io
import itertools
import math
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from oracle import Oracle


class Sea:
    """What differs from the median in an episode, and what became of its packets."""

    def __init__(self, oracle: Oracle) -> None:
        self.oracle, scenario = oracle, oracle.scenario
        channel, uplink = scenario.channel, scenario.uplink
        self.fading = getattr(channel, "fading", None)
        self.fades = self.fading is not None and self.fading.kind != "none"
        self.loss = getattr(uplink, "loss", None)
        self.loses = self.loss is not None and self.loss.kind != "none"
        self.wind = getattr(channel, "wind", None)
        self.blows = self.loses and self.wind.kind != "steady"
        self.gain_db = [[0.0] * scenario.num_nodes * self.fades for _ in range(scenario.num_auvs)]
        self.gust_m_per_s = [0.0] * (self.blows and self.wind.kind == "gauss_markov")
        self.packets = [0.0, 0.0, 0.0] * self.loses
        self.noise_db, self.arrival = 0.0, None
        #: By AUV and number of the packet: what it lacked, if it got lost.
        self.lost: dict[tuple[int, int], float] = {}

    def begin(self, drawn: dict[str, Any]) -> None:
        """A slot, by what was drawn for it."""
        scenario, slot = self.oracle.scenario, self.oracle.slot
        self.lost = {}
        if self.fades:
            for auv, row in enumerate(self.gain_db):
                for node in self.oracle.nodes:
                    row[node] = self.wandered(
                        row[node], self.fading.sigma_db, self.fading, drawn["fading"][auv][node]
                    )
        if self.loses:
            self.arrival = drawn.get("arrival")
        if self.blows:
            speed = scenario.channel.wind_m_per_s
            if self.wind.kind == "series":
                speed = at(columns(self.wind.file), (slot + 0.5) * scenario.slot_s)
            else:
                gust = self.wandered(
                    self.gust_m_per_s[0], self.wind.sigma_m_per_s, self.wind, drawn["wind"][0]
                )
                self.gust_m_per_s = [gust]
                speed = max(speed + gust, 0.0)
            root = math.floor(math.sqrt(speed) * 1000 + 0.5) / 1000
            sound = self.oracle.sound
            self.noise_db = sound.noise_band_db(root**2) - sound.noise_level_db

    def wandered(self, before: float, sigma: float, part: Any, normal: float) -> float:
        if self.oracle.slot == 0:
            return sigma * normal
        rho = math.exp(-self.oracle.scenario.slot_s / part.coherence_s)
        return rho * before + math.sqrt(1 - rho**2) * sigma * normal

    def harvest_loss_db(self, auv: int, node: int, loss_db: float) -> float:
        """What the sound that charges a node loses in this slot."""
        return math.ceil((loss_db - self.gain_db[auv][node]) * 1000) / 1000

    def arrives(self, auv: int, node: int, number: int) -> bool:
        """Whether a packet that nothing has spoilt is received."""
        if not self.loses:
            return True
        uplink, sound = self.oracle.scenario.uplink, self.oracle.sound
        loss_db = sound.attenuation_db(self.oracle.distance_m(auv, node), sound.uplink_khz)
        room_db = uplink.maximum_source_level_db - sound.noise_level_db - loss_db
        room_db -= uplink.required_snr_db
        excess_db = min(uplink.margin_db, room_db) if uplink.power_control else room_db
        if self.fades:
            excess_db += self.gain_db[auv][node]
        excess_db = math.floor((excess_db - self.noise_db) * 100 + 0.5) / 100
        lost_share = self.lost_share(excess_db + uplink.required_snr_db, excess_db)
        lot = 0.5 if self.arrival is None else self.arrival[auv][number]
        if lot >= lost_share:
            return True
        self.lost[auv, number] = excess_db
        self.packets[1 if excess_db < 0 else 2] += 1
        return False

    def lost_share(self, snr_db: float, excess_db: float) -> float:
        uplink = self.oracle.scenario.uplink
        if self.loss.kind == "threshold":
            return float(excess_db < 0)
        if self.loss.kind == "table":
            return at(columns(self.loss.file), snr_db)
        ratio = 10 ** (snr_db / 10) * uplink.bandwidth_hz / uplink.bit_rate_bps
        return 1 - (1 - math.erfc(math.sqrt(ratio)) / 2) ** uplink.packet_bits

    def metrics(self) -> dict[str, float]:
        if not self.loses:
            return {}
        sent, weak, bits = self.packets
        most = max(sent, 1)
        return {
            "packets_sent": sent,
            "packets_lost": (weak + bits) / most,
            "packets_lost_weak": weak / most,
            "packets_lost_bits": bits / most,
        }


def columns(file: Any) -> list[tuple[float, float]]:
    """The lines of a CSV file of two columns."""
    rows = csv.reader(io.StringIO(file.contents.decode()))
    next(rows)
    return [(float(x), float(y)) for x, y in rows]


def at(lines: list[tuple[float, float]], x: float) -> float:
    """Between the lines evenly, beyond them as at the ends."""
    if x <= lines[0][0]:
        return lines[0][1]
    for (low, before), (high, after) in itertools.pairwise(lines):
        if x <= high:
            return before + (x - low) / (high - low) * (after - before)
    return lines[-1][1]
