"""Signals that ask a long piece of work to end: what is finished is kept first."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType, TracebackType
from typing import Any, Self

from iout_marl.startup import is_command_line

#: Signals of a hangup of the terminal, of Ctrl-C, and a batch system's or a shell's request to end.
NAMES = ("SIGHUP", "SIGINT", "SIGTERM")


class Stopped(BaseException):
    """A signal has come while `StopSignals.at_once` was set."""


class StopSignals:
    """While inside, the signals that ask to end are only noted, if they are to be caught.

    A second one has its usual effect. A hangup that is ignored, as by `nohup`, stays so.
    Outside the main thread, where no handler may be set, all have their usual effect.

    Args:
        catch: whether to catch them.
        at_once: see below.

    Attributes:
        catch: whether they are.
        number: of the signal that has come; None before.
        at_once: raise `Stopped` when one comes, rather than let the work find out.
    """

    def __init__(self, *, catch: bool = True, at_once: bool = False) -> None:
        self.catch = catch
        self._before: dict[int, Any] = {}
        self.number: int | None = None
        self.at_once = at_once

    def __enter__(self) -> Self:
        for name in NAMES if self.catch else ():
            number = getattr(signal, name, None)  # not every system has all of them
            if number is None:
                continue
            if name == "SIGHUP" and signal.getsignal(number) is signal.SIG_IGN:
                continue
            try:
                self._before[number] = signal.signal(number, self._note)
            except ValueError:  # in another thread than the main one
                break
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._put_back()

    def ignore(self, number: int) -> None:
        """Let a signal have no effect from now on, nor when this is left; if any are caught."""
        if not self.catch:
            return
        self._before.pop(number, None)
        with suppress(ValueError):  # in another thread than the main one
            signal.signal(number, signal.SIG_IGN)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002
        self.number = number
        self._put_back()
        if self.at_once:
            raise Stopped

    def _put_back(self) -> None:
        while self._before:
            signal.signal(*self._before.popitem())


@contextmanager
def nothing_to_save(*, catch: bool) -> Iterator[None]:
    """While inside, the signals that ask to end do so at once.

    Ctrl-C raises an exception as a rule, but not before a library is done with what it computes,
    which may take minutes. It then ends the command line as the other signals do. A program of
    somebody else's, which may have something to save, gets its exception.

    Args:
        catch: as for `StopSignals`; otherwise nothing is changed.
    """
    before = signal.getsignal(signal.SIGINT)
    if not (catch and is_command_line() and before is signal.default_int_handler):
        yield
        return
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
