"""Metrics of stores with limits."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iout_marl.metrics.metric import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario

if TYPE_CHECKING:
    from iout_marl.world import State, World

SECONDS_PER_DAY = 86_400.0


def _asleep_share(world: World, state: State) -> Array:
    return world.nodes.sum(state.asleep_slots) / (world.slots_over(state) * world.num_nodes)


def _survival_days(world: World, state: State) -> Array:
    return world.nodes.sum(world.storage.survival_days(state.energy_j)) / world.num_nodes


def _has_limited_stores(scenario: Scenario) -> bool:
    return bool(scenario.storage.part.is_limited)


def _node_days(world: World, state: State) -> Array:
    return world.slots_over(state) * (world.link.slot_s / SECONDS_PER_DAY * world.num_nodes)


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
