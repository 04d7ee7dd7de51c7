"""What the world is at a moment, and what happened in a slot.

Named tuples: immutable, made in a fraction of the time of a frozen dataclass, and known
to torch's compiler.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

from iout_marl.deprecated import warn_renamed
from iout_marl.physics.arrays import Array

#: Fields of a state that have no nodes where stores have no limits.
STORE_FIELDS = ("spilled_j", "leaked_j", "idle_j", "asleep_slots")
#: Fields of a state that have no AUVs where no move takes longer than a slot.
TRANSIT_FIELDS = ("transit_slots", "course")
#: Fields of a state that have no AUVs where the energy of vehicles has no end.
VEHICLE_FIELDS = (
    *("battery_j", "propulsion_j", "hotel_j", "charging_j", "docked_j"),
    *("distance_m", "stranded_slots"),
)


#: Fields of a state that have no columns where nothing differs from the median.
SEA_FIELDS = ("gain_db", "gust_m_per_s", "packets", "wander_m_per_s")


class State(NamedTuple):
    """A batch of environments between two slots. Shapes are (envs, auvs, nodes) in this order."""

    slot: Array  # (envs,) int: slots that are over
    cell: Array  # (envs, auvs) int: code of an AUV's cell, see `Grid`; under way the one it leaves
    node_cell: Array  # (envs, nodes) int: code of each node's cell
    age: Array  # (envs, nodes) float, slots: Age of Information A_k
    energy_j: Array  # (envs, nodes) float, J: energy stored
    deliveries: Array  # (envs, nodes) float, count: packets delivered so far, D_t(k)
    mean_age: Array  # (envs,) float, slots: mean age over nodes, (1/K) Σ A_k
    jain: Array  # (envs,) float: Jain's index of the deliveries so far, J_t
    age_sum: Array  # (envs,) float, slots: mean age over nodes, summed over slots, see `Sampling`
    peak_age: Array  # (envs,) float, slots: highest age of any node in any slot, likewise
    capped_ages: Array  # (envs,) float, count: node-slots in which an age would pass A_max
    harvested_j: Array  # (envs,) float, J: energy harvested by all nodes so far
    spent_j: Array  # (envs,) float, J: energy spent on uplinks by all nodes so far
    # What each AUV knows of nodes out of its sight; no nodes where there is no limit.
    seen_age: Array  # (envs, auvs, nodes) float, slots: age when last seen
    seen_energy_j: Array  # (envs, auvs, nodes) float, J: energy stored when last seen
    seen_slot: Array  # (envs, auvs, nodes) float, slots: when that was
    # The network without each AUV; no nodes where rewards are those of the team.
    others_age: Array  # (envs, auvs, nodes) float, slots: age by deliveries to others alone
    others_deliveries: Array  # (envs, auvs, nodes) float, count: packets delivered to others
    # What stores have done so far; no nodes where they have no limits.
    spilled_j: Array  # (envs, nodes) float, J: energy harvested that the store had no room for
    leaked_j: Array  # (envs, nodes) float, J: energy that the store has lost
    idle_j: Array  # (envs, nodes) float, J: energy that the node has drawn beside uplinks
    asleep_slots: Array  # (envs, nodes) float, count: slots that the node has slept through
    # What AUVs have, and what has become of it; no AUVs where their energy has no end.
    battery_j: Array  # (envs, auvs) float, J: energy left in the battery
    propulsion_j: Array  # (envs, auvs) float, J: energy spent on moves so far
    hotel_j: Array  # (envs, auvs) float, J: energy drawn all the time, beside moves and charging
    charging_j: Array  # (envs, auvs) float, J: energy drawn for charging nodes
    docked_j: Array  # (envs, auvs) float, J: energy that docks have given
    distance_m: Array  # (envs, auvs) float, m: the way so far
    stranded_slots: Array  # (envs, auvs) float, count: slots that began with an empty battery
    # What AUVs left undone; no column where they name a node in every slot.
    unasked: Array  # (envs, 1) float, count: slots, summed over AUVs, in which nobody was heard
    # What AUVs polled beside; no column where none polls.
    polled: Array  # (envs, 1) float, count: packets of nodes polled so far, lost ones too
    # Moves that are not over; no columns where none takes longer than a slot.
    transit_slots: Array  # (envs, auvs) int: slots until the move ends; 0 for nobody under way
    course: Array  # (envs, auvs) int: its direction, or the one that was named last
    # (envs, 2) float, m/s along x and y: what chance adds to the current in the slot that begins;
    # no columns where it adds nothing
    wander_m_per_s: Array
    # How the sea differs from its median; no columns where it never does.
    gain_db: Array  # (envs, auvs, nodes) float, dB: what fading adds to levels
    gust_m_per_s: Array  # (envs, 1) float, m/s: wind above its mean, below it less than 0
    # Where packets may get lost; no columns elsewhere.
    packets: Array  # (envs, 3) float, count: sent so far, lost too weak, lost by bit errors
    # What users' metrics add up; no columns where there are none.
    sums: Array  # (envs, metrics) float: each summed over the slots so far

    def map(self, function: Callable[[Array], Array]) -> State:
        """The state with `function` applied to every array."""
        return State(*(function(array) for array in self))


class Events(NamedTuple):
    """What each AUV did in a slot, and what came of it."""

    left_grid: Array  # (envs, auvs) bool: tried to leave the grid
    blocked: Array  # (envs, auvs) bool: stayed, since its move came too near another AUV's
    charged: Array  # (envs, auvs) int: node charged; K for nobody (`auvs.idle_choices`)
    heard: Array  # (envs, auvs) int: node asked for its data; K for nobody
    # (envs, auvs) float: TDD's share of the slot for charging; 0 in FDD, and where nobody is named
    beta: Array
    harvested_j: Array  # (envs, auvs) float, J: energy the node charged has harvested
    available_j: Array  # (envs, nodes) float, J: energy stored when the uplinks begin
    delivered: Array  # (envs, auvs) bool: the node heard has delivered its packet
    spent_j: Array  # (envs, auvs) float, J: energy the node heard has spent
    # Of AUVs; none where the energy of vehicles has no end.
    drawn_j: Array  # (envs, auvs) float, J: energy drawn from the battery
    stranded: Array  # (envs, auvs) bool: the battery was empty, and the AUV did nothing
    # Nodes polled beside, in the order of their packets; no rounds where none is (`hearing`).
    polled: Array  # (envs, auvs, rounds) int: node polled; K for none
    polled_delivered: Array  # (envs, auvs, rounds) bool: it has delivered its packet
    polled_j: Array  # (envs, auvs, rounds) float, J: energy that it has spent
    # Of the packet of the node heard, and of those of nodes polled beside; no columns where none
    # may get lost on its way.
    lost: Array  # (envs, auvs, 1 + rounds) bool: it was sent, and got lost
    # (envs, auvs, 1 + rounds) float, dB: SNR on arrival, less what is required; 0 of none
    excess_db: Array

    @property
    def payable_j(self) -> Array:
        """The name of `available_j` in the version before."""
        warn_renamed("Events.payable_j", "Events.available_j")
        return self.available_j
