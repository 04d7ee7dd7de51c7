"""Levels that stay."""

from iout_marl.parts.fading.base import Fading, fadings
from iout_marl.scenario import Scenario


@fadings.register("none")
class NoFading(Fading):
    """Levels are what the distance makes them, in every slot."""

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        return ""
