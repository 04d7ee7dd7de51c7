"""Cases: settings that hold only where a scenario has certain values.

Training presets and families list them: `cases: [{when: {dotted key: value, …}, set: {…}}]`.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import Any

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.hints import hint_to_dotted_key
from iout_marl.scenario.keys import all_keys, choices
from iout_marl.scenario.layers import Layer
from iout_marl.scenario.placeholders import word_of
from iout_marl.scenario.places import Places, shorten
from iout_marl.scenario.schema import Scenario


def cases_that_hold(
    layer: Layer, scenario: Mapping[str, Any], axes: Mapping[str, str] | None = None
) -> Iterator[tuple[dict[str, Any], Places]]:
    """What is `set` by each case whose conditions all hold, and where it was written.

    Args:
        layer: what has `cases`.
        scenario: the settings that conditions are about.
        axes: names that conditions may have beside keys of the scenario, with their values.

    Raises:
        InputError: as by `checked_cases`.
    """
    axes = axes or {}
    for case, places in checked_cases(layer, axes):
        if all(
            word_of(value) == axes[key] if key in axes else value_at(scenario, key) == value
            for key, value in case["when"].items()
        ):
            yield case["set"], places.inside["set"]


def checked_cases(
    layer: Layer, axes: Collection[str]
) -> Iterator[tuple[Mapping[str, Any], Places]]:
    """Each case with its `when` and its `set`, and where it was written.

    Args:
        layer: what has `cases`.
        axes: names that conditions may have beside keys of the scenario.

    Raises:
        InputError: no case is so written, or a condition cannot hold in any scenario.
    """
    cases = layer.data.get("cases", [])
    if not isinstance(cases, list):
        raise InputError(f"{layer.origin(('cases',))}: cases: must be a list")
    for i, case in enumerate(cases):
        if not (
            isinstance(case, dict)
            and set(case) == {"when", "set"}
            and all(isinstance(part, dict) for part in case.values())
        ):
            where = layer.origin(("cases", i))
            raise InputError(f"{where}: cases: each must have the mappings 'when' and 'set'")
        for key, value in case["when"].items():
            if key not in axes:
                _check_condition(key, value, layer.origin(("cases", i, "when", key)))
        yield case, layer.places.inside["cases"].inside[i]


def _check_condition(key: str, value: Any, where: str) -> None:
    """Refuse a condition that cannot hold in any scenario."""
    fields = all_keys(Scenario).get(key)
    if fields is None:
        hint = hint_to_dotted_key(Scenario, key)
        raise InputError(f"{where}: cases: when: {shorten(key)}: unknown key{hint}")
    listed = [choices(field) for field in fields]
    known = [str(choice) for values in listed for choice in values or ()]
    if None not in listed and value not in known:
        hint = did_you_mean(str(value), known)
        raise InputError(f"{where}: cases: when: {key}: unknown value {shorten(repr(value))}{hint}")


def value_at(data: Mapping[str, Any], dotted: str) -> Any:
    """A scenario's setting; of a number of nodes or AUVs also that of cells listed."""
    found: Any = data
    for key in dotted.split("."):
        found = found.get(key) if isinstance(found, dict) else None
    listed = {"nodes.count": "nodes.cells", "auvs.count": "auvs.start_cells"}.get(dotted)
    if found is None and listed is not None:
        cells = value_at(data, listed)
        return len(cells) if isinstance(cells, list | tuple) else None
    return found
