"""Uplink: what a node spends on a packet, and how long that takes."""

from __future__ import annotations

from abc import abstractmethod

import numpy as np

from iout_marl.parts.base import Part
from iout_marl.parts.channel import Channel
from iout_marl.parts.loss import Loss
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import SMALLEST, invalid
from iout_marl.scenario.parts import settings_of_kind
from iout_marl.whole import is_number, short


class Uplink(Part):
    """The packets of the nodes, and the band they are sent in.

    Its arguments are not checked: a scenario may say what physics refuses.

    Attributes:
        fills_its_time: whether packets are sent at Shannon's rate in all the time that there is,
            the cheaper the longer that is. If not, they take what `least_time_s` says.
    """

    fills_its_time: bool = False

    @property
    def loses(self) -> bool:
        """Whether packets that were sent may get lost."""
        return self.loss.loses

    @property
    def loss(self) -> Loss:
        """Which packets get lost, before it belongs to a world."""
        loss: Loss = settings_of_kind("loss", "none").part
        return loss

    @property
    def required_snr_db(self) -> float:
        """Signal over noise in the band that packets need, where they may be lost."""
        raise NotImplementedError

    def excess_db(self, power_per_snr_w: ArrayLike, channel: Channel) -> Array:
        """Signal over noise at the receiver in the median, less `required_snr_db`, in dB.

        Where packets may be lost; of those that cannot be sent it is of no consequence.

        Args:
            power_per_snr_w, channel: as of `required_energy_j`.
        """
        raise NotImplementedError

    @property
    def packet_bits(self) -> float:
        """Size of a packet in bits."""
        bits: float = self.settings.packet_bits
        return bits

    @property
    def bandwidth_hz(self) -> float:
        """Width of the band in Hz."""
        hertz: float = self.settings.bandwidth_hz
        return hertz

    @property
    def has_own_time(self) -> bool:
        """Whether a packet takes a time of its own, so that a slot may have time for another."""
        one_metre = np.ones(1)
        return not self.fills_its_time and bool((self.least_time_s(one_metre, 1) > 0).all())

    def least_time_s(self, distance_m: ArrayLike, num_bands: int) -> Array:  # noqa: ARG002
        """The time that an uplink takes at least, in s, in the shape of the distances.

        Args:
            distance_m: from the node to the AUV.
            num_bands: how many parts the band is divided into, one of which the uplink has.
        """
        return np.zeros_like(distance_m, dtype=np.float64)

    @abstractmethod
    def required_energy_j(
        self,
        power_per_snr_w: ArrayLike,
        distance_m: ArrayLike,
        uplink_s: ArrayLike,
        channel: Channel,
        num_bands: int,
    ) -> Array:
        """Energy that an uplink takes, alone in its band, in J.

        Args:
            power_per_snr_w: power for an SNR of 1 in the uplink's part of the band, see `Channel`.
            distance_m: from the node to the AUV.
            uplink_s: time that there is for it, in s, above 0.
            channel: the channel.
            num_bands: how many parts the band is divided into, one of which the uplink has.

        Returns:
            energy in the broadcast shape of the first three; infinite where no packet can arrive.
        """

    def check(self, scenario: Scenario) -> None:
        """Refuse parts that weigh the time of an uplink by Shannon's rate, where it is not that."""
        self.loss.check(scenario)
        if self.fills_its_time:
            return
        kind, access = self.settings.kind, scenario.channel.part.access
        if scenario.duplex.part.uplinks_fill_their_time:
            raise invalid(
                ("uplink", "kind"),
                f"{kind!r} takes a time of its own for a packet, whatever time there is: time "
                "division takes duplex.beta_rule: airtime for it",
                beside=("duplex",),
            )
        if scenario.num_auvs > 1 and access.uplinks_disturb:
            raise invalid(
                ("uplink", "kind"),
                f"{kind!r} does not raise its level against other uplinks: for several AUVs "
                f"channel.access must be orthogonal or exclusive, not {access.settings.kind!r}",
                beside=("channel", "access"),
            )

    def check_stated(self, scenario: Scenario) -> None:
        if not isinstance(self.fills_its_time, bool):
            raise self.fault(
                f"fills_its_time must be True or False, not {short(self.fills_its_time)}"
            )
        for name in ("packet_bits", "bandwidth_hz"):
            if not is_number(getattr(self, name), SMALLEST):
                raise self.fault(f"{name} must be above 0, not {short(getattr(self, name))}")
        metres = np.array([0.0, 1.0, 2.0]) * max(scenario.grid.edges_m)
        watts, channel = np.array([1e-3, 1.0, 2.0]), scenario.channel.part
        with np.errstate(all="ignore"):
            for name, values in {
                "least_time_s": self.least_time_s(metres, 1),
                "required_energy_j": self.required_energy_j(
                    watts, metres, scenario.slot_s, channel, 1
                ),
            }.items():
                found = np.asarray(values)
                if found.shape != metres.shape or found.dtype.kind not in "fiu":
                    raise self.fault(
                        f"{name} must give a number for each of 3 distances, not {short(values)}"
                    )
                if np.isnan(found).any() or (found < 0).any():
                    raise self.fault(f"{name} must be from 0, not {short(values)}")


uplinks: Registry[type[Uplink]] = Registry("uplink", Uplink)
