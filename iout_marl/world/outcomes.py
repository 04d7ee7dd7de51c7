"""Why packets have not arrived: found when somebody asks, from a slot that is over."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from iout_marl.core.reasons import (
    BIT_ERRORS,
    NO_ENERGY,
    NOBODY_ASKED,
    NOT_STATED,
    STRANDED,
    TOO_WEAK,
    Reason,
)
from iout_marl.core.split import Split
from iout_marl.core.state import Events, State
from iout_marl.parts import Request
from iout_marl.physics.arrays import Array
from iout_marl.world.addressed import Addressed
from iout_marl.world.polled import listen

if TYPE_CHECKING:
    from iout_marl.world.world import World

#: For each environment, for each AUV: why the packet of the node heard has not arrived, or None
#: where it has.
Outcomes = list[list[Reason | None]]


def outcomes(world: World, before: State, events: Events, after: State) -> Outcomes:
    """What came of every uplink of a slot.

    A slot itself computes no reasons. They follow from what it has left behind: the storage and
    the duplex part say why a node has not sent, the access part why what was sent was lost.

    Args:
        world: the world, on NumPy.
        before, after: the states between which the slot lies.
        events: what happened in it.

    Raises:
        InputError: a part from outside gives something else than flags.
    """
    named, split, request = _asked(world, before, events, after)
    available_j, sends = request.available_j, request.sends
    wanted = world.duplex.sends(split, available_j)
    lost = ~np.asarray(events.delivered)
    found: Outcomes = [[NOT_STATED if each else None for each in row] for row in lost.tolist()]
    has_reason = np.zeros_like(lost)
    if named.hears is not None:
        has_reason = ~np.asarray(named.hears)
        for env, auv in np.argwhere(has_reason).tolist():
            found[env][auv] = NOBODY_ASKED
    for env, auv in np.argwhere(np.asarray(events.stranded)).tolist():
        found[env][auv] = STRANDED
    silent, unheard = ~np.asarray(sends), np.asarray(sends)
    own = (
        (NO_ENERGY, silent & np.asarray(wanted) & np.asarray(available_j < split.required_j)),
        *_lost(world, events, 0),
    )
    for reason, flags in own if world.reception is not None else ():
        new = flags & lost & ~has_reason
        has_reason |= new
        for env, auv in np.argwhere(new).tolist():
            found[env][auv] = reason
    for part, among, reasons in (
        (world.storage, silent, world.storage.why_silent(wanted, available_j, sends)),
        (world.duplex, silent, world.duplex.why_silent(split, available_j)),
        (world.access, unheard, world.access.why_lost(request, split)),
    ):
        for reason, flags in _checked(part, reasons, lost.shape):
            new = flags & among & lost & ~has_reason
            has_reason |= new
            for env, auv in np.argwhere(new).tolist():
                found[env][auv] = reason
    return found


def polled_outcomes(
    world: World, before: State, events: Events, after: State
) -> list[list[list[Reason | None]]]:
    """What came of every packet of a node polled, in the order of `Events.polled`.

    None also where there was none. Arguments and errors as of `outcomes`.
    """
    lost = (events.polled < world.num_nodes) & ~events.polled_delivered
    found: list[list[list[Reason | None]]] = [
        [[NOT_STATED if each else None for each in row] for row in rows] for rows in lost.tolist()
    ]
    if not lost.any():
        return found
    named, split, request = _asked(world, before, events, after)
    heard = listen(world, before, request, split, named.hears, events.available_j)
    for i, (asked, own_split) in enumerate(heard.rounds):
        unknown = lost[..., i].copy()
        for reason, flags in (
            *_lost(world, events, 1 + i),
            *_checked(world.access, world.access.why_lost(asked, own_split), unknown.shape),
        ):
            for env, auv in np.argwhere(flags & unknown).tolist():
                found[env][auv][i] = reason
            unknown &= ~flags
    return found


def _lost(
    world: World, events: Events, number: int
) -> list[tuple[Reason, np.typing.NDArray[np.bool_]]]:
    """Why packets got lost on their way: of each AUV one by its number, 0 the chosen node's."""
    if world.reception is None or not world.reception.loses:
        return []
    lost = np.asarray(events.lost[..., number])
    weak = np.asarray(world.reception.is_weak(events.excess_db[..., number]))
    return [(TOO_WEAK, lost & weak), (BIT_ERRORS, lost & ~weak)]


def _asked(
    world: World, before: State, events: Events, after: State
) -> tuple[Addressed, Split, Request]:
    """The nodes named in a slot, its split, and the request for those heard."""
    named = world.transition.addressed(before.node_cell, after.cell, events.charged, events.heard)
    stored_j = world.nodes.gather(before.energy_j, named.heard_index)
    available_j = world.nodes.gather(events.available_j, named.heard_index)
    split = world.duplex.split(named.charged_offset, named.heard_offset, stored_j)
    if named.charges is not None:
        split = world.transition.without_idle(split, named.charges)
    come_j = world.nodes.scatter_add(before.energy_j, named.charged_index, events.harvested_j)
    sends = world.transition.sends(split, named.heard_index, named.hears, come_j, available_j)
    request = Request(
        after.cell, events.heard, named.heard_cell, sends, available_j, named.heard_offset
    )
    return named, split, request


def _checked(
    part: object, reasons: object, shape: tuple[int, ...]
) -> list[tuple[Reason, np.typing.NDArray[np.bool_]]]:
    """Reasons as a part gives them, seen to be such."""
    fault = getattr(part, "fault")  # noqa: B009 (of every part)
    if not isinstance(reasons, Mapping):
        raise fault(f"reasons must be a mapping from Reason to flags, not {type(reasons).__name__}")
    checked = []
    for reason, flags in reasons.items():
        array: Array = np.asarray(flags)
        if not isinstance(reason, Reason) or array.shape != shape or array.dtype != np.bool_:
            raise fault(f"reason {reason!r} must have flags of shape {shape}")
        checked.append((reason, array))
    return checked
