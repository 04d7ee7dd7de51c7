"""View: what each AUV knows of the nodes when it does not see all of them."""

from __future__ import annotations

from iout_marl.arrays.backend import Backend
from iout_marl.arrays.nodes import NodeAxis
from iout_marl.core.limits import FARTHEST_M
from iout_marl.core.link import Link
from iout_marl.core.state import State
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario


class View:
    """Keeps what each AUV has last seen of every node, where its view is limited.

    An AUV sees the nodes within `observation.view_range_m`, and the one that delivers to it.
    At the start of an episode it knows them all.

    Args:
        scenario: the scenario.
        link: its links, which know distances.
        nodes: gathers and scatters over nodes.
        backend: arrays to work with.
    """

    def __init__(self, scenario: Scenario, link: Link, nodes: NodeAxis, backend: Backend) -> None:
        range_m = scenario.observation.view_range_m
        self.is_limited = range_m is not None
        self._link = link
        self._nodes = nodes
        self._backend = backend
        self._range_m = backend.floats(min(range_m or 0.0, FARTHEST_M))
        self._shape = (scenario.num_auvs, scenario.num_nodes if self.is_limited else 0)
        self._initial_age = float(scenario.age.initial)
        self._initial_j = float(scenario.storage.part.initial_j)

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        nothing = self._backend.zeros((num_envs, *self._shape))
        return {
            "seen_age": nothing + self._initial_age,
            "seen_energy_j": nothing + self._initial_j,
            "seen_slot": nothing,
        }

    def after(
        self,
        state: State,
        cell: Array,
        age: Array,
        energy_j: Array,
        place: Array,
        delivered: Array,
        polled: Array | None = None,
    ) -> dict[str, Array]:
        """Fields of the state after a slot.

        Args:
            state: the state before it.
            cell: (envs, auvs) codes of the AUVs' new cells.
            age, energy_j: (envs, nodes) ages and stored energies after it.
            place: (envs, auvs) places of the nodes heard.
            delivered: (envs, auvs) bool, whether they delivered.
            polled: (envs, auvs, nodes) bool, which nodes polled beside delivered, if any were.
        """
        if not self.is_limited:
            return {
                "seen_age": state.seen_age,
                "seen_energy_j": state.seen_energy_j,
                "seen_slot": state.seen_slot,
            }
        xp = self._backend.xp
        seen = self.sees(cell, state.node_cell) | self._nodes.flags(place, delivered)
        if polled is not None:
            seen = seen | polled
        slot = xp.astype(state.slot + 1, age.dtype)[:, None, None]
        return {
            "seen_age": xp.where(seen, age[:, None, :], state.seen_age),
            "seen_energy_j": xp.where(seen, energy_j[:, None, :], state.seen_energy_j),
            "seen_slot": xp.where(seen, slot, state.seen_slot),
        }

    def age(self, state: State) -> Array:
        """Ages of nodes as each AUV knows them: (envs, auvs, nodes), or (envs, 1, nodes) of all."""
        return state.seen_age if self.is_limited else state.age[:, None, :]

    def energy_j(self, state: State) -> Array:
        """Stored energies alike."""
        return state.seen_energy_j if self.is_limited else state.energy_j[:, None, :]

    def sees(self, cell: Array, node_cell: Array) -> Array:
        """Which nodes are within range: (envs, auvs, nodes) bool."""
        offset = self._link.offset(cell[:, :, None], node_cell[:, None, :])
        return self._link.at(self._link.distance_m, offset) <= self._range_m
