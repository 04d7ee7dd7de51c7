"""Fields of a certificate of unknown origin: each is what it must be, or refused by name.

What is wrong with a field is said in one line, which shows no more of it than fits there.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError

Floats = npt.NDArray[np.float64]

#: Characters of a text, and digits of a number, that a message shows.
SHOWN = 30


def whole_number(name: str, value: Any, least: int, most: int) -> int:
    """A field that is a whole number, least and most included.

    Raises:
        InputError: it is something else; truth values and 2.0 are no whole numbers.
    """
    if isinstance(value, (int, np.integer)) and not isinstance(value, bool):
        number = int(value)
        if least <= number <= most:
            return number
    raise InputError(
        f"certificate: {name}: must be a whole number from {least} to {most:,}, not {shown(value)}"
    )


def number(name: str, value: Any, least: float, most: float) -> float:
    """A field that is a number, least and most included.

    Raises:
        InputError: it is something else: NaN, an infinity, a truth value, a text.
    """
    is_number = isinstance(value, (int, float, np.integer, np.floating))
    if is_number and not isinstance(value, bool):
        # A whole number of Python's may be too large for a float: compared first, then converted.
        found = value if isinstance(value, int) else float(value)
        if least <= found <= most:
            return float(found)
    raise InputError(
        f"certificate: {name}: must be a number from {least:g} to {most:g}, not {shown(value)}"
    )


def entries(name: str, value: Any, least: int, most: int) -> Sequence[Any]:
    """A field that is a list, a tuple or an array, of so many entries.

    Raises:
        InputError: it is something else.
    """
    wanted = f"{least:,}" if least == most else f"{least:,} to {most:,}"
    is_list = isinstance(value, (list, tuple)) or (isinstance(value, np.ndarray) and value.ndim > 0)
    if not is_list:
        raise InputError(
            f"certificate: {name}: must be a list of length {wanted}, not {shown(value)}"
        )
    if not least <= len(value) <= most:
        raise InputError(
            f"certificate: {name}: must be a list of length {wanted}, not of length {len(value):,}"
        )
    found: Sequence[Any] = value
    return found


def numbers(name: str, value: Any, shape: tuple[int, ...], least: float, most: float) -> Floats:
    """A field that is an array of numbers of that shape, as lists in lists or as it is.

    Raises:
        InputError: it is something else.
    """
    if not shape:
        return np.array(number(name, value, least, most))
    inner = [
        numbers(f"{name}[{i}]", entry, shape[1:], least, most)
        for i, entry in enumerate(entries(name, value, shape[0], shape[0]))
    ]
    return np.array(inner, dtype=np.float64).reshape(shape)


def rises(name: str, values: Sequence[float]) -> None:
    """See that each of some numbers is more than the one before.

    Raises:
        InputError: one is not.
    """
    for i in range(1, len(values)):
        if not values[i - 1] < values[i]:
            raise InputError(
                f"certificate: {name}[{i}]: must be more than the one before, "
                f"{shown(values[i - 1])}, not {shown(values[i])}"
            )


def shown(value: Any) -> str:
    """A value in a message: whole if it is short, else what kind of thing it is."""
    if isinstance(value, np.generic):
        value = value.item()
    if value is None:
        return "null"
    if isinstance(value, str):
        return repr(value if len(value) <= SHOWN else value[:SHOWN] + "…")
    if isinstance(value, (bool, float)):
        return repr(value)
    if isinstance(value, int):
        # Python writes no number of more than some thousand digits.
        digits = f"a number of {value.bit_length()} bits"
        return f"{value:,}" if abs(value) < 10**SHOWN else digits
    return f"a value of type {type(value).__name__}"
