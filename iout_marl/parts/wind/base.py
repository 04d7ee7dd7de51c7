"""Wind: how the noise of the sea changes over time."""

from __future__ import annotations

from typing import NamedTuple

from iout_marl.core.chance import Chance
from iout_marl.core.state import State
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import LARGEST
from iout_marl.whole import is_number, short


class Blowing(NamedTuple):
    """The wind of a slot."""

    speed_m_per_s: Array  # (envs, 1) from 0
    gust_m_per_s: Array  # (envs, 1), or no column: what is kept in the state


class Wind(Part):
    """The wind over an episode, which is the same everywhere, and makes noise.

    It matters to packets that can get lost: nodes set the power of their uplinks by the
    scenario's `channel.wind_m_per_s`, whatever the wind is.

    Attributes:
        changes: whether it is ever another than that. If not, the part is never called.
        is_drawn: whether it is left to chance.
    """

    changes: bool = False
    is_drawn: bool = False

    def most_m_per_s(self, mean_m_per_s: float) -> float:
        """The highest speed that noise is computed for, with `channel.wind_m_per_s` the mean."""
        return mean_m_per_s

    def matters(self, scenario: Scenario) -> bool:
        """Whether any packet of the scenario can get lost for it."""
        return bool(self.changes and scenario.uplink.part.loses)

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        for name in ("changes", "is_drawn"):
            if not isinstance(getattr(self, name), bool):
                raise self.fault(f"{name} must be True or False, not {short(getattr(self, name))}")
        if not is_number(self.most_m_per_s(5.0), 0, LARGEST):
            raise self.fault(f"most_m_per_s must be from 0, not {short(self.most_m_per_s(5.0))}")

    def setup(self, world: Context) -> None:
        super().setup(world)
        scenario = world.scenario
        self._columns = int(self.is_drawn and self.matters(scenario))

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode, before any slot."""
        return {"gust_m_per_s": self.world.backend.zeros((num_envs, self._columns))}

    def blowing(self, state: State, chance: Chance) -> Blowing:
        """The wind of a slot.

        Args:
            state: the state before the slot, with what was kept of the slot before.
            chance: of the slot.
        """
        raise NotImplementedError


winds: Registry[type[Wind]] = Registry("wind", Wind)
