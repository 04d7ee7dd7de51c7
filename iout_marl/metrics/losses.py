"""Metrics of packets that get lost on their way."""

from __future__ import annotations

from typing import TYPE_CHECKING

from iout_marl.metrics.metric import Metric
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario

if TYPE_CHECKING:
    from iout_marl.world import State, World


def _packets_sent(_: World, state: State) -> Array:
    return state.packets[:, 0]


def _share_of_sent(world: World, state: State, *causes: int) -> Array:
    """Packets lost for some causes, columns of `State.packets`, over those sent."""
    xp, sent = world.backend.xp, state.packets[:, 0]
    lost = sum(state.packets[:, cause] for cause in causes)
    return lost / xp.maximum(sent, xp.ones_like(sent))


def _may_lose(scenario: Scenario) -> bool:
    return bool(scenario.uplink.part.loses)


def _losses(name: str, causes: tuple[int, ...], definition: str, title: str) -> Metric:
    return Metric(
        name,
        lambda world, state: _share_of_sent(world, state, *causes),
        definition=definition,
        unit="",
        heading=title.lower(),
        axis_title=f"{title}, share of those sent",
        title=title,
        tag=f"uplink/{name}",
        digits=3,
        better="less",
        low=0.0,
        high=1.0,
        applies=_may_lose,
    )


#: Of scenarios in which packets may get lost on their way.
OF_LOSSES = (
    Metric(
        "packets_sent",
        _packets_sent,
        definition="Packets that nodes have sent, those that did not arrive included.",
        unit="packets",
        heading="packets sent",
        axis_title="Packets sent",
        title="Packets sent",
        tag="uplink/packets_sent",
        digits=1,
        low=0.0,
        applies=_may_lose,
    ),
    _losses(
        "packets_lost",
        (1, 2),
        "Share of the packets sent that got lost on their way.",
        "Packets lost",
    ),
    _losses(
        "packets_lost_weak",
        (1,),
        "Share of the packets sent that got lost and had arrived with less signal over noise than "
        "they need, for shadowing or wind.",
        "Packets lost too weak",
    ),
    _losses(
        "packets_lost_bits",
        (2,),
        "Share of the packets sent that bit errors destroyed though they were loud enough.",
        "Packets lost by bit errors",
    ),
)
