"""Fading: by what the levels of links change from slot to slot."""

from __future__ import annotations

from typing import Any

from iout_marl.core.chance import Chance, Draw
from iout_marl.core.state import State
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import LARGEST, invalid
from iout_marl.whole import is_number, short


class Fading(Part):
    """What is added to the level of each link between an AUV and a node, the same for a slot.

    It holds for the sound that charges and for uplinks. Nodes do not know it: they set the power of
    their uplinks as if there were none.

    Attributes:
        is_active: whether it ever adds anything. If not, the part is never called.
    """

    is_active: bool = False

    @property
    def most_db(self) -> float:
        """Beyond which gain a harvest rises no further, in dB, above 0."""
        return 0.0

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        """What AUVs can do that they could not without it: one line, as of `Storage`.

        Empty where it can only remove possibilities.
        """
        return f"fading {self.settings.kind!r} raises levels as well as it lowers them"

    def can_only_remove(self, scenario: Scenario) -> bool:
        """Whether all that AUVs can do they could do without it."""
        return not self.what_it_adds(scenario)

    def draws(self, scenario: Scenario) -> dict[str, Draw]:
        if not self.is_active:
            return {}
        return {"fading": Draw("normal", (scenario.num_auvs, scenario.num_nodes))}

    def check(self, scenario: Scenario) -> None:
        if not self.is_active:
            return
        kind = self.settings.kind
        scenario.channel.part.need_physical_levels(("channel", "fading"), f"{kind!r} takes")
        if scenario.duplex.part.uplinks_fill_their_time:
            raise invalid(
                ("channel", "fading"),
                f"{kind!r} makes harvests that a node cannot count on: time division takes "
                "duplex.beta_rule: airtime with it, which sends whatever was harvested if that "
                "is enough",
                beside=("duplex",),
            )

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        if not isinstance(self.is_active, bool):
            raise self.fault(f"is_active must be True or False, not {short(self.is_active)}")
        if self.is_active and not is_number(self.most_db, 0, LARGEST):
            raise self.fault(f"most_db must be 0 or more dB, not {short(self.most_db)}")

    def setup(self, world: Context) -> None:
        super().setup(world)
        backend = world.backend
        self._columns = world.scenario.num_nodes if self.is_active else 0
        self._first_slot: Any = backend.integers(0)

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode, before any slot."""
        shape = (num_envs, self.world.scenario.num_auvs, self._columns)
        return {"gain_db": self.world.backend.zeros(shape)}

    def gain_db(self, state: State, chance: Chance) -> Array:
        """What is added to the levels of a slot, in dB, (envs, auvs, nodes).

        Args:
            state: the state before the slot, whose `gain_db` is that of the slot before, 0 in the
                first one.
            chance: of the slot; all `fading` is 0 where the median is asked for.
        """
        raise NotImplementedError


fadings: Registry[type[Fading]] = Registry("fading", Fading)
