"""Duplexing: how charging and uplink share the slot, and who can pay an uplink."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.core.levels import EnergyLevels, Tables
from iout_marl.core.link import SlotEnergies
from iout_marl.core.reasons import NOT_SENT, Reason
from iout_marl.core.split import Split
from iout_marl.core.whole_levels import WholeLevels
from iout_marl.parts.base import Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import SMALLEST
from iout_marl.whole import is_number, short

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]

_HALVINGS = 42


class Duplex(Part):
    """How charging and uplink share the slot.

    Attributes:
        num_choices: nodes that an AUV names in its action: 2, one to charge and one to hear, or 1
            for both.
        splits_slot: whether the slot is divided in time, so that β says how much of it is for
            charging: 1 where nothing is sent, 0 where nothing is charged.
        name: what it is called where it is shown; None for its kind.
    """

    num_choices: int
    splits_slot: bool = False
    name: str | None = None

    @property
    def has_tables(self) -> bool:
        """Whether it states what a slot does to levels of energy.

        Bounds by energy and travel rely on that.
        """
        return False

    @property
    def label(self) -> str:
        """What it is called where it is shown."""
        label: str = self.name or self.settings.kind
        return label

    @property
    @abstractmethod
    def charging_frequency_khz(self) -> float:
        """Frequency of the sound that charges."""

    @property
    @abstractmethod
    def uplink_frequency_khz(self) -> float:
        """In the middle of the uplink's band."""

    @property
    def uplinks_fill_their_time(self) -> bool:
        """Whether it takes uplinks for the cheaper the longer they last, as Shannon's rate has it.

        Uplinks that take a time of their own do not go with such a part.
        """
        return self.splits_slot

    @property
    def longest_uplink(self) -> float:
        """The largest share of a slot that an uplink can have, above 0."""
        return 1.0

    #: The setting that gives the uplink's frequency.
    uplink_frequency_key: str = "kind"

    @property
    def charging_disturbs_uplinks(self) -> bool:
        """Whether an AUV that charges may be heard by one that listens meanwhile."""
        return False

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        if self.num_choices not in (1, 2):
            raise self.fault(f"num_choices must be 1 or 2, not {short(self.num_choices)}")
        for name in (
            "splits_slot",
            "has_tables",
            "charging_disturbs_uplinks",
            "uplinks_fill_their_time",
        ):
            if not isinstance(getattr(self, name), bool):
                raise self.fault(f"{name} must be True or False, not {short(getattr(self, name))}")
        if not (is_number(self.longest_uplink, SMALLEST) and self.longest_uplink <= 1):
            raise self.fault(
                f"longest_uplink must be above 0 and at most 1, not {short(self.longest_uplink)}"
            )
        for name in ("charging_frequency_khz", "uplink_frequency_khz"):
            if not is_number(getattr(self, name), SMALLEST):
                raise self.fault(f"{name} must be above 0 kHz, not {short(getattr(self, name))}")

    @abstractmethod
    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        """Split the slot, each AUV's by itself: arrays of another shape are (1, links).

        Args:
            charging_offset, uplink_offset: (envs, auvs) offsets to the nodes charged
                and heard.
            stored_j: (envs, auvs) energy of the node heard at the start of the slot.
        """

    @abstractmethod
    def sends(self, split: Split, available_j: Array) -> Array:
        """Whether the node heard sends, (envs, auvs) bool.

        Args:
            split: the slot's split.
            available_j: (envs, auvs) energy of the node heard after charging.
        """

    def needed_j(self) -> Array:
        """The least energy stored with which a node delivers in a slot that charges and hears it.

        By offset, see `Link`, and to 10⁻¹² of the energy of an uplink of a whole slot, which is
        enough in any case.
        """
        xp, link = self.xp, self.world.link
        offset = xp.arange(link.slot_uplink_j.shape[0], device=self.world.backend.device)[None, :]
        harvested_w, high = link.at(link.harvested_w, offset), link.at(link.slot_uplink_j, offset)
        low = xp.zeros_like(high)
        middle = low
        for _ in range(_HALVINGS):
            split = self.split(offset, offset, middle)
            pays = self.sends(split, middle + harvested_w * split.charging_s)
            low, high = xp.where(pays, low, middle), xp.where(pays, middle, high)
            middle = (low + high) / 2
        return high[0]

    def why_silent(self, split: Split, available_j: Array) -> Mapping[Reason, Array]:
        """Why nodes heard do not send, (envs, auvs) bool each; the first that holds counts.

        Asked after a slot, for those who want to see it explained.
        """
        return {NOT_SENT: ~self.sends(split, available_j)}

    def energy_never_binds(self, energies: SlotEnergies) -> bool:  # noqa: ARG002
        """Whether the harvest of any slot surely pays for any uplink, whatever an AUV does."""
        return False

    def search_tables(self, levels: EnergyLevels, offset: Any) -> Tables:
        """What a slot does to a node's level of energy, for the search of bounds.

        Never to a lower level than the world would come to.

        Args:
            levels: the levels.
            offset: (nodes, cells, 1) offsets of an AUV's cell from a node's.
        """
        raise NotImplementedError

    def check_tables(self, levels: WholeLevels, offsets: Integers) -> list[list[list[int]]]:
        """As `search_tables`, for the check of what was found, by other means.

        Returns:
            for each offset a list of levels after each slot's outcome: of charging, of delivery,
            and, where two nodes are named, of both.

        Raises:
            ArithmeticError: energies are no numbers.
        """
        raise NotImplementedError


duplexes: Registry[type[Duplex]] = Registry("duplex", Duplex)
