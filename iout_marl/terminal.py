"""What is shown to a person: it must never cost a result, whatever becomes of the terminal."""

from __future__ import annotations

import io
import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any, TextIO

from rich.console import Console


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


def progress_console(**options: Any) -> Console:
    """A console on standard error that never raises, for what is shown beside the work.

    Text is shown as it is: `[brackets]` in it are no markup, and numbers are not coloured.

    Args:
        options: further ones of `rich.console.Console`.
    """
    settings: dict[str, Any] = {"markup": False, "highlight": False, "emoji": False, **options}
    return Console(file=_Unfailing(sys.stderr), **settings)  # type: ignore[arg-type]


@contextmanager
def imports_uninterrupted() -> Iterator[None]:
    """Let a Ctrl-C wait until what is imported within is there.

    Libraries that are interrupted as they load make errors of their own of it.

    Raises:
        KeyboardInterrupt: one has come.
    """
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
