"""What a number of scenarios have in common, and what lies outside of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeAlias

from iout_marl.scenario.schema import Scenario

#: By dotted key: the least and the largest number, or all values that are none.
Extent: TypeAlias = dict[str, dict[str, Any]]

#: Sections that neither the world nor what can be done in it depends on.
_NO_MATTER = ("name", "description", "allow_implausible", "observation", "training", "reward")
#: Where things are, which `_figures` counts instead.
_COUNTED = (
    "nodes.cells",
    "nodes.count",
    "nodes.kind",
    "nodes.redraw",
    "nodes.weights",
    "auvs.count",
)
_ALSO = ("auvs.start_cells", "episode.duration_s", "fairness.minimum_jain", "grid.origin")


def _figures(scenario: Scenario) -> dict[str, Any]:
    """What scenarios are compared by, by dotted key; of lists of numbers each by its place."""
    found: dict[str, Any] = {
        "nodes.count": scenario.num_nodes,
        "auvs.count": scenario.num_auvs,
        "episode.slots": scenario.num_slots,
    }

    def add(path: str, value: Any) -> None:
        if isinstance(value, dict):
            for key, each in value.items():
                add(f"{path}.{key}" if path else key, each)
        elif isinstance(value, list | tuple):
            for i, each in enumerate(value):
                add(f"{path}[{i}]", each)
        else:
            found.setdefault(path, value)

    for section, value in scenario.model_dump().items():
        if section in _NO_MATTER:
            continue
        kept = value
        if isinstance(value, dict):
            kept = {k: v for k, v in value.items() if f"{section}.{k}" not in (*_COUNTED, *_ALSO)}
        add(section, kept)
    weights = scenario.node_weights
    found["nodes.weights"] = max(weights) / min(weights) if min(weights) > 0 else float("inf")
    return found


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def extent_of(scenarios: Iterable[Scenario]) -> Extent:
    """From where to where a number of scenarios reach."""
    extent: Extent = {}
    for scenario in scenarios:
        for key, value in _figures(scenario).items():
            known = extent.setdefault(key, {"values": []})
            if _is_number(value):
                known["from"] = min(known.get("from", value), value)
                known["to"] = max(known.get("to", value), value)
            elif value not in known["values"]:
                known["values"].append(value)
    return extent


def _known(extent: Extent, key: str) -> dict[str, Any] | None:
    """What is known of a key, which may be written as a number or as a list of numbers."""
    whole = key.partition("[")[0]
    parts = [key, whole] if key != whole else [key, *(k for k in extent if k.startswith(f"{key}["))]
    found = [extent[part] for part in parts if part in extent]
    if len(found) < 2:
        return found[0] if found else None
    ranges = [each for each in found if "from" in each]
    known = {"values": [value for each in found for value in each["values"]]}
    if ranges:
        known["from"] = min(each["from"] for each in ranges)
        known["to"] = max(each["to"] for each in ranges)
    return known


def outside(scenario: Scenario, extent: Extent) -> list[str]:
    """In what a scenario lies outside, in words: `nodes.count 200 > 30`; other kinds come first.

    Of a part of another kind its settings are not told, too.
    """
    found: dict[str, str] = {}
    figures = _figures(scenario)
    for key, value in figures.items():
        known = _known(extent, key)
        if known is None:
            if value is not None:
                found[key] = f"{key} {value}, which it has not seen"
        elif _is_number(value) and "from" in known:
            if value < known["from"]:
                found[key] = f"{key} {value:g} < {known['from']:g}"
            elif value > known["to"]:
                found[key] = f"{key} {value:g} > {known['to']:g}"
        elif value not in known["values"]:
            numbers = [f"{known['from']:g} to {known['to']:g}"] if "from" in known else []
            seen = [*numbers, *map(_word, known["values"])]
            found[key] = f"{key} {_word(value)}, not {' or '.join(seen)}"
    # Some parts are written as their kind alone, a word.
    kinds = [key for key in found if key.endswith(".kind") or isinstance(figures[key], str)]
    inside = tuple(f"{key.removesuffix('.kind')}." for key in kinds)
    others = [key for key in found if key not in kinds and not key.startswith(inside)]
    return [found[key] for key in (*kinds, *others)]


def _word(value: Any) -> str:
    return "none" if value is None else str(value)
