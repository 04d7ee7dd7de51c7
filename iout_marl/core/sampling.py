"""Sampling: when the data in a packet are from, and when ages are read."""

from __future__ import annotations

from iout_marl.arrays.backend import Backend
from iout_marl.core.link import Link
from iout_marl.core.split import Split
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario


class Sampling:
    """How `age.sampling` has ages read.

    With `slot_end` a node that delivers is 1 slot old at the end of it, and ages are read there.
    With `packet_start` its data are from when the packet began. An AUV's packets follow one
    another without a gap, the last ends with the slot, and all count from there on; ages are
    integrated over time, along which they grow evenly.

    Args:
        scenario: the scenario.
        link: its links, which know what time uplinks take.
        backend: arrays to work with.
    """

    def __init__(self, scenario: Scenario, link: Link, backend: Backend) -> None:
        self.is_continuous = scenario.age.is_continuous
        self._xp = backend.xp
        self._link = link
        self._maximum_age = backend.floats(float(scenario.age.maximum))
        self._one = backend.floats(1.0)
        self._nothing = backend.floats(0.0)

    def reset_to(self, split: Split, heard_offset: Array) -> Array:
        """Ages of packets as they arrive, less the slot by which all ages grow: (envs, auvs).

        Args:
            split: the slot's split.
            heard_offset: (envs, auvs) how the nodes heard lie to the AUVs, see `Link`.
        """
        least_s = self._link.at(self._link.least_uplink_s, heard_offset)
        uplink_s = self._xp.where(least_s > self._nothing, least_s, split.uplink_s)
        return self.reset_to_s(uplink_s)

    def reset_to_s(self, age_s: Array) -> Array:
        """As `reset_to`, of packets that began so many seconds before the end of the slot."""
        return age_s / self._link.slot_s - self._one

    def counted(self, before: Array, after: Array) -> Array:
        """What a slot adds to the sum of ages, by ages before and after it: (…, nodes) each."""
        if not self.is_continuous:
            return after
        growing = self._growing(before)
        return before + growing - growing * growing / 2

    def highest(self, before: Array, after: Array) -> Array:
        """The highest ages within a slot, by those before and after it: (…, nodes) each."""
        return before + self._growing(before) if self.is_continuous else after

    def _growing(self, before: Array) -> Array:
        """For what share of the slot ages grow, until they reach A_max."""
        return self._xp.minimum(self._maximum_age - before, self._one)
