"""Errors that a user can fix, and what a user should know though nothing fails."""

from __future__ import annotations

import difflib
import functools
import warnings
from collections.abc import Iterable

#: Parts of what libraries say where they find no memory, or where no memory could ever do, in
#: errors that have no class of their own.
_NO_MEMORY = (
    "can't allocate memory",
    "not enough memory",
    "out of memory",
    "Storage size calculation overflowed",
    "array is too big",
    "Maximum allowed dimension exceeded",
    "Maximum allowed size exceeded",
    "negative dimension",
    "numel: integer multiplication overflow",
    "exceeds the maximum size",
)
#: Longer messages lose their middle.
MAX_MESSAGE = 1500


class InputError(ValueError):
    """Bad input: its message is one line that says where, what, and what was meant.

    The command line prints the message and leaves with exit status 2.
    """

    def __init__(self, message: str) -> None:
        # Keys and values of the user's may hold line breaks, and be of any length.
        super().__init__(_without_middle(printable(_without_middle(message))))


class InputTypeError(InputError, TypeError):
    """Bad input of another type than what it must be."""


class Note(RuntimeWarning):
    """What should be known of results: one line, which the command line prints as a note."""


@functools.cache
def warn_once(message: str) -> None:
    """Warn by a `Note`, once in a process."""
    warnings.warn(message, Note, stacklevel=2)


def is_lack_of_memory(error: BaseException) -> bool:
    """Whether an error, of Python or of a library, says that there is too little memory."""
    return isinstance(error, MemoryError) or any(sign in str(error) for sign in _NO_MEMORY)


def printable(text: str) -> str:
    """Text in one line: line breaks and control characters as Python writes them."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def _without_middle(text: str) -> str:
    half = MAX_MESSAGE // 2 - 2
    return text if len(text) <= MAX_MESSAGE else f"{text[:half]} … {text[-half:]}"


def did_you_mean(word: str, known: Iterable[str], *, most: int = 1, or_list: bool = True) -> str:
    """'; did you mean 'x'?' for the known words nearest to `word`, or the list of all.

    Args:
        word: what was written.
        known: what could have been meant.
        most: how many words to suggest at most.
        or_list: whether to list what is known where nothing is near.
    """
    choices = sorted(set(known))
    near = difflib.get_close_matches(word, choices, n=most, cutoff=0.6)
    if near:
        return f"; did you mean {' or '.join(map(repr, near))}?"
    return f" (known: {', '.join(choices)})" if choices and or_list else ""
