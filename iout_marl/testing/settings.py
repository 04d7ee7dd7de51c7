"""Settings of a part under test: they are kept, and each of them is in the hash."""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal, get_args, get_origin

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, load_scenario, to_yaml
from iout_marl.scenario.data_files import data_files
from iout_marl.scenario.loading import parse_scenario
from iout_marl.scenario.parts import Settings, part_of


def check_settings(scenario: Scenario, key: str, settings: Settings) -> None:
    """See that settings survive YAML and pickling, and that others have another hash.

    Args:
        scenario: the scenario with the part.
        key: where it names the part.
        settings: the part's.

    Raises:
        AssertionError: they do not, or it is the same.
    """
    copies = {
        "YAML": _through_yaml(scenario),
        "pickling": pickle.loads(pickle.dumps(scenario)),
    }
    for what, copy in copies.items():
        assert copy == scenario, f"{what} changes the scenario"
        assert copy.hash == scenario.hash, f"{what} changes the hash"
    data = settings.model_dump(round_trip=True)
    for name, field in type(settings).model_fields.items():
        if name == "kind" or part_of(field):
            continue
        changed = _with_another(scenario, key, data, name, field.annotation)
        if changed is not None:
            assert changed.hash != scenario.hash, f"another value of {name} leaves the hash"


def _through_yaml(scenario: Scenario) -> Scenario:
    """A scenario written and read, beside copies of its files of data, as a run has it."""
    with TemporaryDirectory() as folder:
        for file in data_files(scenario):
            (Path(folder) / file.name_of_copy).write_bytes(file.contents)
        written = to_yaml(scenario, lambda file: file.name_of_copy)
        return parse_scenario(Path(folder) / "scenario.yaml", written.encode())


def _with_another(
    scenario: Scenario, key: str, data: dict[str, Any], name: str, annotation: Any
) -> Scenario | None:
    """The scenario with another value of a setting; None where none is found that is allowed."""
    for value in _others(data[name], annotation):
        changed = {**data, name: value}
        with suppress(InputError):
            listed = [changed] if key.endswith("entries") else changed
            found = load_scenario(scenario, {key: listed})
            if found != scenario:
                return found
    return None


def _others(value: Any, annotation: Any) -> Iterator[Any]:
    if get_origin(annotation) is Literal:
        yield from (each for each in get_args(annotation) if each != value)
    elif isinstance(value, bool):
        yield not value
    elif isinstance(value, int):
        yield from (value + 1, value - 1)
    elif isinstance(value, float):
        yield from (value * 1.01 + 0.001, value * 0.99)
    elif isinstance(value, str):
        yield f"{value}_"
    elif isinstance(value, tuple) and value:
        yield from ([*value[:-1], last] for last in _others(value[-1], None))
        yield list(value[:-1])
    else:
        yield from (1, 0.5, True)
