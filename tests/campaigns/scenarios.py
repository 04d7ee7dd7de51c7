"""Scenarios, presets and overrides that are mutated: each is refused in one line, or whole.

What is accepted must be the same after it was written and read again; of the small ones among it
some are played for a few slots, in which every number must be finite.
"""

from __future__ import annotations

import json
import math
import random
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from campaigns.campaign import Campaign, Tally
from iout_marl import InputError, Scenario, World, bundled_names, load_scenario
from iout_marl.errors import MAX_MESSAGE, Note
from iout_marl.outlook import energy_outlook
from iout_marl.scenario import bundled_root, to_yaml
from iout_marl.world import node_codes, pin_layout

#: Of the accepted scenarios, the share that is played, and for how many slots.
PLAYED, SLOTS = 0.5, 6
#: What is small enough to be played here: cells, nodes, AUVs.
SMALL = (2000, 50, 5)

NUMBERS = (
    *("0", "-0.0", "1", "-1", "2", "3", "1e3", "1e6", "1.5", "-150", "150", "0.1", "30000"),
    *("1e15", "1e16", "-1e300", "1e308", "1e999", "5e-324", "1e-300", "1e-14", "1e-3"),
    *(".nan", ".inf", "-.inf", "0x10", "0o17", "1_000", "9" * 400, "1e", "0x_", "+", "1,5"),
)
WORDS = (
    *(
        "yes",
        "no",
        "on",
        "true",
        "false",
        "null",
        "~",
        "''",
        '"3"',
        "'1e-3'",
        "2kW",
        "x",
        "=",
        "<<",
    ),
    *("2020-01-01", "2020-99-99", "12:30:45", "[]", "{}", "[1]", "[1, 2]", "[[1, 1, 1]]", "{a: 1}"),
    *('"\\ud800"', '"\\0"', '"a\\nb"', '"\\e[31m"', "'[/red]'", "&a 1", "*a", "&a [*a]", "!x 1"),
    *("!!foo [1]", "!!set {a}", "!!omap [a: 1]", "!!binary aGk=", "!!python/object:os.x {a: 1}"),
    *("fdd", "tdd", "sonar", "table", "paper", "mean_age", "random", "fixed", "thorp", "scaled"),
    *("interference", "exclusive", "hover", "central", "difference", "francois_garrison", "info"),
    *("paper/k3-fdd", "nowhere", "mutated", "[" * 60, "- 1", "? a", "%YAML 1.1", "|", ">", "@x"),
)
PLAIN = (
    *(None, True, False, 0, 1, -1, 2, 3, 7, 50, 10**6, 10**12, 10**18, -(10**400), 10**400),
    *(0.0, -0.0, 0.5, 1.0, 1.5, 1e-3, -150.0, 150.0, 3e4, 1e15, 1e300, 5e-324, math.nan, math.inf),
    *("", "x", "fdd", "tdd", "sonar", "random", "3", "1e-3", "yes", "\ud800", "\0", "x" * 20_000),
    *([], [1], [[1, 1, 1]], [[1, 1, 1], [2, 2, 2]], [1.0] * 3, [0] * 30_000, {}, {"a": 1}, {1: 2}),
    *(b"x", object, {3}, (1, 2, 3), np.int64(3), np.float32(2.5), np.bool_(True), np.str_("fdd")),
    *(np.array([[1, 2, 3]]), np.zeros(3), np.array(5), np.nan, np.datetime64("2020-01-01"), 1j),
)

Mutation = Callable[[random.Random, list[str]], None]


def _line(rng: random.Random, lines: list[str]) -> int:
    return rng.randrange(len(lines))


def _delete(rng: random.Random, lines: list[str]) -> None:
    del lines[_line(rng, lines)]


def _repeat(rng: random.Random, lines: list[str]) -> None:
    lines.insert(_line(rng, lines), lines[_line(rng, lines)])


def _move(rng: random.Random, lines: list[str]) -> None:
    lines.insert(_line(rng, lines), lines.pop(_line(rng, lines)))


def _indent(rng: random.Random, lines: list[str]) -> None:
    i = _line(rng, lines)
    lines[i] = rng.choice(["  ", " ", "\t", "- ", "? ", ": ", "# "]) + lines[i]


def _dedent(rng: random.Random, lines: list[str]) -> None:
    i = _line(rng, lines)
    lines[i] = lines[i][rng.randint(1, 3) :]


def _value(rng: random.Random, lines: list[str]) -> None:
    i = _line(rng, lines)
    key, colon, _ = lines[i].partition(":")
    lines[i] = f"{key}{colon} {rng.choice(rng.choice([NUMBERS, WORDS]))}"


def _scale(rng: random.Random, lines: list[str]) -> None:
    """A number that is another one, in range or not."""
    i = _line(rng, lines)
    key, colon, value = lines[i].partition(": ")
    try:
        number = float(value)
    except ValueError:
        return
    factor = rng.choice([-1, 0.5, 0.9, 1.1, 2, 3, 10, 1e3, 1e-3, 1e6, 10 ** rng.uniform(-9, 9)])
    lines[i] = f"{key}{colon}{number * factor if rng.random() < 0.5 else round(number * factor)!r}"


def _key(rng: random.Random, lines: list[str]) -> None:
    i = _line(rng, lines)
    key, colon, value = lines[i].partition(":")
    at = rng.randrange(len(key) + 1)
    wrong = key[:at] + rng.choice(["", "x", "_", ".", "é", "[", "'"]) + key[at + 1 :]
    lines[i] = wrong + colon + value


def _mark(rng: random.Random, lines: list[str]) -> None:
    i = _line(rng, lines)
    key, colon, value = lines[i].partition(":")
    mark = rng.choice(
        ["!!foo", "!!set", "!!str", "!!int", "!!map", "!x", "&a", "*a", "<<: *a", "!"]
    )
    lines[i] = f"{key}{colon} {mark}{value}"


def _insert(rng: random.Random, lines: list[str]) -> None:
    extra = ["---", "...", "<<: *a", "extends: mutated", "extends: [paper/k3-fdd, best/k5-tdd]"]
    extra += [
        "%TAG ! tag:x,2000:",
        "unknown: 1",
        "allow_implausible: [grid.spacing_m]",
        "power_w: 1",
    ]
    extra += [f"{' ' * rng.randint(0, 4)}{rng.choice(WORDS)}", f"x: {'[' * rng.randint(1, 80)}"]
    lines.insert(_line(rng, lines), rng.choice(extra))


def _cut(rng: random.Random, lines: list[str]) -> None:
    del lines[rng.randint(1, len(lines)) :]


MUTATIONS: tuple[Mutation, ...] = (
    *(_delete, _repeat, _move, _indent, _dedent, _value, _value, _key, _mark, _insert, _cut),
    *(_scale,) * 6,
)


def mutated_text(rng: random.Random, text: str) -> bytes:
    """A YAML text with one to three mutations, and sometimes a few bytes that are others."""
    lines = text.splitlines()
    for _ in range(rng.choice([1, 1, 1, 2, 3])):
        if lines:
            rng.choice(MUTATIONS)(rng, lines)
    data = bytearray("\n".join(lines).encode("utf-8", "surrogatepass"))
    if rng.random() < 0.2 and data:
        for _ in range(rng.choice([1, 2, 5])):
            data[rng.randrange(len(data))] = rng.choice([rng.randrange(256), 0, 9, 10, 58, 91, 123])
    if rng.random() < 0.02:
        return rng.choice([b"\xef\xbb\xbf", b"\xff\xfe", b"\0"]) + bytes(data)
    return bytes(data)


def paths(data: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The ways to all keys of nested mappings."""
    for key, value in data.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from paths(value, (*path, key))


def mutated_mapping(rng: random.Random, scenario: Scenario) -> dict[Any, Any]:
    """A scenario's mapping with a value, a key or a section that is another one."""
    data: dict[Any, Any] = scenario.model_dump()
    for _ in range(rng.choice([1, 1, 2])):
        *way, key = rng.choice(list(paths(data)))
        section = data
        for part in way:
            section = section[part]
        kind = rng.randrange(5)
        if kind < 2:
            section[key] = rng.choice(PLAIN)
        elif kind == 2:
            value = section.pop(key)
            rng.choice([data, section])[rng.choice([f"{key}x", 3, None, "count", "kind"])] = value
        elif kind == 3:
            del section[key]
        elif isinstance(section[key], int | float):
            section[key] *= rng.choice([-1, 2, 0.5, 1e3, 1e-3, 1e9])
    return data


def mutated_overrides(rng: random.Random, scenario: Scenario) -> Any:
    """Overrides of a key or two, as words or as a mapping, by any values."""
    ways = [".".join(path) for path in paths(scenario.model_dump())]
    keys = [rng.choice(ways) for _ in range(rng.choice([1, 1, 2]))]
    if rng.random() < 0.1:
        keys[0] = rng.choice(
            ["extends", "", ".", f"{keys[0]}.x", keys[0][1:], "power_w", "a" * 9999]
        )
    if rng.random() < 0.5:
        return {key: rng.choice(PLAIN) for key in keys}
    return [f"{key}={rng.choice(rng.choice([NUMBERS, WORDS]))}" for key in keys]


def run(rng: np.random.Generator, cases: int) -> Tally:
    """Play the cases."""
    tally, words = Tally(), random.Random(int(rng.integers(2**63)))
    names = bundled_names()
    scenarios = {name: load_scenario(name) for name in names}
    whole = {name: to_yaml(scenario) for name, scenario in scenarios.items()}
    presets = [path.read_text() for path in (bundled_root() / "training").glob("*.yaml")]
    families = [path.read_text() for path in bundled_root().glob("*.yaml")]
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("error")
        # What should be known of results is no fault of them.
        warnings.simplefilter("ignore", Note)
        file = Path(folder) / "mutated.yaml"
        for _ in range(cases):
            name = words.choice(names)
            source: Any = name
            overrides: Any = ()
            kind = words.choice(
                ["whole", "whole", "small", "family", "preset", "mapping", "overrides"]
            )
            case: Any
            if kind in ("whole", "small"):
                small = f"extends: {name}\n{_part(words, whole)}"
                case = mutated_text(words, whole[name] if kind == "whole" else small)
                file.write_bytes(case)
                source = file
            elif kind == "family":
                case = mutated_text(words, words.choice(families))
                file.write_bytes(case)
                source = file / name.partition("/")[2] if words.random() < 0.9 else file
            elif kind == "preset":
                case = mutated_text(words, words.choice(presets))
                file.write_bytes(case)
                overrides = {"training.preset": str(file)}
            elif kind == "mapping":
                case = source = mutated_mapping(words, scenarios[name])
            else:
                case = overrides = mutated_overrides(words, scenarios[name])
            try:
                tally.note(_outcome(words, source, overrides, Path(folder) / "again.yaml"))
            except Exception as error:  # whatever it is, it is a fault
                tally.fault((kind, name, case), error)
    return tally


def _part(rng: random.Random, whole: dict[str, str]) -> str:
    """A few lines of another scenario: a section or two."""
    lines = rng.choice(list(whole.values())).splitlines()
    heads = [i for i, line in enumerate(lines) if not line.startswith((" ", "-"))]
    begin = rng.choice(heads)
    return "\n".join(lines[begin : begin + rng.randint(1, 12)])


def _outcome(rng: random.Random, source: Any, overrides: Any, again: Path) -> str:
    try:
        scenario = load_scenario(source, overrides)
    except InputError as error:
        line = str(error)
        assert line.isprintable(), "not one printable line"
        assert len(line) <= MAX_MESSAGE, "a message without end"
        return "refused"
    again.write_text(to_yaml(scenario), encoding="utf-8", newline="")
    copy = load_scenario(again)
    assert (copy, copy.hash, copy.world_hash) == (scenario, scenario.hash, scenario.world_hash)
    json.dumps(scenario.model_dump(mode="json"), allow_nan=False)
    assert load_scenario(scenario) == scenario
    sizes = (math.prod(scenario.grid.cells), scenario.num_nodes, scenario.num_auvs)
    is_small = all(size <= limit for size, limit in zip(sizes, SMALL, strict=True))
    if scenario.allow_implausible or not is_small or rng.random() > PLAYED:
        return "accepted"
    _play(pin_layout(scenario, 0))
    return "accepted and played"


def _play(scenario: Scenario) -> None:
    """A few slots, in which every number is finite."""
    line = energy_outlook(scenario)
    assert line is None or line.isprintable()
    world, rng = World(scenario, 2), np.random.default_rng(0)
    state = world.reset(node_codes(scenario, world.grid, [rng, rng]))
    chances = world.draw_chance(0)
    for _ in range(min(SLOTS, world.num_slots)):
        sizes = world.action_sizes
        actions = [rng.integers(0, size, (2, world.num_auvs)) for size in sizes]
        state, events = world.step(state, np.stack(actions, axis=-1), next(chances))
        for array in (*state, world.reward(state, events), world.observe(state)):
            assert array is None or np.isfinite(array).all(), "a number that is none"


CAMPAIGN = Campaign("mutated scenarios", cases=10_000, short=200, run=run)
