"""`iout schema`: every file that can be loaded fits it, and what is wrong in one value does not."""

import json
import math
import re
from pathlib import Path
from typing import Annotated

import pytest
from pydantic import Field

from iout_marl import InputError, bundled_names, load_scenario, parts
from iout_marl.registry import registries
from iout_marl.scenario import Scenario, bundled_root, find_scenario, member_names, to_yaml
from iout_marl.scenario.families import Matrix
from iout_marl.scenario.json_schema import json_schema
from iout_marl.scenario.naming import split_member
from iout_marl.scenario.reference import keys, keys_of_kind, text_of
from iout_marl.scenario.yaml_values import read_yaml

SCHEMA = json_schema()
FILES = sorted(
    file for folder in ("", "multi/", "sea/") for file in bundled_root().glob(f"{folder}*.yaml")
)
ROLES = [registry for registry in registries() if registry.base and hasattr(registry.base, "check")]
KINDS = [entry for registry in ROLES for entry in registry]
#: Keywords that say something about a value; all others describe.
ANNOTATIONS = {"$schema", "$defs", "title", "description", "default", "unit", "plausible"}
TYPES = {
    "object": lambda value: isinstance(value, dict),
    "array": lambda value: isinstance(value, list),
    "string": lambda value: isinstance(value, str),
    "boolean": lambda value: isinstance(value, bool),
    "null": lambda value: value is None,
    "number": lambda value: isinstance(value, int | float) and not isinstance(value, bool),
    "integer": lambda value: TYPES["number"](value) and value == math.floor(value),
}


def fits(value, schema):
    """Whether a value fits a schema, by the rules of draft 2020-12 for the keywords used here."""

    def alike(other):
        return isinstance(value, bool) == isinstance(other, bool) and value == other

    def size(least, most, number):
        return schema.get(least, 0) <= number <= schema.get(most, math.inf)

    is_number = TYPES["number"](value)
    properties = schema.get("properties", {})
    first = schema.get("prefixItems", [])
    checks = {
        "$ref": lambda name: fits(value, SCHEMA["$defs"][name.removeprefix("#/$defs/")]),
        "type": lambda name: TYPES[name](value),
        "const": alike,
        "enum": lambda choices: any(map(alike, choices)),
        "anyOf": lambda choices: any(fits(value, choice) for choice in choices),
        "oneOf": lambda choices: sum(fits(value, choice) for choice in choices) == 1,
        "not": lambda other: not fits(value, other),
        "minimum": lambda limit: not is_number or value >= limit,
        "maximum": lambda limit: not is_number or value <= limit,
        "exclusiveMinimum": lambda limit: not is_number or value > limit,
        "exclusiveMaximum": lambda limit: not is_number or value < limit,
        "minItems": lambda limit: not isinstance(value, list) or len(value) >= limit,
        "maxItems": lambda limit: not isinstance(value, list) or len(value) <= limit,
        "maxLength": lambda limit: not isinstance(value, str) or len(value) <= limit,
        "pattern": lambda text: not isinstance(value, str) or bool(re.search(text, value)),
        "prefixItems": lambda items: not isinstance(value, list) or all(map(fits, value, items)),
        "items": lambda item: (
            not isinstance(value, list) or all(fits(one, item) for one in value[len(first) :])
        ),
        "required": lambda names: not isinstance(value, dict) or set(names) <= set(value),
        "properties": lambda inner: (
            not isinstance(value, dict)
            or all(fits(value[name], inner[name]) for name in inner.keys() & value.keys())
        ),
        "additionalProperties": lambda other: (
            not isinstance(value, dict)
            or all(other and fits(value[name], other) for name in value.keys() - properties.keys())
        ),
        "propertyNames": lambda name: (
            not isinstance(value, dict) or all(fits(n, name) for n in value)
        ),
        "minProperties": lambda limit: not isinstance(value, dict) or len(value) >= limit,
    }
    return all(checks[word](said) for word, said in schema.items() if word not in ANNOTATIONS)


def read(path):
    return read_yaml(path.read_text(encoding="utf-8"), str(path))[0]


@pytest.mark.parametrize(
    "path", FILES, ids=lambda path: path.relative_to(bundled_root()).with_suffix("").as_posix()
)
def test_bundled_files_fit(path):
    assert fits(read(path), SCHEMA)


@pytest.mark.parametrize("name", ["paper/k3-fdd", "random/k3-tdd", "multi/m2-k10-tdd"])
def test_whole_scenarios_fit(name):
    assert fits(read_yaml(to_yaml(load_scenario(name)), name)[0], SCHEMA)


def test_files_are_all_that_is_bundled():
    files = {split_member(find_scenario(name))[0] for name in bundled_names()}
    assert files == set(FILES)


AXES = {"nodes.count": [3, 5], "duplex": {"fdd": {}, "tdd": {"duplex.beta_rule": "stored"}}}
FAMILIES = {
    "axes": (True, {"axes": AXES}),
    "all keys": (
        True,
        {
            "name": "k{nodes.count}-{duplex}",
            "axes": AXES,
            "without": ["k3-tdd"],
            "cases": [{"when": {"nodes.count": 3}, "set": {"age": {"maximum": 9}}}],
        },
    ),
    "no mapping": (False, ["a"]),
    "no axes": (False, {"name": "a"}),
    "no axis": (False, {"axes": {}}),
    "no values": (False, {"axes": {"nodes.count": []}}),
    "no names": (False, {"axes": {"duplex": {}}}),
    "a value without a name": (False, {"axes": {"grid.cells": [[9, 9, 9]]}}),
    "one value": (False, {"axes": {"nodes.count": 3}}),
    "no settings": (False, {"axes": {"duplex": {"fdd": None}}}),
    "unknown key": (False, {"axes": AXES, "wihtout": []}),
    "key of settings": (False, {"axes": {"duplex": {"fdd": {"duplex.knd": "fdd"}}}}),
    "case without settings": (False, {"axes": AXES, "cases": [{"when": {}}]}),
    "key of a case": (False, {"axes": AXES, "cases": [{"when": {}, "set": {"ag": 1}}]}),
}
BASE = {"extends": "paper/k10-tdd"}
RIGHT = {
    "nothing": {},
    "bases": {"extends": ["paper/k3-fdd", "paper/k10-tdd"]},
    "keys of the kind that is extended": {"duplex": {"beta_min": 0.2}, "nodes": {"count": 4}},
    "a word": {"auvs": {"motion": "hover"}, "channel": {"access": "exclusive"}},
    "a mapping for a word": {
        "auvs": {"motion": {"kind": "hover"}},
        "duplex": {"beta_rule": "stored"},
    },
    "a list of entries": {"observation": {"entries": ["time", {"kind": "ages"}]}},
    "null": {"observation": {"view_range_m": None}, "auvs": {"count": None}},
    "three edges of a cell": {"grid": {"spacing_m": [90, 120.5, 30]}},
    "1e6 for a whole number": {"training": {"steps": 1e6}},
    "what is implausible": {
        "allow_implausible": ["charging.power_w"],
        "charging": {"power_w": 1e7},
    },
}
WRONG = {
    "no mapping": {"grid": 3},
    "unknown key": {"grd": {}},
    "unknown key of a section": {"grid": {"spacing": 100}},
    "unknown key of any kind": {"duplex": {"beta_rul": "stored"}},
    "key of another kind": {"nodes": {"kind": "random", "count": 3, "cells": [[1, 1, 1]]}},
    "unknown kind": {"reward": {"kind": "peek_age"}},
    "unknown word": {"auvs": {"motion": "swim"}},
    "unknown choice": {"observation": {"kind": "raw"}},
    "text for a number": {"charging": {"power_w": "2 kW"}},
    "number for a truth": {"observation": {"time": 1}},
    "truth for a number": {"charging": {"power_w": True}},
    "below the range": {"charging": {"power_w": 0}},
    "above the range": {"charging": {"efficiency": 1.5}},
    "no whole number": {"age": {"maximum": 2.5}},
    "two numbers for a cell": {"grid": {"cells": [10, 10]}},
    "two edges of a cell": {"grid": {"spacing_m": [100, 20]}},
    "four edges of a cell": {"grid": {"spacing_m": [1, 2, 3, 4]}},
    "an edge of nothing": {"grid": {"spacing_m": [100, 100, 0]}},
    "four numbers for a cell": {"nodes": {"kind": "fixed", "cells": [[1, 2, 3, 4]]}},
    "empty list": {"auvs": {"start_cells": []}},
    "key without a range": {"allow_implausible": ["fairness.minimum_jain"]},
    "entry without a kind": {"observation": {"entries": [{}]}},
    "null for a number": {"episode": {"duration_s": None}},
}


@pytest.mark.parametrize("data", RIGHT.values(), ids=RIGHT)
def test_what_can_be_loaded_fits(data):
    assert fits(data, SCHEMA)
    load_scenario(BASE | data)


@pytest.mark.parametrize("data", WRONG.values(), ids=WRONG)
def test_what_cannot_be_loaded_does_not_fit(data):
    assert not fits(data, SCHEMA)
    with pytest.raises(InputError):
        load_scenario(BASE | data)


@pytest.mark.parametrize(("is_right", "matrix"), FAMILIES.values(), ids=FAMILIES)
def test_families_fit_if_their_members_can_be_loaded(is_right, matrix, tmp_path):
    assert fits({"matrix": matrix}, SCHEMA) == is_right
    path = tmp_path / "mine.yaml"
    path.write_text(json.dumps(BASE | {"matrix": matrix}))

    def load():
        for name in member_names(path):
            load_scenario(name)

    if is_right:
        load()
    else:
        with pytest.raises(InputError, match=r"mine\.yaml:1: "):
            load()


def test_every_key_is_described():
    def undescribed(model, path=""):
        for key in keys(model):
            here = f"{path}{key.name}"
            if key.sections:
                assert all(map(text_of, key.sections)), here
                for section in key.sections:
                    undescribed(section, f"{here}.")
            else:
                assert key.text.endswith("."), here

    undescribed(Scenario)
    undescribed(Matrix)


@pytest.mark.parametrize("entry", KINDS, ids=lambda entry: f"{entry.role}-{entry.kind}")
def test_every_kind_and_its_keys_are_described(entry):
    assert text_of(entry.item)
    assert all(key.text.endswith(".") for key in keys_of_kind(entry))
    kinds = SCHEMA["$defs"][entry.role.replace(" ", "_")]["oneOf"]
    found = [kind for kind in kinds if kind["title"] == entry.kind and "properties" in kind]
    assert set(found[0]["properties"]) == {"kind", *(key.name for key in keys_of_kind(entry))}


def test_a_key_has_unit_ranges_and_default():
    power = SCHEMA["properties"]["charging"]["properties"]["power_w"]
    assert power["exclusiveMinimum"] == 0
    assert power["plausible"] == {"low": 0, "high": 1e6}
    assert power["unit"] == "W"
    assert power["description"] == (
        "Electric power of the source.\n\nUnit: W. Plausible: 0 to 1,000,000."
    )
    assert SCHEMA["properties"]["age"]["properties"]["maximum"]["default"] == 50
    assert SCHEMA["properties"]["auvs"]["properties"]["motion"]["default"] == "six"


def test_a_part_from_outside_is_in_it(iout):
    @parts.rewards.register("of_the_test", version=1)
    class OfTheTest(parts.Reward):
        """Nothing at all."""

        class Settings(parts.Settings):
            #: How many
            #: of them.
            number: Annotated[parts.Count, Field(le=9)] = 2
            named: float = Field(0.5, description="By pydantic's own word.")

        def __call__(self, state, events):
            return {}

    try:
        data = json.loads(iout("schema")[1])
        kinds = data["$defs"]["reward"]["oneOf"]
        word, found = (kind for kind in kinds if kind["title"] == "of_the_test")
        assert word["const"] == "of_the_test"
        assert found["description"] == "Nothing at all."
        number = {"type": "integer", "minimum": 1, "maximum": 9, "default": 2}
        assert found["properties"]["number"] == number | {"description": "How many of them."}
        assert found["properties"]["named"]["description"] == "By pydantic's own word."
    finally:
        parts.rewards.unregister("of_the_test")


@pytest.mark.slow
def test_the_command_prints_it_and_writes_it(iout, refused, tmp_path):
    assert json.loads(iout("schema")[1]) == SCHEMA
    assert json.loads(iout("schema", "--output", "-")[1]) == SCHEMA
    path = tmp_path / "schema.json"
    assert iout("schema", "--output", path) == (0, "", "")
    assert json.loads(path.read_text()) == SCHEMA
    assert SCHEMA["$schema"] == "https://json-schema.org/draft/2020-12/schema"
    assert str(tmp_path) in refused("schema", "--output", tmp_path)
    missing = Path(tmp_path, "none", "schema.json")
    assert "cannot be written" in refused("schema", "--output", missing)
