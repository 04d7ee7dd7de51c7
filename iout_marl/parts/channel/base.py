"""Channel: what sound loses on its way, and what power an uplink takes."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

import numpy as np
from pydantic import Field

from iout_marl.core.grid import Grid
from iout_marl.core.pairs import Pairs
from iout_marl.parts.absorption import Absorption
from iout_marl.parts.access import Access
from iout_marl.parts.base import Part
from iout_marl.parts.fading import Fading
from iout_marl.parts.wind import Wind
from iout_marl.physics.arrays import Array, ArrayLike
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Section, invalid
from iout_marl.scenario.parts import PartOf, settings_of_kind
from iout_marl.scenario.parts import Settings as PartSettings
from iout_marl.whole import is_number


class Shared(Section):
    """How several AUVs share the uplink's band; one AUV has it to itself in every kind."""

    #: How several AUVs share the band.
    access: Annotated[PartSettings, PartOf("access", is_word=True)] = Field(
        "orthogonal", validate_default=True
    )

    hash_defaults: ClassVar[dict[str, Any]] = {"access": "orthogonal"}


class Channel(Part):
    """The levels of sound along a link.

    Its arguments are not checked: a scenario may say what physics refuses.
    """

    # `access` comes first, where scenarios have always written it.
    class Settings(PartSettings, Shared):
        #: What the water itself takes of the sound.
        absorption: Annotated[PartSettings, PartOf("absorption")] = Field(
            {"kind": "thorp"}, validate_default=True
        )

    settings: Any
    #: Whether levels are in consistent units: those of pressures, so that intensities and watts
    #: follow from them.
    has_physical_levels: bool = False

    @property
    def access(self) -> Access:
        """How AUVs share the band, before it belongs to a world."""
        access: Access = self.settings.access.part
        return access

    @property
    def fading(self) -> Fading:
        """How levels change from slot to slot, before it belongs to a world."""
        fading: Fading = _own(self.settings, "fading", "none")
        return fading

    @property
    def wind(self) -> Wind:
        """How the wind changes, before it belongs to a world."""
        wind: Wind = _own(self.settings, "wind", "steady")
        return wind

    def noise_above_mean_db(
        self, wind_m_per_s: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        """By how much noise in a band is above that of `wind_m_per_s` of the scenario, in dB.

        Of a channel that has a `wind`.

        Args:
            wind_m_per_s: speeds from 0, of any shape.
            frequency_khz: in the middle of the band.
            bandwidth_hz: its width.
        """
        raise NotImplementedError

    def need_physical_levels(self, path: tuple[str, ...], what: str) -> None:
        """Refuse what takes levels in consistent units, where this channel's are none.

        Args:
            path: the key that asks for them.
            what: who takes them, with a verb, for the message.

        Raises:
            pydantic_core.PydanticCustomError: `has_physical_levels` does not hold.
        """
        if not self.has_physical_levels:
            raise invalid(
                path,
                f"{what} levels in consistent units, such as those of channel.kind: sonar, which "
                f"{self.settings.kind!r} does not have",
                beside=("channel", "kind"),
            )

    def alpha_db_per_km(self, frequency_khz: float) -> float:
        """Absorption α(f) in dB/km."""
        absorption: Absorption = self.settings.absorption.part
        return float(absorption.db_per_km(frequency_khz))

    def attenuation_db(self, distance_m: ArrayLike, frequency_khz: float) -> Array:
        """Loss between source and receiver in dB, in the shape of `distance_m`."""
        raise NotImplementedError

    @property
    def charging_noise_db(self) -> float:
        """What is taken off the level of the sound that charges, in dB."""
        return 0.0

    def power_per_snr_w(
        self, distance_m: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        """Power that a node transmits with for an SNR of 1 in its band, in W."""
        raise NotImplementedError

    def pairs(self, grid: Grid) -> Pairs | None:  # noqa: ARG002
        """The pairs of cells that its losses tell apart; None where the distance says all.

        Of a channel that tells pairs apart, `pair_loss_db` and `power_per_snr_after_loss_w` are
        asked in place of `attenuation_db` and `power_per_snr_w`.
        """
        return None

    def pair_loss_db(self, scenario: Scenario, pairs: Pairs, frequency_khz: float) -> Array:
        """Loss between the cells of each pair in dB, (pairs,)."""
        raise NotImplementedError

    def power_per_snr_after_loss_w(
        self, loss_db: ArrayLike, frequency_khz: float, bandwidth_hz: float
    ) -> Array:
        """As `power_per_snr_w`, where sound loses so many dB."""
        raise NotImplementedError

    def as_uplink_w(self, acoustic_w: float) -> float:
        """Power of an uplink, in W, that sounds as loud as a source of so much acoustic power."""
        raise NotImplementedError

    def harvest_db(self) -> dict[str, float]:
        """What keys of the channel add to the level of what is harvested, in dB."""
        return {}

    def check(self, scenario: Scenario) -> None:
        self.access.check(scenario)
        self.settings.absorption.part.check(scenario)
        self.fading.check(scenario)
        self.wind.check(scenario)

    def check_stated(self, scenario: Scenario) -> None:
        if not isinstance(self.has_physical_levels, bool):
            raise self.fault(
                f"has_physical_levels must be True or False, not {self.has_physical_levels!r}"
            )
        if not is_number(self.charging_noise_db):
            raise self.fault(f"charging_noise_db must be a number, not {self.charging_noise_db!r}")
        for key, gain_db in self.harvest_db().items():
            if not is_number(gain_db):
                raise self.fault(f"harvest_db() must map keys to numbers, but {key} to {gain_db!r}")
        watts = self.as_uplink_w(1.0)
        if not is_number(watts, 0):
            raise self.fault(f"as_uplink_w(1.0) must be a number from 0, not {watts!r}")
        distance_m = np.array([0.0, 1.0, 2.0]) * max(scenario.grid.edges_m)
        khz, hertz = scenario.duplex.part.uplink_frequency_khz, scenario.uplink.part.bandwidth_hz
        with np.errstate(all="ignore"):
            for name, values in {
                "attenuation_db": self.attenuation_db(distance_m, khz),
                "power_per_snr_w": self.power_per_snr_w(distance_m, khz, hertz),
            }.items():
                found = np.asarray(values)
                if found.shape != distance_m.shape or found.dtype.kind not in "fiu":
                    raise self.fault(
                        f"{name}: must be a number for each of 3 distances, not {found.dtype} "
                        f"of shape {found.shape}"
                    )
                if np.isnan(found).any():
                    raise self.fault(f"{name}: is not a number at {khz:g} kHz")


def _own(settings: Any, key: str, kind: str) -> Any:
    """The part that a key of the channel names; that of a kind where it has no such key."""
    found = getattr(settings, key, None)
    return settings_of_kind(key, kind).part if found is None else found.part


channels: Registry[type[Channel]] = Registry("channel", Channel)
