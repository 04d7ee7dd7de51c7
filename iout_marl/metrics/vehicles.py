"""Metrics of vehicles that can run out of energy."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iout_marl.metrics.metric import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario

if TYPE_CHECKING:
    from iout_marl.world import State, World

SECONDS_PER_HOUR = 3600.0
#: What AUVs spend energy on, see `State`.
CAUSES = ("propulsion", "hotel", "charging")


def _over_auvs(world: World, values: Array) -> Array:
    return world.backend.xp.sum(values, axis=1)


def _battery_share(world: World, state: State) -> Array:
    return _over_auvs(world, state.battery_j) / (world.num_auvs * world.vehicle.capacity_j)


def _stranded_share(world: World, state: State) -> Array:
    return _over_auvs(world, state.stranded_slots) / (world.slots_over(state) * world.num_auvs)


def _has_limited_vehicles(scenario: Scenario) -> bool:
    return bool(scenario.vehicle.part.is_limited)


def _energy_of_auvs(cause: str, definition: str, title: str = "") -> Metric:
    """Energy of all AUVs by a cause, the field `{cause}_j` of the state."""
    title = title or f"Energy for {cause}"
    return Metric(
        f"{cause}_kj",
        lambda world, state: _over_auvs(world, getattr(state, f"{cause}_j")) / 1000,
        definition=definition,
        unit="kJ",
        heading=f"{cause} kJ",
        axis_title=f"{title} in kJ",
        title=title,
        tag=f"vehicle/{cause}_kj",
        low=0.0,
        applies=_has_limited_vehicles,
    )


def _packet_wh(world: World, state: State) -> Array:
    delivered = world.nodes.sum(state.deliveries)
    drawn_j = sum(_over_auvs(world, getattr(state, f"{cause}_j")) for cause in CAUSES)
    return drawn_j / SECONDS_PER_HOUR / _at_least_one(world, delivered)


def _charging_price(world: World, state: State) -> Array:
    return _over_auvs(world, state.charging_j) / 1000 / _at_least_one(world, state.harvested_j)


def _at_least_one(world: World, values: Array) -> Array:
    xp = world.backend.xp
    return xp.maximum(values, xp.ones_like(values))


#: Of scenarios whose AUVs can run out of energy.
OF_VEHICLES = (
    Metric(
        "distance_m",
        lambda world, state: _over_auvs(world, state.distance_m),
        definition="Distance that all AUVs have travelled.",
        unit="m",
        heading="distance m",
        axis_title="Distance travelled in m",
        title="Distance travelled",
        tag="vehicle/distance_m",
        digits=0,
        low=0.0,
        applies=_has_limited_vehicles,
    ),
    _energy_of_auvs("propulsion", "Energy that all AUVs have spent on moves."),
    _energy_of_auvs(
        "hotel",
        "Energy that all AUVs have drawn beside propulsion and charging.",
        title="Energy for hotel load",
    ),
    _energy_of_auvs("charging", "Energy that all AUVs have drawn for charging nodes."),
    _energy_of_auvs(
        "docked", "Energy that docks have given to all AUVs.", title="Energy from docks"
    ),
    Metric(
        "battery_share",
        _battery_share,
        definition="Share of their batteries that AUVs have left at the end of the episode.",
        unit="",
        heading="battery left",
        axis_title="Share of the battery left",
        title="Battery left",
        tag="vehicle/battery_share",
        digits=3,
        better="more",
        low=0.0,
        high=1.0,
        applies=_has_limited_vehicles,
    ),
    Metric(
        "stranded_share",
        _stranded_share,
        definition="Share of the AUVs' slots in which their battery was empty.",
        unit="",
        heading="stranded",
        axis_title="Share of AUV-slots stranded",
        title="AUVs stranded",
        tag="vehicle/stranded_share",
        digits=3,
        better="less",
        low=0.0,
        high=1.0,
        applies=_has_limited_vehicles,
    ),
    Metric(
        "packet_wh",
        _packet_wh,
        definition="Energy that all AUVs have drawn, for each packet delivered; where none was, as "
        "if one had been.",
        unit="Wh",
        heading="Wh a packet",
        axis_title="Energy of the AUVs in Wh a packet",
        title="Energy for a packet",
        tag="vehicle/packet_wh",
        better="less",
        low=0.0,
        applies=_has_limited_vehicles,
    ),
    Metric(
        "charging_kj_per_j",
        _charging_price,
        definition="Energy that AUVs have drawn for charging, for each joule that nodes have "
        "harvested; where that is less than one, as if it were one.",
        unit="kJ/J",
        heading="kJ a joule",
        axis_title="Price of charging in kJ a joule harvested",
        title="Price of charging",
        tag="vehicle/charging_kj_per_j",
        better="less",
        low=0.0,
        applies=_has_limited_vehicles,
    ),
)
