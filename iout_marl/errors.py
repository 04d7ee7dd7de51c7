"""Errors that a user can mend."""

from __future__ import annotations

import difflib
import numbers
from collections.abc import Iterable
from typing import Any


class InputError(ValueError):
    """Bad input: its message is one line that says where, what, and what was meant.

    The command line prints the message and leaves with exit status 2.
    """

    def __init__(self, message: str) -> None:
        # Keys and values of the user's may hold line breaks.
        super().__init__("".join(c if c.isprintable() else repr(c)[1:-1] for c in message))


def whole_number(name: str, value: Any, least: int, most: int | None = None) -> int:
    """An argument as an int.

    Raises:
        InputError: it is no whole number from `least` on, up to `most`; bools are none.
    """
    is_whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
    if is_whole and least <= int(value) and (most is None or int(value) <= most):
        return int(value)
    to = "on" if most is None else f"to {most:,}"
    raise InputError(f"{name} must be a whole number from {least} {to}, not {shortened(value)}")


def shortened(value: Any, length: int = 60) -> str:
    """A value of a user's in one line that is not too long."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:
        return "a number of too many digits"
    return text if len(text) <= length else f"{text[: length - 3]}..."


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """'; did you mean 'x'?' for the known word nearest to `word`, or the list of all."""
    choices = sorted(set(known))
    near = difflib.get_close_matches(word, choices, n=1, cutoff=0.6)
    if near:
        return f"; did you mean {near[0]!r}?"
    return f" (known: {', '.join(choices)})" if choices else ""
