"""Which numbers a world can hold, in single precision too.

A scenario may say what no sea knows: a wrong sign, hertz for kilohertz. Where that makes an uplink
too dear, or costs nothing, its cost stops at a number that plays the same part. Where it makes
energies or rewards that no number holds, the world cannot be made.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, TypeVar

import numpy as np

from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.scenario import Scenario

#: Where distances in m and powers of uplinks in W stop.
FARTHEST_M = 1e30
UPLINK_W = (1e-30, 1e30)
#: Where the energy of an uplink in J stops: above all that a node can ever have.
DEAREST_J = 1e37
#: The most energy that a node may have in J, power that it may harvest in W.
MOST_J = MOST_W = 1e35
#: The largest sum of the rewards of an episode; its square is a number, too.
MOST_REWARD = 1e18
#: Seconds of a slot, bits of a packet, hertz of a band: from and to.
_FROM, _TO = 1e-9, 1e12
MOST_SLOTS = 10**12
MOST_ENVS = 10**7

Function = TypeVar("Function", bound=Callable[..., Any])
#: Decorates what may overflow, and whose results are bounded, refused or of no consequence.
unheard: Callable[[Function], Function] = np.errstate(all="ignore")


def unheard_on_numpy(xp: Any, function: Function) -> Function:
    """The same function; NumPy, which alone warns, says nothing of what overflows in it."""
    return unheard(function) if xp is np else function


def bounded(values: ArrayLike, low: float, high: float) -> Array:
    """Values that stop at bounds."""
    xp, values = as_arrays(values)
    least, most = xp.zeros_like(values) + low, xp.zeros_like(values) + high
    return xp.minimum(xp.maximum(values, least), most)


def check_scenario(scenario: Scenario) -> None:
    """See to it that the numbers of an episode can be held.

    Raises:
        InputError: those of a slot, of an uplink or of a reward cannot.
    """
    if not 1 <= scenario.num_slots <= MOST_SLOTS:
        raise InputError(
            f"episode.duration_s: makes {scenario.num_slots:.3g} slots of {scenario.slot_s:g} s; "
            f"an episode has 1 to {MOST_SLOTS:g}"
        )
    for key, value in (
        (
            "episode.slot_s:"
            if scenario.episode.slot_s
            else "grid.spacing_m over auvs.speed_m_per_s: a slot (s)",
            scenario.slot_s,
        ),
        ("uplink.packet_bits:", scenario.uplink.part.packet_bits),
        ("uplink.bandwidth_hz:", scenario.uplink.part.bandwidth_hz),
    ):
        if not _FROM <= value <= _TO:
            raise InputError(f"{key} must lie between {_FROM:g} and {_TO:g}, not {value:g}")
    bounds = reward_bounds(scenario)
    total = sum(bounds.values()) * scenario.num_slots
    if bounds and not total <= MOST_REWARD:
        key = max(bounds, key=lambda key: bounds[key])
        raise InputError(
            f"{key}: makes rewards of an episode as large as {total:.3g}; "
            f"no more than {MOST_REWARD:g} can be computed with"
        )


def check_link(scenario: Scenario, harvested_w: float, tables: dict[str, Any]) -> None:
    """See to it that what the channel makes of distances can be held.

    Args:
        scenario: the scenario.
        harvested_w: the most that a node harvests from one AUV, in W.
        tables: what else the channel says, by name.

    Raises:
        InputError: energies cannot, or it says nothing.
    """
    most_j = harvested_w * scenario.slot_s * scenario.num_slots * scenario.num_auvs
    if most_j > MOST_J or harvested_w > MOST_W:
        raise InputError(
            f"{_loudest(scenario)}: a node would "
            f"harvest {harvested_w:.3g} W and {most_j:.3g} J in an episode; "
            f"no more than {MOST_J:g} can be computed with"
        )
    for name, table in {"harvested power": harvested_w, **tables}.items():
        if not np.isfinite(table).all():
            raise InputError(
                f"channel, duplex: at these frequencies and levels the {name} is not a number"
            )


def _loudest(scenario: Scenario) -> str:
    """The key that makes the most of what is harvested, in dB."""
    charging = scenario.charging
    shares_db = {
        **scenario.harvester.part.harvest_db(),
        "charging.directivity_index_db": charging.directivity_index_db,
        "charging.power_w": 10 * math.log10(charging.power_w),
    }
    shares_db |= scenario.channel.part.harvest_db()
    return max(shares_db, key=lambda key: shares_db[key])


def reward_bounds(scenario: Scenario) -> dict[str, float]:
    """By key: how large it can make the reward of a slot."""
    bounds: dict[str, float] = scenario.reward.part.bounds(scenario)
    # A difference of two of them is credited.
    return {key: 2 * bound for key, bound in bounds.items()}
