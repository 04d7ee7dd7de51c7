"""Texts in which `{name}` stands for a value."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from iout_marl.errors import InputError
from iout_marl.scenario.places import show_value

_PLACEHOLDER = re.compile(r"\{([^{}]*)\}")


def fill_placeholders(text: str, values: Mapping[str, Any], where: str) -> str:
    """The text with the value of each `{name}` in its place.

    Args:
        text: the text.
        values: what there is to fill in.
        where: what to call the text in an error.

    Raises:
        InputError: a name that has no value.
    """

    def fill(match: re.Match[str]) -> str:
        if match[1] not in values:
            known = ", ".join(f"{{{name}}}" for name in values)
            raise InputError(f"{where}: unknown {match[0]} (known: {known})")
        return str(values[match[1]])

    return _PLACEHOLDER.sub(fill, text)


def placeholders(text: str) -> list[str]:
    """The names that a text has values filled in for."""
    return _PLACEHOLDER.findall(text)


def word_of(value: object) -> str:
    """A scalar as a file would write it: `true`, `null`, `0.5`; whole numbers without a point."""
    if isinstance(value, float) and value.is_integer() and abs(value) < 1e15:
        return str(int(value))
    return show_value(value) if value is None or isinstance(value, int) else str(value)
