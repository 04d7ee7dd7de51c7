"""Errors that a user can mend."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


class InputError(ValueError):
    """Bad input: its message is one line that says where, what, and what was meant.

    The command line prints the message and leaves with exit status 2.
    """

    def __init__(self, message: str) -> None:
        # Keys and values of the user's may hold line breaks.
        super().__init__(printable(message))


def printable(text: str) -> str:
    """Text in one line: line breaks and control characters as Python writes them."""
    return "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """'; did you mean 'x'?' for the known word nearest to `word`, or the list of all."""
    choices = sorted(set(known))
    near = difflib.get_close_matches(word, choices, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f" (known: {', '.join(choices)})" if choices else ""
