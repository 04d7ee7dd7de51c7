"""Every key of a scenario with its value, and what the key means: `iout show --explain`."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable, Iterator
from typing import Any

from pydantic_core import to_jsonable_python

from iout_marl.errors import printable
from iout_marl.scenario.parts import Settings
from iout_marl.scenario.reference import Key, described, keys, keys_of_kind, summary_of
from iout_marl.scenario.schema import Scenario

_WIDTH = 96


def explanation(scenario: Scenario) -> str:
    """All keys, section by section: value, meaning, unit and range."""
    lines: list[str] = []
    for key in keys(Scenario):
        if key.sections or key.part:
            lines.append("")
        lines += _explained(key, getattr(scenario, key.name), key.name)
    return "\n".join(lines)


def _explained(key: Key, value: Any, dotted: str) -> Iterator[str]:
    """The lines of a key and of all below it."""
    if key.sections and value is None:
        yield f"{dotted}: null"
        yield from _wrapped((key.text or summary_of(key.sections[0])).replace("`", ""), "    ")
    elif key.sections:
        about = (key.text or summary_of(type(value))).replace("`", "")
        yield from _wrapped(f"{dotted}: {about}", "")
        yield from _all_explained(keys(type(value)), value, dotted)
    elif key.is_list:
        yield f"{dotted}: {_text([part.kind for part in value])}"
        yield from _wrapped(described(key), "    ")
        for i, part in enumerate(value):
            yield from _part(part, f"{dotted}.{i}")
    elif isinstance(value, Settings):
        yield f"{dotted}: {value.kind}"
        yield from _wrapped(described(key), "    ")
        yield from _part(value, dotted)
    else:
        yield f"{dotted}: {_text(value)}"
        yield from _wrapped(described(key), "    ")


def _part(settings: Settings, dotted: str) -> Iterator[str]:
    entry = settings.entry
    yield from _wrapped(f"({entry.kind}) {summary_of(entry.item)}".replace("`", ""), "    ")
    yield from _all_explained(keys_of_kind(entry), settings, dotted)


def _all_explained(found: Iterable[Key], section: Any, dotted: str) -> Iterator[str]:
    for key in found:
        yield from _explained(key, getattr(section, key.name), f"{dotted}.{key.name}")


def _text(value: Any) -> str:
    plain = to_jsonable_python(value, fallback=str)
    return printable(plain) if isinstance(plain, str) else json.dumps(plain, ensure_ascii=False)


def _wrapped(text: str, indent: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=indent, subsequent_indent=indent or "    ")
