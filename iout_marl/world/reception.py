"""What reaches its receiver, and what does not, where levels change or packets get lost."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from iout_marl.arrays.backend import Backend
from iout_marl.core.chance import Chance
from iout_marl.core.limits import unheard
from iout_marl.core.state import State
from iout_marl.core.steps import Steps
from iout_marl.parts import Context, Fading, Heard, Request, Uplinks, Wind, at_work
from iout_marl.physics.arrays import Array, add_up, cast, joined, lookup_inside, reverse_axes
from iout_marl.scenario import Scenario

#: Levels count in steps of 1/this dB: of harvests, which count the step below, and of packets.
HARVEST_PER_DB, PACKET_PER_DB = 1000, 100
#: Packets farther from what they need than this, in dB, are all alike.
_FAR_DB = 100
#: Noise counts in steps of 1/this of the root of the wind in m/s, by which it grows evenly.
_PER_ROOT = 1000
#: Entries of a table of harvests: what lies farther below the loudest is harvested as nothing.
_MOST_ENTRIES = 2**18


class Conditions(NamedTuple):
    """How a slot differs from the median; None where it cannot."""

    gain_db: Array | None  # (envs, auvs, nodes): added to the levels of links
    gust_m_per_s: Array  # (envs, 1) or no column, see `State`
    noise_db: Array | None  # (envs, 1): by how much the noise is above that of the mean wind
    arrival: Array  # (envs, auvs, 1 + rounds): draws, or no column


class Judged(NamedTuple):
    """What became of packets, (envs, auvs, packets) each: of the node chosen, then of others."""

    sent: Array  # bool
    delivered: Array  # bool; of what is expected, whether more than half of such packets arrive
    share: Array | None  # the share that is expected to arrive; None where it is drawn
    lost: Array  # bool: sent and not drowned by others, but lost
    excess_db: Array  # signal over noise on arrival, less what is required, in dB; 0 of none

    @property
    def events(self) -> dict[str, Array]:
        """Fields of the slot's events."""
        return {"lost": self.lost, "excess_db": self.excess_db}


class Received(NamedTuple):
    """What became of all packets of a slot."""

    judged: Judged
    counts: Array  # (envs, 3) float: what the slot adds to `State.packets`


class Reception:
    """Gains, noise and losses of a world.

    Args:
        scenario: a scenario that `may_differ`.
        context: of its world.

    Attributes:
        fades, loses: whether levels of links change, and whether packets get lost.
        fading: the fading part, at work.
        wind: the wind part, at work; None where it is of no consequence.
    """

    def __init__(self, scenario: Scenario, context: Context) -> None:
        channel, uplink = scenario.channel.part, scenario.uplink.part
        self._backend = backend = context.backend
        self._num_auvs = scenario.num_auvs
        self._xp, self._link = backend.xp, context.link
        self.fades: bool = channel.fading.is_active
        self.loses: bool = uplink.loses
        self.fading: Fading = at_work(channel.fading.settings, context)
        self.wind: Wind | None = None
        if channel.wind.matters(scenario):
            self.wind = at_work(channel.wind.settings, context)
            self._noise_db = _noise_table(context, self.wind)
        if self.fades:
            self._level_db = backend.floats(-context.link.charging_loss_db)
            self._harvested_w = _harvest_table(backend, context, channel.fading.most_db)
        if self.loses:
            self._is_certain = uplink.loss.is_certain
            self._excess_db = backend.floats(context.link.excess_db)
            excess_db = np.arange(-_FAR_DB * PACKET_PER_DB, _FAR_DB * PACKET_PER_DB + 1)
            ratio_db = excess_db / PACKET_PER_DB + uplink.required_snr_db
            # To whole steps: what a packet needs is one of them, whatever the rounding.
            self._error_rate = Steps(
                backend,
                uplink.loss.packet_error_rate(ratio_db, uplink),
                int(excess_db[0]),
                PACKET_PER_DB,
                nearest=True,
            )
        self._half = backend.floats(0.5)
        self._weak_db = backend.floats(-0.5 / PACKET_PER_DB)
        self._nothing = backend.floats(0.0)
        self._pair = backend.integers(
            np.arange(context.num_envs)[:, None]
            + context.num_envs * np.arange(scenario.num_auvs)[None, :]
        )
        self._a_node = backend.integers(context.num_envs * scenario.num_auvs)
        self._nodes = context.nodes
        self._nobody = backend.integers(scenario.num_nodes)
        self._last_node = backend.integers(scenario.num_nodes - 1)

    def first(self, num_envs: int) -> dict[str, Array]:
        """Fields of the first state of an episode."""
        fields = {
            **nothing(self._backend, num_envs, self._num_auvs),
            **self.fading.first(num_envs),
        }
        if self.wind is not None:
            fields |= self.wind.first(num_envs)
        if self.loses:
            fields["packets"] = self._backend.zeros((num_envs, 3))
        return fields

    def conditions(self, state: State, chance: Chance) -> Conditions:
        """The conditions of a slot."""
        gust, noise_db = state.gust_m_per_s, None
        if self.wind is not None:
            speed, gust = self.wind.blowing(state, chance)
            noise_db = self._noise_db.at(self._xp.sqrt(speed))
        gain_db = self.fading.gain_db(state, chance) if self.fades else None
        return Conditions(gain_db, gust, noise_db, chance.arrival)

    def harvested_w(self, conditions: Conditions, node: Array, offset: Array) -> Array:
        """Power that nodes harvest, (envs, auvs), in W.

        Args:
            conditions: of the slot.
            node: (envs, auvs) nodes charged; nobody, K, counts as the last one.
            offset: how they lie to the AUVs, see `Link`.
        """
        link = self._link
        if conditions.gain_db is None:
            return link.at(link.harvested_w, offset)
        level_db = link.at(self._level_db, offset) + self._of_pair(conditions.gain_db, node)
        return self._harvested_w.at(level_db)

    def received(
        self,
        conditions: Conditions,
        state: State,
        request: Request,
        chosen: Uplinks,
        heard: Heard | None,
    ) -> Received:
        """All packets of a slot: those that arrive of what others have not spoilt.

        Args:
            conditions: of the slot.
            state: the state before it.
            request, chosen: for the nodes chosen, and what the access part says of them.
            heard: who was polled beside; None where nobody is.
        """
        xp, link = self._xp, self._link
        arrives = chosen.delivered[..., None]
        sent = arrives | (chosen.spent_j > self._nothing)[..., None]
        node, offset = request.heard[..., None], request.offset[..., None]
        if heard is not None:
            others = self._nodes.gather(state.node_cell, self._nodes.flat_index(heard.node))
            offset = joined(xp, [offset, link.offset(request.cell[..., None], others)])
            node = joined(xp, [node, heard.node])
            sent = joined(xp, [sent, heard.node < self._nobody])
            arrives = joined(xp, [arrives, heard.delivered])
        judged = self._judged(conditions, node, offset, sent, arrives)
        return Received(judged, self._counts(judged))

    def _judged(
        self, conditions: Conditions, node: Array, offset: Array, sent: Array, arrives: Array
    ) -> Judged:
        xp = self._xp
        excess_db = lookup_inside(xp, self._excess_db, offset)
        if conditions.gain_db is not None:
            excess_db = excess_db + self._of_pair(conditions.gain_db, node)
        if conditions.noise_db is not None:
            excess_db = excess_db - conditions.noise_db[..., None]
        error_rate = self._error_rate.at(excess_db)
        is_drawn = conditions.arrival.shape[-1] > 0
        limit = conditions.arrival if is_drawn else self._half
        delivered = arrives & (error_rate <= limit)
        share = None
        if not (is_drawn or self._is_certain):
            share = xp.where(arrives, 1 - error_rate, self._nothing)
        # Of packets that there are not, it must not depend on who nobody stands for.
        excess_db = xp.where(arrives, excess_db, self._nothing)
        return Judged(sent, delivered, share, arrives & ~delivered, excess_db)

    def _counts(self, judged: Judged) -> Array:
        """Packets sent, lost for want of level, and lost by bit errors: (envs, 3)."""
        xp, dtype = self._xp, judged.excess_db.dtype
        if judged.share is None:
            lost = cast(xp, judged.lost, dtype)
        else:
            lost = cast(xp, judged.delivered | judged.lost, dtype) - judged.share
        weak = lost * cast(xp, self.is_weak(judged.excess_db), dtype)
        sums = [
            add_up(xp, add_up(xp, values, 2), 1)[:, None]
            for values in (cast(xp, judged.sent, dtype), weak, lost - weak)
        ]
        return joined(xp, sums)

    def is_weak(self, excess_db: Array) -> Array:
        """Whether packets arrived with less than they need, bool."""
        return excess_db < self._weak_db

    def _of_pair(self, values: Array, node: Array) -> Array:
        """The (envs, auvs, nodes) values of each AUV and its nodes, in the shape of `node`."""
        pair = self._pair if node.ndim == 2 else self._pair[..., None]
        node = self._xp.minimum(node, self._last_node)
        return lookup_inside(self._xp, reverse_axes(self._xp, values), node * self._a_node + pair)


@unheard
def _harvest_table(backend: Backend, context: Context, most_db: float) -> Steps:
    """Power harvested by the level of the sound less that of its source, in W."""
    link = context.link
    loudest = int(np.floor(-link.least_charging_loss_db * HARVEST_PER_DB))
    quietest = int(np.floor((-most_db - link.charging_loss_db.max()) * HARVEST_PER_DB))
    first = max(quietest, loudest - _MOST_ENTRIES)
    level_db = np.arange(first, loudest + 1) / HARVEST_PER_DB
    harvested_w = np.array(link.budget.harvested_after_loss_w(-level_db))
    # What lies lower still counts as this.
    harvested_w[0] = 0.0
    return Steps(backend, harvested_w, first, HARVEST_PER_DB, nearest=False)


@unheard
def _noise_table(context: Context, wind: Wind) -> Steps:
    """Noise above that of the mean wind, in dB, by the root of the wind in m/s."""
    channel, budget = context.scenario.channel, context.link.budget
    most = math.sqrt(wind.most_m_per_s(channel.wind_m_per_s))
    roots = np.arange(math.ceil(most * _PER_ROOT) + 1) / _PER_ROOT
    noise_db = channel.part.noise_above_mean_db(
        roots**2, budget.uplink_frequency_khz, budget.bandwidth_hz
    )
    return Steps(context.backend, noise_db, 0, _PER_ROOT, nearest=True)


def may_differ(scenario: Scenario) -> bool:
    """Whether slots of a scenario may differ from the median, or packets get lost."""
    return bool(scenario.channel.part.fading.is_active or scenario.uplink.part.loses)


def nothing(backend: Backend, num_envs: int, num_auvs: int) -> dict[str, Array]:
    """Fields of the first state where nothing differs."""
    none = backend.zeros((num_envs, 0))
    return {
        "gain_db": backend.zeros((num_envs, num_auvs, 0)),
        "gust_m_per_s": none,
        "packets": none,
    }
