"""Where every key and list item of a scenario was written."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeAlias

from iout_marl.files import path_from

#: A key's way down from the top of the scenario: names and list indices.
KeyPath: TypeAlias = tuple[str | int, ...]
#: How much of a key, a value or a text of the user's a message repeats.
MAX_SHOWN = 40


@dataclass(slots=True)
class Places:
    """Where a value was written, and where what is inside it was.

    Attributes:
        where: `file:line`, or the override that wrote it; "" where only parts of it were.
        inside: the same for each key or list index below it.
        file: the file in which it was written; "" where that was none.
    """

    where: str = ""
    inside: dict[str | int, Places] = field(default_factory=dict)
    file: str = ""

    @classmethod
    def throughout(cls, data: object, where: str, file: str = "") -> Places:
        """The same place for a value and for each key of the mappings in it."""
        parts = data if isinstance(data, dict) else {}
        inside = {key: cls.throughout(value, where, file) for key, value in parts.items()}
        return cls(where, inside, file)

    def nearest(self, path: KeyPath) -> str:
        """Where `path` was written, or else the nearest key above it; "" for nowhere."""
        where, places = self.where, self
        for key in path:
            if key not in places.inside:
                break
            places = places.inside[key]
            where = places.where or where
        return where

    def file_of(self, path: KeyPath) -> Path | None:
        """The file in which what stands at `path` was written; None where that was none."""
        places = self
        for key in path:
            if key not in places.inside:
                break
            places = places.inside[key]
        return Path(places.file) if places.file else None


def show_path(path: KeyPath) -> str:
    """`nodes.cells[2]` for ("nodes", "cells", 2)."""
    text = ""
    for key in path:
        shown = shorten(str(key))
        text += f"[{key}]" if isinstance(key, int) else f".{shown}" if text else shown
    return text


def show_value(value: object) -> str:
    """A value as a file writes it, lists and mappings as Python does; or its beginning."""
    if value is None or isinstance(value, bool):
        return {None: "null", True: "true", False: "false"}[value]
    if isinstance(value, str):
        return shorten(repr(value[: 2 * MAX_SHOWN]))
    try:
        return shorten(repr(value))
    except ValueError:
        return "a number of too many digits"
    except RecursionError:
        return "what is nested without end"


def shorten(text: str) -> str:
    """The text, or its beginning where it is long."""
    return text if len(text) <= MAX_SHOWN else f"{text[: MAX_SHOWN - 3]}..."


def show_file(path: Path) -> str:
    """The shorter of a file's path as given and its path from here."""
    relative = path_from(path)
    return relative if len(relative) < len(str(path)) else str(path)
