"""Whole numbers from outside: counts and seeds, however they are written."""

from __future__ import annotations

import math
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np

from iout_marl.errors import InputError

#: Seeds of torch have 64 bits.
MAX_SEED = 2**64 - 1


def whole_number(value: Any, least: int, most: int | None = None) -> int:
    """A number as an `int`: 100, 1e6 or np.int64(3), but neither 1.5 nor True nor "3".

    Args:
        value: what was given.
        least, most: what it cannot be below and above; None for no such limit.

    Raises:
        ValueError: it is not whole, or outside these; the message begins with "must be".
    """
    is_number = isinstance(value, Real | Decimal) and not isinstance(value, bool | np.bool_)
    if not is_number or value != value:  # or NaN
        raise ValueError(f"must be a whole number, not {short(value)}")
    if value < least:
        raise ValueError(f"must be at least {least}, not {short(value)}")
    if most is not None and value > most:
        raise ValueError(f"must be at most {most:,}, not {short(value)}")
    # The remainder of a `Decimal` may be too small for it; an infinity cannot be rounded.
    if value % 1 or value != round(value):
        raise ValueError(f"must be a whole number, not {short(value)}")
    return int(value)


def whole_argument(name: str, value: Any, least: int, most: int | None = None) -> int:
    """`whole_number` for an argument of this name.

    Raises:
        InputError: it is not whole, or out of range.
    """
    try:
        return whole_number(value, least, most)
    except ValueError as error:
        raise InputError(f"{name} {error}") from None


def seed_argument(seed: Any, count: int = 1) -> int:
    """`whole_argument` for the first of so many seeds.

    Raises:
        InputError: it, or the last one, is none.
    """
    return whole_argument("seed", seed, 0, MAX_SEED - count + 1)


def is_number(value: Any, least: float = -math.inf, most: float = math.inf) -> bool:
    """Whether it is a finite number within these."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        return False
    try:
        return math.isfinite(value) and least <= float(value) <= most
    except OverflowError:  # a whole number larger than any float
        return False


def short(value: Any) -> str:
    """A value as messages show it, in one line."""
    try:
        text = str(value) if isinstance(value, Decimal) else " ".join(repr(value).split())
    except ValueError:  # of more digits than Python writes
        return "a number of too many digits"
    return text if len(text) <= 40 else f"{text[:37]}..."
