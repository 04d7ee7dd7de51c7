"""Stores that hold everything."""

from iout_marl.parts.storage.base import Rest, Storage, storages
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario


@storages.register("unlimited")
class Unlimited(Storage):
    """A store that is empty at first, holds whatever is harvested, and loses nothing."""

    is_limited = False

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        return ""

    def rest(self, energy_j: Array) -> Rest:
        return Rest(energy_j, self._zero * energy_j, self._zero * energy_j)
