"""Networks for node tables in worlds of any size, whatever these show to others."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import World
from iout_marl.world.observation import Observer
from trainers.networks import ActorCritic

#: What a scenario shows to networks that see node tables.
TABLE: dict[str, Any] = {"kind": "table"}


def with_table(scenario: Scenario, observation: dict[str, Any] | None = None) -> Scenario:
    """The scenario with a node table as observation, of nodes as far as its AUVs see them.

    Args:
        scenario: the scenario.
        observation: settings of the table.
    """
    seen = {**(observation or TABLE), "view_range_m": scenario.observation.view_range_m}
    # Networks are no matter to worlds, but might not go together with tables.
    plain: dict[str, Any] = {"training.network": "mlp"}
    return load_scenario(scenario, plain | {"observation": seen})


class SizedNetworks:
    """Networks that see node tables, as they are in one world and another.

    Args:
        network: the networks, of any sizes.
        observation: settings of the table that they were trained on.
    """

    def __init__(self, network: ActorCritic, observation: dict[str, Any] | None = None) -> None:
        self._network = network
        self._observation = observation
        self._known: WeakKeyDictionary[World, tuple[ActorCritic, Observer]] = WeakKeyDictionary()

    def in_world(self, world: World) -> tuple[ActorCritic, Observer]:
        """The networks for a world's sizes, and what sees its states for them."""
        if world not in self._known:
            observer = world.observer
            if observer.layout is None or world.scenario.observation.entries:
                observer = world.observer_as(with_table(world.scenario, self._observation))
            assert observer.layout is not None
            sized = self._network.sized_for(observer.layout, world.action_sizes)
            self._known[world] = sized, observer
        return self._known[world]
