"""The built-in metrics."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iout_marl.metrics.losses import OF_LOSSES
from iout_marl.metrics.metric import Metric
from iout_marl.metrics.stores import OF_STORES
from iout_marl.metrics.vehicles import OF_VEHICLES
from iout_marl.physics.arrays import Array

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


def _reward(world: World, total: Array) -> Array:
    return world.backend.xp.mean(total, axis=1)


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
#: All built-in metrics: those that every world has come first.
ALL = (*BUILTIN, *OF_TIME, *OF_STORES, *OF_VEHICLES, *OF_LOSSES)

#: What reports of any study draw over the axis, and what they table, in this order; metrics of
#: users follow.
DRAWN = ("mean_aoi", "harvested_kj", "jain")
TABLED = (*DRAWN, "age_violations")
