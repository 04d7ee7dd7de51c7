"""A starter: a scenario file with every section, to be changed by hand.

It says what the scenario that it extends says already. Remarks begin with `# `; a `#` directly
before a key switches it off: training settings, which the preset gives, and other kinds of parts.
"""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from iout_marl.errors import InputError
from iout_marl.registry import Entry, registry_of
from iout_marl.scenario.cases import value_at
from iout_marl.scenario.loading import dump_yaml, load_scenario
from iout_marl.scenario.reference import Key, described, keys, keys_of_kind, summary_of, text_of
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.training import Training

#: Keys at the top that a starter does not repeat.
_LEFT_OUT = ("name", "description", "allow_implausible")
_WIDTH = 96


def starter(scenario: Scenario, extends: str) -> str:
    """The text of a scenario file that changes nothing yet.

    Args:
        scenario: what it extends.
        extends: how the file names it.
    """
    data = _whole(scenario)
    lines = [
        *_remark(
            f"A scenario. Every value is as in {extends}: change what you like, and delete what is "
            "to stay as it is there. A # directly before a key switches it off."
        ),
        *dump_yaml({"extends": extends, "description": f"After {extends}"}).splitlines(),
    ]
    for key in keys(Scenario):
        if key.name not in _LEFT_OUT:
            lines += ["", *_section(scenario, key, data)]
    return "\n".join(lines)


def _whole(scenario: Scenario) -> dict[str, Any]:
    """A scenario as data, with a mapping for each section that is a part, whatever it has."""
    data = scenario.model_dump(mode="json")
    parts = [key.name for key in keys(Scenario) if key.part and isinstance(data[key.name], str)]
    return data | {name: {"kind": data[name]} for name in parts}


def _section(scenario: Scenario, key: Key, data: Mapping[str, Any]) -> Iterator[str]:
    """A section's lines; of a part also those of its other kinds, switched off."""
    values: dict[str, Any] = data[key.name]
    if key.part is None:
        (section,) = key.sections
        yield from _remark(key.text or text_of(section))
        yield f"{key.name}:"
        for inner in keys(section):
            is_off = section is Training and inner.name != "preset"
            yield from _setting(inner, values[inner.name], is_off=is_off)
        return
    kinds = {entry.kind: entry for entry in registry_of(key.part.role)}
    chosen = kinds.pop(values["kind"])
    yield from _remark(f"{key.text} {_about(chosen)}")
    yield f"{key.name}:"
    yield f"  kind: {chosen.kind}"
    for inner in keys_of_kind(chosen):
        yield from _setting(inner, values[inner.name])
    for entry in kinds.values():
        yield from _remark(f"Or instead of it {_about(entry)}")
        yield from _switched_off(_other_kind(scenario, key.name, entry, data))


def _setting(key: Key, value: Any, *, is_off: bool = False) -> Iterator[str]:
    lines = dump_yaml({key.name: value}).splitlines()
    for line in (*_remark(described(key)), *(_switched_off(lines) if is_off else lines)):
        yield f"  {line}"


def _other_kind(
    scenario: Scenario, section: str, entry: Entry[Any], data: Mapping[str, Any]
) -> Sequence[str]:
    """A section of another kind: what both kinds have as it is, all else by default.

    Keys that must be given stand in remarks.
    """
    own = keys_of_kind(entry)
    found = {key.name: value_at(data, f"{section}.{key.name}") for key in own}
    kept = {name: value for name, value in found.items() if value is not None}
    change = {section: {"kind": entry.kind, **kept}}
    try:
        whole = _whole(load_scenario(scenario, change))[section]
        change[section] = {"kind": entry.kind, **whole}
    except InputError:  # it has a key without a default, or needs another key elsewhere
        pass
    lacking = [key for key in own if key.default is ... and key.name not in change[section]]
    return [
        *dump_yaml(change).splitlines(),
        *(f"  {line}" for key in lacking for line in _remark(f"{key.name}: {described(key)}")),
    ]


def _about(entry: Entry[Any]) -> str:
    """A kind and the first sentence of its description."""
    return f"({entry.kind}) {summary_of(entry.item)}"


def _remark(text: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent="# ", subsequent_indent="# ")


def _switched_off(lines: Sequence[str]) -> list[str]:
    return [f"#{line}" for line in lines]
