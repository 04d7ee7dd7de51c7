"""Credit: whom the network's reward is credited to, the team or each AUV for its part."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

from iout_marl.arrays.backend import Backend
from iout_marl.arrays.nodes import NodeAxis
from iout_marl.core.age import advance
from iout_marl.core.state import State
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario

#: A term of the network: takes ages and deliveries, (…, nodes) each, and gives (…).
NetworkTerm: TypeAlias = Callable[[Array, Array], Array]


class Credit:
    """Team rewards, or difference rewards (Wolpert and Tumer, 2001).

    With `difference` an AUV gets G − G₋ᵢ: the network's term less what it would be had no
    packet ever reached this AUV, all else alike. Ages and deliveries by packets to others
    alone are kept along with the real ones.

    Args:
        scenario: the scenario.
        nodes: gathers and scatters over nodes.
        backend: arrays to work with.
    """

    def __init__(self, scenario: Scenario, nodes: NodeAxis, backend: Backend) -> None:
        self.is_shared = not scenario.reward.part.is_credited_apart
        self._nodes = nodes
        self._backend = backend
        self._shape = (scenario.num_auvs, 0 if self.is_shared else scenario.num_nodes)
        self._initial_age = float(scenario.age.initial)
        self._maximum_age = backend.floats(float(scenario.age.maximum))

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        nothing = self._backend.zeros((num_envs, *self._shape))
        return {"others_age": nothing + self._initial_age, "others_deliveries": nothing}

    def after(
        self,
        state: State,
        age: Array,
        place: Array,
        delivered: Array,
        polled: Array | None = None,
    ) -> dict[str, Array]:
        """Fields of the state after a slot.

        Args:
            state: the state before it.
            age: (envs, nodes) ages after it.
            place: (envs, auvs) places of the nodes heard.
            delivered: (envs, auvs) bool, whether they delivered.
            polled: (envs, auvs, nodes) bool, which nodes polled beside delivered, if any were.
        """
        if self.is_shared:
            return {
                "others_age": state.others_age,
                "others_deliveries": state.others_deliveries,
            }
        xp = self._backend.xp
        # A node delivers to one AUV at most, so that "to another" is "to any, but not to me".
        to_me = self._nodes.flags(place, delivered)
        if polled is not None:
            to_me = to_me | polled
        by_others = xp.any(to_me, axis=1, keepdims=True) & ~to_me
        older, _ = advance(xp, state.others_age, self._maximum_age)
        more = state.others_deliveries + 1
        return {
            "others_age": xp.where(by_others, age[:, None, :], older),
            "others_deliveries": xp.where(by_others, more, state.others_deliveries),
        }

    def share(self, total: Array, term: NetworkTerm, state: State) -> Array:
        """What of a network's term each AUV gets, (envs, auvs).

        Args:
            total: (envs,) the term.
            term: the same as a function of ages and deliveries.
            state: the state after the slot.
        """
        if self.is_shared:
            return self._nodes.broadcast_to_auvs(total)
        return total[:, None] - term(state.others_age, state.others_deliveries)
