"""Wind by a file."""

from __future__ import annotations

import numpy as np

from iout_marl.core.chance import Chance
from iout_marl.core.grid import Floats
from iout_marl.core.state import State
from iout_marl.errors import InputError
from iout_marl.parts.base import Context
from iout_marl.parts.wind.base import Blowing, Wind, winds
from iout_marl.physics.arrays import lookup
from iout_marl.scenario import Scenario
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import read_curve
from iout_marl.scenario.fields import invalid
from iout_marl.scenario.parts import Settings as PartSettings

#: The strongest wind that is believed, in m/s.
_MOST = 120.0
#: By how much the file may end before the episode, in s: what roundings come to.
_SLACK_S = 1e-6


@winds.register("series")
class Series(Wind):
    """Wind by a file with the columns time_s, from the start of the episode, and wind_m_per_s.

    Between its lines the speed changes evenly; a slot has that of its middle.
    """

    class Settings(PartSettings):
        #: The file, CSV or npz, which covers the episode.
        file: DataFile

    settings: Settings
    changes = True

    def most_m_per_s(self, mean_m_per_s: float) -> float:  # noqa: ARG002
        return float(self._read()[1].max())

    def check(self, scenario: Scenario) -> None:
        try:
            time_s = self._read()[0]
            end_s = scenario.num_slots * scenario.slot_s
            if time_s[0] > _SLACK_S or time_s[-1] < end_s - _SLACK_S:
                raise self.settings.file.fault(
                    f"time_s: reaches from {time_s[0]:g} to {time_s[-1]:g} s, but the episode from "
                    f"0 to {end_s:g} s"
                )
        except InputError as error:
            raise invalid(
                ("channel", "wind", "file"), str(error), beside=("episode", "duration_s")
            ) from None

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario = world.scenario
        by_slot = np.interp(scenario.slot_middles_s, *self._read())
        self._by_slot = world.backend.floats(by_slot)
        self._last = world.backend.integers(scenario.num_slots - 1)

    def blowing(self, state: State, chance: Chance) -> Blowing:  # noqa: ARG002
        # Planners step on when an episode is over.
        slot = self.xp.minimum(state.slot, self._last)
        return Blowing(lookup(self.xp, self._by_slot, slot)[:, None], state.gust_m_per_s)

    def _read(self) -> tuple[Floats, Floats]:
        """Times and speeds.

        Raises:
            InputError: the file has none.
        """
        return read_curve(self.settings.file, ("time_s", "wind_m_per_s"), 0, _MOST)
