"""What worlds of one scenario work out of it whatever the number of their environments."""

from __future__ import annotations

from weakref import WeakValueDictionary

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.core.link import Link
from iout_marl.scenario import Scenario
from iout_marl.world.motion import Mover


class Tables:
    """The grid, its links and its moves, which nothing changes.

    Args:
        scenario: the scenario.
        backend: arrays to work with.

    Raises:
        InputError: as by `Link`.
    """

    def __init__(self, scenario: Scenario, backend: Backend) -> None:
        self.grid = Grid.from_scenario(scenario)
        self.link = Link(scenario, self.grid, backend)
        self.motion = Mover(scenario, self.grid, backend)

    @classmethod
    def shared(cls, scenario: Scenario, backend: Backend) -> Tables:
        """Those of another world of the scenario as long as there is one, else new ones.

        Raises:
            InputError: as by `Link`.
        """
        found = _IN_USE.get((scenario, backend))
        if found is None:
            found = _IN_USE[scenario, backend] = cls(scenario, backend)
        return found


_IN_USE: WeakValueDictionary[tuple[Scenario, Backend], Tables] = WeakValueDictionary()
