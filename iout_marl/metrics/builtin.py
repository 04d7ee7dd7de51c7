"""The built-in metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iout_marl.metrics.losses import OF_LOSSES
from iout_marl.metrics.metric import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario

if TYPE_CHECKING:
    from iout_marl.world import State, World


def _age_violations(_: World, state: State) -> Array:
    return state.capped_ages


def _jain_violation(world: World, state: State) -> Array:
    below = state.jain < world.scenario.fairness.minimum_jain
    return world.backend.xp.astype(below, state.age.dtype)


def _uplink_success(world: World, state: State) -> Array:
    asked = world.slots_over(state) * world.num_auvs
    if world.hearing.polls:
        asked = asked + state.polled[:, 0]
    if world.may_be_idle:
        # Where nobody has been asked so far, nothing has arrived: 0 of 1.
        xp = world.backend.xp
        asked = xp.maximum(asked - state.unasked[:, 0], xp.ones_like(asked))
    return world.nodes.sum(state.deliveries) / asked


def _asleep_share(world: World, state: State) -> Array:
    return world.nodes.sum(state.asleep_slots) / (world.slots_over(state) * world.num_nodes)


def _survival_days(world: World, state: State) -> Array:
    return world.nodes.sum(world.storage.survival_days(state.energy_j)) / world.num_nodes


def _has_limited_stores(scenario: Scenario) -> bool:
    return bool(scenario.storage.part.is_limited)


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


def _node_days(world: World, state: State) -> Array:
    return world.slots_over(state) * (world.link.slot_s / SECONDS_PER_DAY * world.num_nodes)


def _reward(world: World, total: Array) -> Array:
    return world.backend.xp.mean(total, axis=1)


SECONDS_PER_HOUR, SECONDS_PER_DAY = 3600.0, 86400.0
#: What AUVs spend energy on, see `State`.
CAUSES = ("propulsion", "hotel", "charging")

#: The built-in metrics of every world, in the order of reports.
BUILTIN = (
    Metric(
        "mean_aoi",
        lambda world, state: state.age_sum / world.slots_over(state),
        definition="Age of Information, averaged over nodes and over the slots of the episode.",
        unit="slots",
        symbol="Ā",
        heading="mean AoI",
        axis_title="Mean AoI in slots",
        title="Mean Age of Information",
        tag="aoi/mean",
        better="less",
        low=0.0,
        is_positive=True,
        has_curve=True,
    ),
    Metric(
        "final_aoi",
        lambda _, state: state.mean_age,
        definition="Age of Information at the end of the episode, averaged over nodes.",
        unit="slots",
        symbol="Ā(T)",
        heading="final AoI",
        axis_title="Final AoI in slots",
        title="Age of Information at the end",
        tag="aoi/final",
        better="less",
        low=0.0,
        is_positive=True,
    ),
    Metric(
        "peak_aoi",
        lambda _, state: state.peak_age,
        definition="Highest Age of Information of any node in any slot.",
        unit="slots",
        symbol="max A_k(t)",
        heading="peak AoI",
        axis_title="Peak AoI in slots",
        title="Peak Age of Information",
        tag="aoi/peak",
        digits=1,
        better="less",
        low=0.0,
        is_positive=True,
    ),
    Metric(
        "jain",
        lambda _, state: state.jain,
        definition="Jain's index of the packets that each node has delivered: 1 where all have "
        "delivered as many, 1/K where one has delivered all, 0 before any delivery.",
        unit="",
        symbol="J",
        heading="Jain",
        axis_title="Jain's index",
        title="Fairness",
        tag="fairness/jain",
        digits=3,
        better="more",
        low=0.0,
        high=1.0,
        has_curve=True,
    ),
    Metric(
        "harvested_kj",
        lambda _, state: state.harvested_j / 1000,
        definition="Energy that all nodes have harvested.",
        unit="kJ",
        heading="harvested kJ",
        axis_title="Energy harvested in kJ",
        title="Energy harvested",
        tag="energy/harvested_kj",
        better="more",
        low=0.0,
        has_curve=True,
    ),
    Metric(
        "uplink_success",
        _uplink_success,
        definition="Share of the AUVs' slots in which a packet was delivered; slots in which an "
        "AUV asked nobody do not count. Where AUVs poll, each packet of a further node counts as "
        "one more.",
        unit="",
        heading="uplinks",
        axis_title="Uplinks that arrive",
        title="Uplinks that arrive",
        tag="uplink/success_rate",
        digits=3,
        better="more",
        low=0.0,
        high=1.0,
    ),
    Metric(
        "reward",
        _reward,
        computed_from="rewards",
        definition="Undiscounted return of an AUV, averaged over AUVs; `reward/total` is its mean "
        "a slot.",
        unit="",
        heading="reward",
        axis_title="Return of an AUV",
        title="Return",
        tag="reward/total",
        curve_title="Mean reward of a slot",
        digits=1,
        better="more",
        has_curve=True,
    ),
    Metric(
        "spent_kj",
        lambda _, state: state.spent_j / 1000,
        definition="Energy that all nodes have spent on uplinks.",
        unit="kJ",
        heading="spent kJ",
        axis_title="Energy spent in kJ",
        title="Energy spent",
        tag="energy/spent_kj",
        low=0.0,
        in_table=False,
    ),
    Metric(
        "age_violations",
        _age_violations,
        definition="Node-slots in which an age would have passed A_max, at which it stops.",
        unit="node-slots",
        heading="ages above A_max",
        axis_title="Ages above A_max",
        title="Ages above A_max",
        tag="constraints/age_violations",
        digits=1,
        better="less",
        low=0.0,
        in_table=False,
    ),
    Metric(
        "jain_violation",
        _jain_violation,
        definition="1 where Jain's index ends below J_min, else 0.",
        unit="",
        heading="below J_min",
        axis_title="Episodes below J_min",
        title="Episodes below J_min",
        tag="constraints/jain_violation",
        better="less",
        low=0.0,
        high=1.0,
        in_table=False,
    ),
)

#: Of scenarios that set the length of a slot or read ages over time: seconds say there what slots
#: do not. Elsewhere a slot follows from the grid, and records of before have no such metric.
OF_TIME = (
    Metric(
        "mean_aoi_s",
        lambda world, state: state.age_sum / world.slots_over(state) * world.link.slot_s,
        definition="Age of Information, averaged over nodes and over the time of the episode.",
        unit="s",
        symbol="Ā τ",
        heading="mean AoI s",
        axis_title="Mean AoI in s",
        title="Mean Age of Information in seconds",
        tag="aoi/mean_s",
        better="less",
        low=0.0,
        is_positive=True,
        applies=lambda scenario: scenario.episode.slot_s is not None or scenario.age.is_continuous,
    ),
)

#: Of scenarios whose stores have limits; elsewhere nothing is spilled or lost, and no node sleeps.
OF_STORES = (
    Metric(
        "spilled_j",
        lambda world, state: world.nodes.sum(state.spilled_j),
        definition="Energy that nodes have harvested, but had no room for in their stores.",
        unit="J",
        heading="spilled J",
        axis_title="Energy spilled in J",
        title="Energy spilled",
        tag="energy/spilled_j",
        better="less",
        low=0.0,
        applies=_has_limited_stores,
    ),
    Metric(
        "leaked_j",
        lambda world, state: world.nodes.sum(state.leaked_j),
        definition="Energy that all stores have lost.",
        unit="J",
        heading="leaked J",
        axis_title="Energy leaked in J",
        title="Energy leaked",
        tag="energy/leaked_j",
        low=0.0,
        applies=_has_limited_stores,
    ),
    Metric(
        "idle_j",
        lambda world, state: world.nodes.sum(state.idle_j),
        definition="Energy that all nodes have drawn beside their uplinks.",
        unit="J",
        heading="idle J",
        axis_title="Energy drawn while idle in J",
        title="Energy drawn while idle",
        tag="energy/idle_j",
        low=0.0,
        applies=_has_limited_stores,
    ),
    Metric(
        "asleep_share",
        _asleep_share,
        definition="Share of the nodes' slots that they have slept through, for want of energy.",
        unit="",
        heading="asleep",
        axis_title="Share of node-slots asleep",
        title="Nodes asleep",
        tag="energy/asleep_share",
        digits=3,
        better="less",
        low=0.0,
        high=1.0,
        applies=_has_limited_stores,
    ),
    Metric(
        "survival_days",
        _survival_days,
        definition=(
            "How long nodes would stay awake from the end of the episode on without being charged "
            "or heard, averaged over nodes."
        ),
        unit="days",
        heading="survival days",
        axis_title="Survival without charging in days",
        title="Survival of nodes",
        tag="energy/survival_days",
        digits=3,
        better="more",
        low=0.0,
        applies=lambda scenario: scenario.storage.part.drains,
    ),
    Metric(
        "stored_j_per_day",
        lambda world, state: (
            (state.harvested_j - world.nodes.sum(state.spilled_j)) / _node_days(world, state)
        ),
        definition="Energy that a node has stored of what it has harvested, a day: what AUVs bring "
        "it, averaged over nodes.",
        unit="J/day",
        heading="stored J/day",
        axis_title="Energy stored by a node in J/day",
        title="Energy brought to a node",
        tag="energy/stored_j_per_day",
        better="more",
        low=0.0,
        applies=_has_limited_stores,
    ),
)

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

#: All built-in metrics: those that every world has come first.
ALL = (*BUILTIN, *OF_TIME, *OF_STORES, *OF_VEHICLES, *OF_LOSSES)

#: What reports of any study draw over the axis, and what they table, in this order; metrics of
#: users follow.
DRAWN = ("mean_aoi", "harvested_kj", "jain")
TABLED = (*DRAWN, "age_violations")
