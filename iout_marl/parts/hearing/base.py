"""Hearing: which nodes an AUV hears in a slot besides the one that it has chosen.

AUVs that poll keep in step: the first packet of each counts as simultaneous with the first ones of
the others, then the second ones, and so on. The access part judges each such round.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from iout_marl.core.split import Split
from iout_marl.parts.access import Access, Request, Uplinks
from iout_marl.parts.base import Context, Part
from iout_marl.parts.storage import Storage
from iout_marl.physics.arrays import Array, highest, joined, lookup_inside, pick, reverse_axes
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import invalid
from iout_marl.whole import short


class Call(NamedTuple):
    """What the AUVs have asked for in a slot, and what there is to hear."""

    age: Array  # (envs, nodes) float, slots: ages when the slot begins
    node_cell: Array  # (envs, nodes) int: codes of the nodes' cells
    available_j: Array  # (envs, nodes) float, J: energies when the uplinks begin
    request: Request  # of the nodes chosen
    split: Split  # of the slot, for the nodes chosen
    listens: Array  # (envs, auvs) bool: whether the AUV hears anybody


class Heard(NamedTuple):
    """Who was heard in a slot. A round is a column: the first packet of every AUV, the second …"""

    chosen: Uplinks  # what came of the nodes chosen
    node: Array  # (envs, auvs, rounds) int: further node whose packet this is, K for none
    delivered: Array  # (envs, auvs, rounds) bool: that packet arrived
    spent_j: Array  # (envs, auvs, rounds) float, J: energy spent on it
    age_s: Array  # (envs, auvs, rounds) float, s: from the start of the packet to the slot's end
    #: What each round asked of the access part, for `Access.why_lost`; may be left empty.
    rounds: tuple[tuple[Request, Split], ...] = ()


class Hearing(Part):
    """Which nodes an AUV hears in a slot besides the one that it has chosen.

    A part of one's own that polls sets `polls` and `uplinks_per_slot`, and says in `urgency` who
    comes first.

    Attributes:
        polls: whether AUVs hear nodes that they have not chosen. If not, the part is never called
            and adds nothing to a slot.
        uplinks_per_slot: the most packets that one AUV can receive in a slot.
    """

    polls: bool = False

    @property
    def uplinks_per_slot(self) -> int:
        return 1

    def rounds(self, num_nodes: int) -> int:
        """Columns of `Heard` in a network of so many nodes; 0 where nobody is polled."""
        return min(self.uplinks_per_slot, num_nodes) if self.polls else 0

    def check(self, scenario: Scenario) -> None:
        """Refuse parts with which there is no time for a second packet, or no rule for it."""
        if not self.polls:
            return
        kind, access = self.settings.kind, scenario.channel.part.access
        if not scenario.uplink.part.has_own_time:
            raise invalid(
                ("hearing", "kind"),
                f"{kind!r} needs packets that take a time of their own, as of uplink.kind: modem: "
                f"one of {scenario.uplink.kind!r} takes all the time that a slot has for it",
                beside=("uplink",),
            )
        if scenario.num_auvs > 1 and access.uplinks_disturb:
            raise invalid(
                ("hearing", "kind"),
                f"{kind!r} takes an access rule under which uplinks do not disturb one another: "
                "which of several packets overlap is not known. For several AUVs channel.access "
                f"must be orthogonal or exclusive, not {access.settings.kind!r}",
                beside=("channel", "access"),
            )

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        if not isinstance(self.polls, bool):
            raise self.fault(f"polls must be True or False, not {short(self.polls)}")
        count = self.uplinks_per_slot
        if not (isinstance(count, int) and not isinstance(count, bool) and count >= 1):
            raise self.fault(f"uplinks_per_slot must be a whole number from 1, not {short(count)}")
        if count > 1 and not self.polls:
            raise self.fault(f"uplinks_per_slot must be 1 where polls is False, not {count}")

    def setup(self, world: Context) -> None:
        super().setup(world)
        backend, scenario = world.backend, world.scenario
        self._link, self._nodes = world.link, world.nodes
        self._num_auvs = scenario.num_auvs
        self._num_rounds = self.rounds(scenario.num_nodes)
        self._nobody = backend.integers(scenario.num_nodes)
        self._no_nodes = backend.integers(
            np.full((world.num_envs, self._num_auvs), scenario.num_nodes)
        )
        # In time division what is left of a slot differs.
        longest_s = self._num_rounds * self._link.farthest_uplink_s
        self._time_binds = scenario.duplex.part.splits_slot or longest_s > scenario.slot_s * 0.999
        self._zero = backend.floats(0.0)
        self._none = backend.floats(float("-inf"))
        self._only_if = backend.floats([float("-inf"), 0.0])

    def urgency(self, call: Call, offset: Array) -> Array:
        """How soon an AUV polls each node: the highest first, of equals that of the lowest index.

        Args:
            call: the slot.
            offset: (envs, auvs, nodes) how nodes lie to the AUVs, see `Link`.

        Returns:
            (envs, auvs, nodes) numbers, or (envs, 1, nodes) where they are alike for all AUVs.
        """
        raise NotImplementedError

    def __call__(self, call: Call, access: Access, storage: Storage) -> Heard:
        """Hear the chosen nodes that send, and after them, or in their place, others.

        Args:
            call: the slot.
            access, storage: the world's.
        """
        xp, link, nodes, request = self.xp, self._link, self._nodes, call.request
        offset = link.offset(request.cell[:, :, None], call.node_cell[:, None, :])
        pays = call.available_j[:, None, :] > lookup_inside(xp, link.slot_uplink_j, offset)
        if storage.is_limited:
            pays = pays & ~storage.sleeps(call.available_j)[:, None, :]
        chosen = access.to_nearest(request)
        # Of each node how soon it is asked; never of one that cannot pay, or was asked before.
        urgency = self.urgency(call, offset) + reverse_axes(
            xp, pick(xp, self._only_if, reverse_axes(xp, pays))
        )
        urgency = self._without(urgency, nodes.flat_index(request.heard), chosen)
        goes_on, left_s, lasts_s = call.listens, self._zero, None
        if self._time_binds:
            # Where β is 1, the whole slot goes to charging.
            left_s = xp.where(call.split.beta < 1, call.split.uplink_s, self._zero)
            lasts_s = lookup_inside(xp, link.least_uplink_s, offset)
        node = xp.where(chosen, request.heard, self._nobody)
        taken, took_s, rounds = [], [], []
        for number in range(self._num_rounds):
            for attempt in range(self._num_auvs):
                # Who loses a node to a nearer AUV names the next one.
                waits = goes_on
                if attempt or not number:
                    waits = goes_on & (node == self._nobody)
                bid = self._bid(waits, urgency, lasts_s, left_s)
                if self._num_auvs == 1:
                    node = bid if number else xp.minimum(node, bid)
                    continue
                place = nodes.flat_index(bid)
                wins = access.to_nearest(self._request(call, bid, place))
                node = xp.where(wins, bid, node)
                urgency = self._without(urgency, place, wins)
            place = nodes.flat_index(node)
            asks = self._request(call, node, place)
            if self._num_auvs == 1 and number + 1 < self._num_rounds:
                urgency = self._without(urgency, place, asks.sends)
            required_j = link.at(link.slot_uplink_j, asks.offset)
            if number == 0:
                required_j = xp.where(chosen, call.split.required_j, required_j)
            split = call.split._replace(required_j=required_j)
            delivered, spent_j = access(asks, split)
            sent = asks.sends & (delivered | (spent_j > self._zero))
            goes_on = goes_on & (delivered | ~sent)
            lasted_s = xp.where(sent, link.at(link.least_uplink_s, asks.offset), self._zero)
            if self._time_binds:
                left_s = left_s - lasted_s
            taken.append((xp.where(sent, node, self._nobody), delivered, spent_j))
            took_s.append(lasted_s)
            rounds.append((asks, split))
            node = self._no_nodes
        return self._heard(chosen, taken, took_s, tuple(rounds))

    def _without(self, urgency: Array, place: Array, asked: Array) -> Array:
        """Urgency, never of nodes at (envs, auvs) places that are asked."""
        never = self.xp.where(asked, self._none, self._zero)
        if urgency.shape[1] == 1:
            return self._nodes.scatter_add(urgency[:, 0, :], place, never)[:, None, :]
        return urgency + self._nodes.total(place, never)[:, None, :]

    def _bid(self, waits: Array, urgency: Array, lasts_s: Array | None, left_s: Array) -> Array:
        """The node that each AUV that waits asks next, (envs, auvs); K where none is left.

        Args:
            waits: (envs, auvs) bool.
            urgency: (envs, auvs, nodes), −∞ of nodes that are not asked.
            lasts_s: how long uplinks of nodes last, alike; None where time does not bind.
            left_s: (envs, auvs) what is left of the slot.
        """
        xp = self.xp
        if lasts_s is not None:
            urgency = xp.where(lasts_s <= left_s[..., None], urgency, self._none)
        asks = waits & (highest(xp, urgency, 2) > self._none)
        return xp.where(asks, xp.argmax(urgency, axis=2), self._nobody)

    def _request(self, call: Call, node: Array, place: Array) -> Request:
        """The request for these nodes, (envs, auvs), K for none, at their places."""
        node_cell = self._nodes.gather(call.node_cell, place)
        return Request(
            cell=call.request.cell,
            heard=node,
            node_cell=node_cell,
            sends=node < self._nobody,
            available_j=self._nodes.gather(call.available_j, place),
            offset=self._link.offset(call.request.cell, node_cell),
        )

    def _heard(
        self,
        chosen: Array,
        taken: list[tuple[Array, Array, Array]],
        took_s: list[Array],
        rounds: tuple[tuple[Request, Split], ...],
    ) -> Heard:
        xp = self.xp
        # The last packet ends with the slot, the others lie before it without a gap.
        ages_s: list[Array] = []
        age_s = self._zero
        for lasted_s in reversed(took_s):
            age_s = age_s + lasted_s
            ages_s.insert(0, age_s)
        node, delivered, spent_j = taken[0]
        uplinks = Uplinks(chosen & delivered, xp.where(chosen, spent_j, self._zero))
        taken[0] = (
            xp.where(chosen, self._nobody, node),
            ~chosen & delivered,
            xp.where(chosen, self._zero, spent_j),
        )
        node, delivered, spent_j = (
            joined(xp, [column[..., None] for column in columns])
            for columns in zip(*taken, strict=True)
        )
        age_s = joined(xp, [column[..., None] for column in ages_s])
        return Heard(uplinks, node, delivered, spent_j, age_s, rounds)


hearings: Registry[type[Hearing]] = Registry("hearing", Hearing)
