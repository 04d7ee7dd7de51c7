"""Why packets do not arrive, in words that a user reads."""

from __future__ import annotations

import re
from dataclasses import dataclass

from iout_marl.errors import InputError
from iout_marl.whole import short

_WORD = re.compile(r"[a-z][a-z0-9_]*")


@dataclass(frozen=True, slots=True)
class Reason:
    """Why a packet did not arrive; parts have reasons of their own.

    Attributes:
        code: a word of lower-case letters, digits and underscores, by which programs know it.
        text: the same for people.

    Raises:
        InputError: the code is no such word, or the text is none.
    """

    code: str
    text: str

    def __post_init__(self) -> None:
        if not (isinstance(self.code, str) and _WORD.fullmatch(self.code)):
            raise InputError(
                f"reason {short(self.code)}: a code is a word of lower-case letters, digits and "
                "underscores"
            )
        if not (isinstance(self.text, str) and self.text.strip()):
            raise InputError(f"reason {self.code}: its text must be words, not {short(self.text)}")


NO_ENERGY = Reason("not_enough_energy", "the node has not enough energy for an uplink this far")
OUT_OF_RANGE = Reason("out_of_range", "out of range: no packet of the node can reach the AUV")
ONLY_CHARGED = Reason(
    "only_charged", "the whole slot went to charging: not enough energy for an uplink yet"
)
ASLEEP = Reason("asleep", "the node sleeps: its store was empty, and it has not been charged since")
STORE_TOO_SMALL = Reason(
    "store_too_small", "the node's full store holds less than this uplink takes"
)
NOT_SENT = Reason("not_sent", "the node did not send")
TAKEN = Reason("taken", "the node sent to another AUV, which is nearer")
COLLISION = Reason("collision", "another uplink in the same slot collided with it")
INTERFERENCE = Reason("interference", "other uplinks in the band were too loud")
CHARGING_NOISE = Reason("charging_noise", "an AUV that charged meanwhile was too loud")
TOO_WEAK = Reason(
    "too_weak", "the packet arrived too weak: shadowing or wind took more than its margin"
)
BIT_ERRORS = Reason("bit_errors", "bit errors destroyed the packet, though it was loud enough")
STRANDED = Reason("stranded", "the AUV's battery was empty: it heard nobody")
#: Of an AUV that heard nobody: nothing has failed.
NOBODY_ASKED = Reason("nobody_asked", "nobody was asked for a packet")
#: Of parts from outside that say nothing.
NOT_STATED = Reason("not_stated", "the scenario's parts do not say why")
