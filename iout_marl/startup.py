"""What can go wrong while the command line still imports what it needs: one line for it.

Ctrl-C, and a working folder that is gone, for which libraries ask at once. And what would go wrong
without a word: `python -m` looks for modules in the working folder first, where a folder of the
user's may have the name of a package.

Imported before anything else; it imports next to nothing itself.
"""

import os
import signal
import sys
from types import FrameType
from typing import NoReturn


def stop_guarding() -> None:
    """From here on Ctrl-C raises KeyboardInterrupt, as usual."""
    if signal.getsignal(signal.SIGINT) is _quit:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def is_command_line() -> bool:
    """Whether this is `iout …`, or `python -m` with one of its modules."""
    words = sys.orig_argv
    if "-m" in words[:-1]:
        return words[words.index("-m") + 1] in ("iout_marl", "iout_marl.cli", "trainers.ppo")
    return os.path.basename("".join(words[1:2])).split(".")[0] == "iout"  # noqa: PTH119


def _quit(number: int, frame: FrameType | None) -> None:  # noqa: ARG001
    # An exception could be swallowed by a library that is being imported; nothing is lost yet.
    _end(130, "interrupted")


def _end(status: int, line: str) -> NoReturn:
    try:
        os.write(2, f"iout: {line}\n".encode())
    finally:
        os._exit(status)


if is_command_line():
    # Where Ctrl-C is ignored, as in what a shell starts in the background, it stays so.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _quit)
    try:
        here = os.getcwd()  # noqa: PTH109
    except OSError:
        _end(2, "the working folder is gone: change to one that is there")
    if "-m" in sys.orig_argv and not sys.flags.safe_path and sys.path[:1] in ([here], [""]):
        sys.path.append(sys.path.pop(0))
