"""What is shown to a person: it must never cost a result, whatever becomes of the terminal."""

from __future__ import annotations

import copy
import errno
import gc
import io
import os
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from rich.console import Console
from rich.table import Table

#: Columns of what goes into a file or a pipe: no terminal folds it there.
WIDE = 160
#: Text of a user's is shown as it is: `[brackets]` in it are no markup.
_PLAIN: dict[str, Any] = {"markup": False, "highlight": False, "emoji": False}


class _Unfailing(io.TextIOBase):
    """A text stream in front of another: what that one cannot take is dropped.

    A pipe whose reader has gone, a log on a full disk, a closed stream, a character that the
    encoding lacks: none of them is an error here.
    """

    def __init__(self, stream: TextIO | None) -> None:
        self._stream = stream

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return getattr(self._stream, "encoding", None) or "utf-8"

    def isatty(self) -> bool:
        with suppress(OSError, ValueError):
            return self._stream is not None and self._stream.isatty()
        return False

    def fileno(self) -> int:
        if self._stream is None:
            raise OSError("a stream that is closed")
        return self._stream.fileno()

    def write(self, text: str) -> int:
        if self._stream is not None:
            with suppress(OSError, ValueError):
                try:
                    self._stream.write(text)
                except UnicodeEncodeError:
                    self._stream.write(text.encode(self.encoding, "replace").decode(self.encoding))
        return len(text)

    def flush(self) -> None:
        if self._stream is not None:
            with suppress(OSError, ValueError):
                self._stream.flush()


class _Output(Console):
    def on_broken_pipe(self) -> None:
        """Leave it to the caller: Rich would end the program."""
        raise BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE))


def progress_console(**options: Any) -> Console:
    """A console on standard error that never raises, for what is shown beside the work.

    Text is shown as it is: `[brackets]` in it are no markup, and numbers are not coloured.

    Args:
        options: further ones of `rich.console.Console`.
    """
    return Console(file=_Unfailing(sys.stderr), **{**_PLAIN, **options})  # type: ignore[arg-type]


def present(what: str | Table) -> None:
    """Show what a command was asked for on standard output: lines of text, or a table.

    Text is neither folded nor cut off. A table is as wide as its cells need it to be, if wider
    than the terminal; its headings are folded. Colours are for terminals alone.

    Raises:
        OSError: it cannot be written.
    """
    try:
        console = _Output(width=None if sys.stdout.isatty() else WIDE, **_PLAIN)
        if isinstance(what, str):
            console.out(what)
        else:
            width = max(console.width, _least_width(console, what))
            console.print(what, width=width, crop=False, no_wrap=False)
    except OSError as error:
        error.filename = "standard output"
        raise


def _least_width(console: Console, table: Table) -> int:
    bare = copy.copy(table)
    bare.show_header = False
    return console.measure(bare).minimum


def complain(line: str) -> None:
    """Write a line to standard error, if that can be."""
    # In one go: several processes of a group may write there, and get in between.
    stream = _Unfailing(sys.stderr)
    stream.write(f"{line}\n")
    stream.flush()


def prepare_streams() -> None:
    """Make standard output and error fit for any text; what was closed leads nowhere.

    A character that their encoding lacks is replaced. Descriptors that are closed are opened:
    otherwise the next file would be taken for one of them. Standard error holds nothing back: what
    it could not write would fail again for whoever flushes it next, as Python does where it ends.
    """
    with suppress(OSError):
        while (descriptor := os.open(os.devnull, os.O_RDWR)) <= 2:
            pass
        os.close(descriptor)
    for name, descriptor, errors in (("stdout", 1, "replace"), ("stderr", 2, "backslashreplace")):
        stream = getattr(sys, name)
        if stream is None:
            opened = open(descriptor, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
            setattr(sys, name, opened)
        elif isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=errors)
    _hold_nothing_back()


def _hold_nothing_back() -> None:
    error = sys.stderr
    # Any other stream than Python's own would be closed with its buffer.
    if not isinstance(error, io.TextIOWrapper) or error is not sys.__stderr__:
        return
    if isinstance(held := error.buffer, io.BufferedWriter):
        with suppress(OSError):
            error.flush()
        sys.stderr = io.TextIOWrapper(held.raw, error.encoding, error.errors, write_through=True)


def finish_output() -> OSError | None:
    """Write what is left of standard output; why that cannot be, and then drop it."""
    try:
        sys.stdout.flush()
    except OSError as error:
        # Python itself flushes once more when it ends, and would say so in its own way.
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        error.filename = "standard output"
        return error
    return None


@contextmanager
def imports_uninterrupted() -> Iterator[None]:
    """Let a Ctrl-C wait until what is imported within is there, and the garbage collector too.

    Libraries that are interrupted as they load make errors of their own of it. What they bring
    stays: to look through it for garbage, again and again as it grows, takes as long as much of it.

    Raises:
        KeyboardInterrupt: one has come.
    """
    with _without_collector(), _without_interrupts():
        yield


@contextmanager
def _without_collector() -> Iterator[None]:
    if not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()


@contextmanager
def _without_interrupts() -> Iterator[None]:
    received: list[int] = []
    before = signal.getsignal(signal.SIGINT)
    in_main = threading.current_thread() is threading.main_thread()
    if not in_main or before in (None, signal.SIG_IGN):  # none arrives here
        yield
        return
    signal.signal(signal.SIGINT, lambda number, _: received.append(number))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if received:
        raise KeyboardInterrupt
