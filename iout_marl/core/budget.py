"""The acoustic channel of a scenario: physics with the scenario's numbers filled in."""

from __future__ import annotations

from iout_marl import physics
from iout_marl.core.limits import UPLINK_W, bounded, unheard
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.scenario import Scenario


class LinkBudget:
    """What charging brings and an uplink costs, by distance.

    Its arguments are not checked: a scenario may say what physics refuses.

    Args:
        scenario: the scenario, whose channel gives the levels and whose duplex the frequencies.
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._channel = scenario.channel.part
        duplex = scenario.duplex.part
        self.charging_frequency_khz: float = duplex.charging_frequency_khz
        self.uplink_frequency_khz: float = duplex.uplink_frequency_khz
        self._harvester, self._uplink = scenario.harvester.part, scenario.uplink.part
        self._num_bands: int = self._channel.access.num_bands(scenario.num_auvs)
        #: Bandwidth of an uplink in Hz.
        self.bandwidth_hz: float = self._uplink.bandwidth_hz / self._num_bands

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        """Loss between source and receiver in dB, in the shape of `distance_m`."""
        return self._channel.attenuation_db(distance_m, frequency_khz)

    @unheard
    def harvested_power_w(self, distance_m: ArrayLike) -> Array:
        """Power that a node harvests from an AUV `distance_m` away, in W."""
        return self.harvested_after_loss_w(
            self.attenuation_db(distance_m, self.charging_frequency_khz)
        )

    @unheard
    def harvested_after_loss_w(self, loss_db: ArrayLike) -> Array:
        """Power that a node harvests from an AUV whose sound loses so many dB, in W."""
        charging = self._scenario.charging
        source_level = physics.source_level_db.unchecked(
            charging.power_w, charging.efficiency, charging.directivity_index_db
        )
        received = physics.received_level_db.unchecked(
            float(source_level), loss_db, self._channel.charging_noise_db
        )
        return self._harvester.harvested_power_w(received, charging.power_w * charging.efficiency)

    @unheard
    def power_per_snr_w(self, distance_m: ArrayLike) -> Array:
        """Power that a node `distance_m` away transmits with for an SNR of 1, in W."""
        return bounded(self._power_per_snr_w(distance_m), *UPLINK_W)

    @unheard
    def power_per_snr_after_loss_w(self, loss_db: ArrayLike) -> Array:
        """Power for an SNR of 1 of a node whose sound loses so many dB, in W."""
        power_w = self._channel.power_per_snr_after_loss_w(
            loss_db, self.uplink_frequency_khz, self.bandwidth_hz
        )
        return bounded(power_w, *UPLINK_W)

    def _power_per_snr_w(self, distance_m: ArrayLike) -> Array:
        return self._channel.power_per_snr_w(
            distance_m, self.uplink_frequency_khz, self.bandwidth_hz
        )

    def required_energy_j(
        self, power_per_snr_w: ArrayLike, uplink_s: ArrayLike, distance_m: ArrayLike = 0.0
    ) -> Array:
        """Energy that an uplink takes, in J; infinite where no packet can arrive.

        Args:
            power_per_snr_w: power for an SNR of 1, by `power_per_snr_w`.
            uplink_s: time that there is for it, in s, above 0.
            distance_m: how far it goes, which matters where an uplink takes a time of its own.
        """
        return self._uplink.required_energy_j(
            power_per_snr_w, distance_m, uplink_s, self._channel, self._num_bands
        )

    @unheard
    def excess_db(self, power_per_snr_w: ArrayLike) -> Array:
        """Signal over noise on arrival in the median, less what is required, in dB."""
        return self._uplink.excess_db(power_per_snr_w, self._channel)

    def least_uplink_s(self, distance_m: ArrayLike) -> Array:
        """The time that an uplink takes at least, in s; 0 where it takes what there is."""
        return self._uplink.least_time_s(distance_m, self._num_bands)

    @property
    @unheard
    def charging_disturbance_w(self) -> float:
        """Power of an uplink, in W, that would sound as loud as an AUV that charges.

        Off its beam an AUV radiates its acoustic power, without the directivity of the beam.
        """
        charging = self._scenario.charging
        uplink_w: float = self._channel.as_uplink_w(charging.power_w * charging.efficiency)
        return uplink_w
