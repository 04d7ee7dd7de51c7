"""Networks for node tables in worlds of any size, whatever these show to others."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World
from iout_marl.world.observation import Observer
from trainers.networks import ActorCritic

#: What a scenario shows to networks that see node tables.
TABLE: dict[str, Any] = {"kind": "table"}


def with_table(scenario: Scenario, observation: dict[str, Any]) -> Scenario:
    """The scenario with a node table as observation, of nodes as far as its AUVs see them.

    Args:
        scenario: the scenario.
        observation: settings of the table.
    """
    seen = {**observation, "view_range_m": scenario.observation.view_range_m}
    # Networks are no matter to worlds, but might not go together with tables.
    plain: dict[str, Any] = {"training.network": "mlp"}
    return load_scenario(scenario, plain | {"observation": seen})


def check_view(who: str, observation: dict[str, Any], scenario: Scenario) -> None:
    """Refuse a scenario whose AUVs know of nodes otherwise than those of a training.

    Where their view has a limit, tables have a column more: how old what an AUV knows is.

    Args:
        who: was trained.
        observation: settings of the table of that training.
        scenario: where it is to play, or to go on.

    Raises:
        InputError: one has a limit and the other has not.
    """
    limit_m = scenario.observation.view_range_m
    was_limited = observation.get("view_range_m") is not None
    if was_limited != (limit_m is not None):
        trained, limit = ("with", "null") if was_limited else ("without", f"{limit_m:g} m")
        raise InputError(
            f"{who}: was trained {trained} observation.view_range_m, which in {scenario.name} is "
            f"{limit}"
        )


class SizedNetworks:
    """Networks that see node tables, as they are in one world and another.

    Args:
        network: the networks, of any sizes.
        who: plays by them.
        observation: settings of the table that they were trained on; None where nobody says.
    """

    def __init__(
        self, network: ActorCritic, who: str, observation: dict[str, Any] | None = None
    ) -> None:
        self._network = network
        self._who = who
        self._observation = observation
        self._known: WeakKeyDictionary[World, tuple[ActorCritic, Observer]] = WeakKeyDictionary()

    def in_world(self, world: World) -> tuple[ActorCritic, Observer]:
        """The networks for a world's sizes, and what sees its states for them.

        Raises:
            InputError: see `check_view`.
        """
        if world not in self._known:
            if self._observation is not None:
                check_view(self._who, self._observation, world.scenario)
            observer = world.observer
            if observer.layout is None or world.scenario.observation.entries:
                seen = with_table(world.scenario, self._observation or TABLE)
                observer = world.observer_as(seen)
            assert observer.layout is not None
            sized = self._network.sized_for(observer.layout, world.action_sizes)
            self._known[world] = sized, observer
        return self._known[world]
