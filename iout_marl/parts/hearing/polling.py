"""Several nodes a slot, one after the other."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from iout_marl.parts.hearing.base import Call, Hearing, hearings
from iout_marl.physics.arrays import Array
from iout_marl.scenario.fields import MAX_NODES, Count, Plausible
from iout_marl.scenario.parts import Settings as PartSettings


@hearings.register("polling")
class Polling(Hearing):
    """An AUV hears the node that it has chosen, then the oldest others that can pay.

    They follow one after the other, up to `max_nodes_per_slot` in all, as long as their airtime
    fits into what is left of the slot, in time division of its (1 − β)τ. A chosen node that cannot
    pay is skipped. Of equally old nodes the one of the lowest number comes first. Each node is
    asked once a slot at most; one that several AUVs would poll is polled by the nearest. The first
    packets of all AUVs count as simultaneous for `channel.access`, then the second ones, and so
    on; an AUV whose packet is lost polls no further. It takes an uplink whose packets take a time
    of their own, such as `modem`.
    """

    class Settings(PartSettings):
        #: The most nodes that an AUV hears in a slot, the chosen one included.
        max_nodes_per_slot: Annotated[Count, Field(le=MAX_NODES), Plausible(1, 1000, "nodes")]

    settings: Settings
    polls = True
    # Of equally old nodes the first one is asked first.
    nodes_are_alike = False

    @property
    def uplinks_per_slot(self) -> int:
        return self.settings.max_nodes_per_slot

    def urgency(self, call: Call, offset: Array) -> Array:  # noqa: ARG002
        return call.age[:, None, :]
