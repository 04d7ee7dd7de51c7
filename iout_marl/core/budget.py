"""The acoustic channel of a scenario: physics with the scenario's numbers filled in."""

from __future__ import annotations

import numpy as np

from iout_marl import physics
from iout_marl.core.limits import UPLINK_W, bounded, unheard
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario import Fdd, PaperChannel, Scenario
from iout_marl.scenario.sections import Absorption


def absorption_db_per_km(absorption: Absorption, frequency_khz: ArrayLike) -> Array:
    """α(f) by the formula that a scenario names."""
    if absorption.kind == "thorp":
        return physics.thorp_absorption_db_per_km.unchecked(frequency_khz)
    return physics.francois_garrison_absorption_db_per_km.unchecked(
        frequency_khz,
        absorption.temperature_c,
        absorption.salinity_psu,
        absorption.depth_m,
        absorption.ph,
    )


class LinkBudget:
    """What charging brings and an uplink costs, by distance.

    Its arguments are not checked: a scenario may say what physics refuses.

    Args:
        scenario: the scenario, whose `channel.kind` chooses the convention (`table`,
            `equation` or `sonar`) and whose `duplex` gives the frequencies.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        duplex = scenario.duplex
        if isinstance(duplex, Fdd):
            self.charging_frequency_khz = duplex.charging_frequency_khz
            self.uplink_frequency_khz = duplex.uplink_frequency_khz
        else:
            self.charging_frequency_khz = self.uplink_frequency_khz = duplex.frequency_khz
        shares = scenario.num_auvs if scenario.channel.access == "orthogonal" else 1
        #: Bandwidth of an uplink in Hz.
        self.bandwidth_hz = scenario.uplink.bandwidth_hz / shares

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        """Loss between source and receiver in dB, in the shape of `distance_m`."""
        channel = self._scenario.channel
        alpha = float(absorption_db_per_km(channel.absorption, frequency_khz))
        if channel.kind == "table":
            return physics.table_attenuation_db.unchecked(
                distance_m, alpha, channel.spreading_factor
            )
        return physics.transmission_loss_db.unchecked(distance_m, alpha, channel.spreading_factor)

    @unheard
    def harvested_power_w(self, distance_m: ArrayLike) -> Array:
        """Power that a node harvests from an AUV `distance_m` away, in W."""
        charging, harvester = self._scenario.charging, self._scenario.harvester
        channel = self._scenario.channel
        source_level = physics.source_level_db.unchecked(
            charging.power_w, charging.efficiency, charging.directivity_index_db
        )
        received = physics.received_level_db.unchecked(
            float(source_level),
            self.attenuation_db(distance_m, self.charging_frequency_khz),
            # The paper subtracts the noise from the energy signal; real noise adds power.
            channel.noise_level_db if isinstance(channel, PaperChannel) else 0.0,
        )
        return physics.harvested_power_w.unchecked(
            received,
            harvester.sensitivity_db,
            harvester.load_resistance_ohm,
            harvester.efficiency,
            harvester.hydrophones,
        )

    @unheard
    def power_per_snr_w(self, distance_m: ArrayLike) -> Array:
        """Power that a node `distance_m` away transmits with for an SNR of 1, in W."""
        return bounded(self._power_per_snr_w(distance_m), *UPLINK_W)

    def _power_per_snr_w(self, distance_m: ArrayLike) -> Array:
        channel = self._scenario.channel
        loss = self.attenuation_db(distance_m, self.uplink_frequency_khz)
        if isinstance(channel, PaperChannel):
            return physics.transmit_power_w.unchecked(1.0, loss, channel.noise_level_db)
        noise = physics.ambient_noise_band_level_db.unchecked(
            self.uplink_frequency_khz,
            self.bandwidth_hz,
            channel.shipping,
            channel.wind_m_per_s,
        )
        return physics.sonar_transmit_power_w.unchecked(
            1.0, loss, noise, channel.uplink_efficiency, channel.uplink_directivity_index_db
        )

    def required_energy_j(self, power_per_snr_w: ArrayLike, uplink_s: ArrayLike) -> Array:
        """Energy that an uplink of `uplink_s` seconds takes, in J.

        Args:
            power_per_snr_w: power for an SNR of 1, by `power_per_snr_w`.
            uplink_s: duration in s, above 0.
        """
        uplink = self._scenario.uplink
        snr = physics.required_snr.unchecked(uplink.packet_bits, uplink_s, self.bandwidth_hz)
        return physics.required_energy_j.unchecked(snr * power_per_snr_w, uplink_s)

    @property
    @unheard
    def charging_disturbance_w(self) -> float:
        """Power of an uplink, in W, that would sound as loud as an AUV that charges.

        Off its beam an AUV radiates its acoustic power, without the directivity of the
        beam; uplinks are computed in acoustic power (`table`, `equation`) or in electric power
        through their own projector (`sonar`).
        """
        charging, channel = self._scenario.charging, self._scenario.channel
        acoustic_w = charging.power_w * charging.efficiency
        if isinstance(channel, PaperChannel):
            return acoustic_w
        gain = np.float64(10) ** (channel.uplink_directivity_index_db / 10)
        return float(bounded(acoustic_w / (channel.uplink_efficiency * gain), 0.0, UPLINK_W[1]))
