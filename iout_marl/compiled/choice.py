"""When slots are compiled: once it pays, or as the user says."""

from __future__ import annotations

import os
import warnings
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

from iout_marl.errors import InputError
from iout_marl.extras import how_to_install
from iout_marl.metrics import Metric
from iout_marl.scenario import Scenario

if TYPE_CHECKING:
    from iout_marl.compiled.slot import CompiledSlot

#: What says when: `auto`, `always` or `never`.
VARIABLE = "IOUT_COMPILED"
_WHENS = ("auto", "always", "never")
#: Seconds that NumPy may have taken for slots before a slot is written down, and read where it is
#: kept. It is compiled when they are as many as that will take. Either way what it costs is never
#: more than twice the better of the two.
READ_AFTER_S = 0.1


def when() -> str:
    """What the environment variable says.

    Raises:
        InputError: something else.
    """
    said = os.environ.get(VARIABLE) or "auto"
    if said not in _WHENS:
        raise InputError(f"{VARIABLE} must be one of {', '.join(_WHENS)}, not {said!r}")
    return said


class SlotChoice:
    """The compiled slot of a scenario, once it pays.

    Without the environment variable that says so, it is taken only where it gives what NumPy gives
    to the last digit, and not before NumPy has taken as long as it takes to compile it; where
    llvmlite is missing, never.

    Args:
        scenario: the scenario.
        options: as for `CompiledSlot`.

    Attributes:
        seconds: that NumPy has taken so far: whoever plays adds to them.
    """

    def __init__(
        self, scenario: Scenario, *, summed: tuple[Metric, ...] = (), **options: Any
    ) -> None:
        self.seconds = 0.0
        self._scenario = scenario
        self._options = options | {"summed": summed}
        self._slot: CompiledSlot | None = None
        self._written: CompiledSlot | None = None
        self._is_kept = False
        self._when = when()
        self._is_settled = self._when == "never" or not self._can_compile()

    def _can_compile(self) -> bool:
        is_there = find_spec("llvmlite") is not None
        if not is_there and self._when == "always":
            warnings.warn(
                f"{VARIABLE}=always: slots are played by NumPy, since llvmlite is not installed: "
                f"{how_to_install('compiled')}",
                RuntimeWarning,
                stacklevel=4,
            )
        return is_there

    @property
    def waits(self) -> bool:
        """Whether it depends on `seconds` whether there will be one."""
        return not self._is_settled

    def slot(self) -> CompiledSlot | None:
        """The slot, ready to play; None as long as NumPy is to play."""
        if self._is_settled or (self._when == "auto" and self.seconds < READ_AFTER_S):
            return self._slot
        try:
            return self._ready()
        except Exception as error:  # whatever somebody's code, or a compiler, says: NumPy will do
            self._is_settled = True
            if self._when == "always":
                warnings.warn(
                    f"{self._scenario.name}: slots are played by NumPy: there is no compiled form "
                    f"of {error}",
                    RuntimeWarning,
                    stacklevel=3,
                )
            return None

    def _ready(self) -> CompiledSlot | None:
        if self._written is None:
            from iout_marl.compiled.slot import CompiledSlot  # most never come here

            self._written = CompiledSlot(self._scenario, **self._options)
            self._is_kept = self._written.is_kept
        slot = self._written
        if self._when == "auto":
            if not slot.is_exact:
                self._is_settled = True
                return None
            if self.seconds < slot.seconds_to_compile and not self._is_kept:
                return None
        slot.compile()
        self._is_settled, self._slot = True, slot
        return slot
