"""Duplexing: how charging and uplink share the slot, and who can pay an uplink."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from iout_marl import physics
from iout_marl.arrays.backend import Backend
from iout_marl.core.limits import DEAREST_J, bounded, unheard, unheard_on_numpy
from iout_marl.core.link import Link
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Fdd, Scenario, Tdd


class Split(NamedTuple):
    """How each AUV's slot is split, (envs, auvs) each."""

    beta: Array  # share for charging, as reported: 0 in FDD, which splits nothing
    charging_s: Array  # time for charging, in s
    uplink_s: Array  # time for the uplink, in s; not 0 where nothing is sent
    required_j: Array  # energy of the uplink alone in the band, in J


class Duplex(Protocol):
    """A duplexing part.

    Attributes:
        num_choices: nodes that an AUV names in its action: charged and heard.
    """

    num_choices: int

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        """Split the slot.

        Args:
            charging_offset, uplink_offset: (envs, auvs) offsets to the nodes charged
                and heard.
            stored_j: (envs, auvs) energy of the node heard at the start of the slot.
        """
        ...

    def sends(self, split: Split, payable_j: Array) -> Array:
        """Whether the node heard sends, (envs, auvs) bool.

        Args:
            split: the slot's split.
            payable_j: (envs, auvs) energy of the node heard after charging.
        """
        ...


class FrequencyDivision:
    """Charging and uplink in two bands, both for the whole slot, of any two nodes."""

    num_choices = 2

    def __init__(self, link: Link, shape: tuple[int, int], backend: Backend) -> None:
        self._link = link
        self._no_beta = backend.zeros(shape)
        self._whole_slot_s = backend.zeros(shape) + link.slot_s

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:  # noqa: ARG002
        return Split(
            beta=self._no_beta,
            charging_s=self._whole_slot_s,
            uplink_s=self._whole_slot_s,
            required_j=self._link.at(self._link.slot_uplink_j, uplink_offset),
        )

    def sends(self, split: Split, payable_j: Array) -> Array:
        return payable_j > split.required_j


class TimeDivision:
    """One band and one node: charging for βτ, uplink for the (1 − β)τ that are left.

    A subclass has the rule for β where the energy stored does not pay the uplink alone.
    """

    num_choices = 1

    def __init__(self, duplex: Tdd, scenario: Scenario, link: Link, backend: Backend) -> None:
        self._link = link
        self._xp = backend.xp
        self._zero = backend.floats(0.0)
        self._one = backend.floats(1.0)
        #: What `physics.beta_star` and `smallest_beta` take last: slot, packet, band, bounds.
        self.interval = (
            link.slot_s,
            scenario.uplink.packet_bits,
            link.budget.bandwidth_hz,
            duplex.beta_min,
            duplex.beta_max,
        )

    def sends(self, split: Split, payable_j: Array) -> Array:  # noqa: ARG002
        # The rule for β has seen to it that the uplink is paid wherever there is one.
        return split.beta < 1

    def _required_j(self, power_per_snr_w: Array, beta: Array) -> Array:
        return self._link.budget.required_energy_j(power_per_snr_w, self._uplink_s(beta))

    def _uplink_s(self, beta: Array) -> Array:
        # Where nothing is sent, any duration does: 0 would divide by zero.
        return self._xp.where(beta < 1, (1 - beta) * self._link.slot_s, self._one)


class PaperRule(TimeDivision):
    """β is the root of E_harv(β) = E_req(β), which depends on the distance alone.

    Where there is no root, 0 if the stored energy pays the uplink, else 1.
    """

    @unheard
    def __init__(self, duplex: Tdd, scenario: Scenario, link: Link, backend: Backend) -> None:
        super().__init__(duplex, scenario, link, backend)
        xp = backend.xp
        root = physics.beta_star.unchecked(link.harvested_w, link.power_per_snr_w, *self.interval)
        self._has_root = ~xp.isnan(root)
        #: β and the energy of its uplink by offset; 1, charging only, without a root.
        self._beta_star = xp.where(self._has_root, root, self._one)
        star_uplink_j = self._required_j(link.power_per_snr_w, self._beta_star)
        self._star_uplink_j = bounded(star_uplink_j, 0.0, DEAREST_J)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        xp, link = self._xp, self._link
        slot_uplink_j = link.at(link.slot_uplink_j, uplink_offset)
        only_sends = (stored_j > slot_uplink_j) & ~link.at(self._has_root, charging_offset)
        beta = xp.where(only_sends, self._zero, link.at(self._beta_star, charging_offset))
        star_uplink_j = link.at(self._star_uplink_j, uplink_offset)
        return Split(
            beta=beta,
            charging_s=beta * link.slot_s,
            uplink_s=self._uplink_s(beta),
            required_j=xp.where(only_sends, slot_uplink_j, star_uplink_j),
        )


class StoredRule(TimeDivision):
    """The smallest β of {0} ∪ [β_min, β_max] for which stored and harvested energy pay, else 1."""

    def __init__(self, duplex: Tdd, scenario: Scenario, link: Link, backend: Backend) -> None:
        super().__init__(duplex, scenario, link, backend)
        # What overflows is out of reach: no β pays it, or nothing is sent.
        self._by_store = unheard_on_numpy(backend.xp, self._split)

    def split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        return self._by_store(charging_offset, uplink_offset, stored_j)

    def _split(self, charging_offset: Array, uplink_offset: Array, stored_j: Array) -> Split:
        xp, link = self._xp, self._link
        power_per_snr_w = link.at(link.power_per_snr_w, uplink_offset)
        harvested_w = link.at(link.harvested_w, charging_offset)
        beta = physics.smallest_beta.unchecked(
            stored_j, harvested_w, power_per_snr_w, *self.interval
        )
        beta = xp.where(xp.isnan(beta), self._one, beta)
        only_sends = stored_j > link.at(link.slot_uplink_j, uplink_offset)
        beta = xp.where(only_sends, self._zero, beta)
        return Split(
            beta=beta,
            charging_s=beta * link.slot_s,
            uplink_s=self._uplink_s(beta),
            required_j=self._required_j(power_per_snr_w, beta),
        )


def make_duplex(scenario: Scenario, link: Link, shape: tuple[int, int], backend: Backend) -> Duplex:
    """The duplexing part that a scenario names, for (envs, auvs) of that shape."""
    if isinstance(scenario.duplex, Fdd):
        return FrequencyDivision(link, shape, backend)
    rule = StoredRule if scenario.duplex.beta_rule == "stored" else PaperRule
    return rule(scenario.duplex, scenario, link, backend)
