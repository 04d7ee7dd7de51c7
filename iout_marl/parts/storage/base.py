"""Storage: what the nodes' energy stores hold, and what they lose.

Within a slot: a store takes in what is harvested, as far as it has room, and spills the rest; the
node pays its uplink; then the store rests, which costs what leaks and what the node itself draws.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import NamedTuple

from iout_marl.core.reasons import ASLEEP, STORE_TOO_SMALL, Reason
from iout_marl.core.state import STORE_FIELDS, State
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array, cast
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import LARGEST, SMALLEST
from iout_marl.whole import is_number, short

_SECONDS_PER_DAY = 86_400


class Rest(NamedTuple):
    """What becomes of stored energy in the rest of a slot; the three add up to what there was."""

    energy_j: Array  # J: left in the store
    leaked_j: Array  # J: lost by the store
    idle_j: Array  # J: drawn by the node, beside uplinks


class Storage(Part):
    """The nodes' energy stores, each of the same kind.

    Attributes:
        is_limited: whether a store spills, loses or begins with any energy. One that does not
            adds nothing to a slot, and a world counts nothing of it.
        initial_j: energy that every store begins an episode with, in J.
        capacity_j: the most that a store holds, in J; None for no limit.
        drain_w: power that a store loses and its node draws, as long as there is any energy.
    """

    is_limited: bool = True
    initial_j: float = 0.0
    capacity_j: float | None = None
    drain_w: float = 0.0

    @property
    def drains(self) -> bool:
        """Whether a node that is left alone runs out of energy."""
        return self.is_limited and self.drain_w > 0

    def survival_days(self, energy_j: Array) -> Array:
        """For how many days this pays for what drains a store, where anything does."""
        return energy_j / (self.drain_w * _SECONDS_PER_DAY)

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        if not isinstance(self.is_limited, bool):
            raise self.fault(f"is_limited must be True or False, not {short(self.is_limited)}")
        if self.capacity_j is not None and not is_number(self.capacity_j, SMALLEST, LARGEST):
            raise self.fault(f"capacity_j must be above 0 J, or None, not {short(self.capacity_j)}")
        if not is_number(self.drain_w, 0, LARGEST):
            raise self.fault(f"drain_w must be 0 or more W, not {short(self.drain_w)}")
        most_j = LARGEST if self.capacity_j is None else self.capacity_j
        if not is_number(self.initial_j, 0, most_j):
            raise self.fault(
                f"initial_j must be from 0 to capacity_j in J, not {short(self.initial_j)}"
            )

    def what_it_adds(self, scenario: Scenario) -> str:  # noqa: ARG002
        """What a node can do that one with an empty store without limits could not.

        One line for the bound by energy and travel, which holds for the latter; empty where a
        store can only remove possibilities.
        """
        return f"storage {self.settings.kind!r} does not state that it does"

    def can_only_remove(self, scenario: Scenario) -> bool:
        """Whether all that nodes can do they could do with empty stores without limits."""
        return not self.what_it_adds(scenario)

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._zero = world.backend.floats(0.0)
        self._columns = world.scenario.num_nodes if self.is_limited else 0

    def filled(self, energy_j: Array) -> Array:
        """What a store holds of an energy that comes together in it, in J; of any shape."""
        return energy_j

    @abstractmethod
    def rest(self, energy_j: Array) -> Rest:
        """What becomes of energies in J, (envs, nodes), from the uplinks to the end of a slot."""

    def sleeps(self, available_j: Array) -> Array:
        """Whether a node is asleep, and sends nothing, by what it has when the uplinks begin.

        Args:
            available_j: energies in J, of any shape.
        """
        return available_j < self._zero

    def permits(self, sends: Array, required_j: Array, come_j: Array, available_j: Array) -> Array:
        """Which uplinks go ahead, of those that the duplex part would have sent.

        The duplex part may have counted on all that is stored and harvested: where some of it has
        been spilled, the store must pay by itself.

        Args:
            sends: (envs, auvs) bool, what the duplex part says.
            required_j: (envs, auvs) energy of the uplink alone in the band.
            come_j, available_j: (envs, auvs) energy of the node heard after charging, before and
                after the store has spilled what it does not hold.
        """
        if not self.is_limited:
            return sends
        pays = (available_j >= come_j) | (required_j <= available_j)
        return sends & pays & ~self.sleeps(available_j)

    def why_silent(self, sends: Array, available_j: Array, permitted: Array) -> dict[Reason, Array]:
        """Why nodes heard do not send, beside what the duplex part says: (envs, auvs) bool each.

        Args:
            sends: what the duplex part says.
            available_j: energy of the node heard after charging.
            permitted: what `permits` leaves of it.
        """
        if not self.is_limited:
            return {}
        return {ASLEEP: self.sleeps(available_j), STORE_TOO_SMALL: sends & ~permitted}

    def accepted_j(self, energy_j: Array, harvested_j: Array) -> Array:
        """What a store that holds some energy takes in of what is harvested, in J."""
        return self.filled(energy_j + harvested_j) - energy_j if self.is_limited else harvested_j

    def most_j(self, harvested_j: float) -> float:
        """The most that a node can have that harvests so much in an episode, in J."""
        most_j = self.initial_j + harvested_j
        return most_j if self.capacity_j is None else min(most_j, self.capacity_j)

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        zeros = self.world.backend.zeros
        nothing = zeros((num_envs, self._columns))
        return {
            "energy_j": zeros((num_envs, self.world.scenario.num_nodes)) + float(self.initial_j),
            **dict.fromkeys(STORE_FIELDS, nothing),
        }

    def after(
        self, state: State, come_j: Array, available_j: Array, left_j: Array
    ) -> dict[str, Array]:
        """Fields of the state after a slot.

        Args:
            state: the state before it.
            come_j, available_j: (envs, nodes) stored energy after charging, before and after the
                store has spilled what it does not hold.
            left_j: (envs, nodes) what uplinks have left of it.
        """
        if not self.is_limited:
            # One by one: a loop over their names would take a twentieth of a slot.
            return {
                "energy_j": left_j,
                "spilled_j": state.spilled_j,
                "leaked_j": state.leaked_j,
                "idle_j": state.idle_j,
                "asleep_slots": state.asleep_slots,
            }
        energy_j, leaked_j, idle_j = self.rest(left_j)
        asleep = cast(self.xp, self.sleeps(available_j), left_j.dtype)
        return {
            "energy_j": energy_j,
            "spilled_j": state.spilled_j + (come_j - available_j),
            "leaked_j": state.leaked_j + leaked_j,
            "idle_j": state.idle_j + idle_j,
            "asleep_slots": state.asleep_slots + asleep,
        }


storages: Registry[type[Storage]] = Registry("storage", Storage)
