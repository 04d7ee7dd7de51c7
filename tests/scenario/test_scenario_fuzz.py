"""Whatever a file says, `load_scenario` returns a scenario or raises an `InputError`."""

import io
from contextlib import suppress

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from ruamel.yaml import YAML

from iout_marl import InputError, Scenario, load_scenario
from iout_marl.scenario import member_names, show_file, to_yaml

pytestmark = pytest.mark.slow

WHOLE = load_scenario("best/k3-tdd").model_dump(mode="json")
QUICK = settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))

scalars = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.sampled_from([0, 1, 3, 10**12, 10**400, -(10**400)]),
    st.floats(),
    st.text(max_size=8),
    st.sampled_from(["fdd", "tdd", "sonar", "random", "fixed", "fast", "paper", "bad.yaml"]),
    st.dates(),
    st.binary(max_size=4),
)
keys = st.one_of(
    st.sampled_from(["kind", "extends", "cells", "count", "preset", "name", *WHOLE]),
    st.text(max_size=4),
)
trees = st.recursive(
    scalars,
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(keys, inner, max_size=4),
    max_leaves=12,
)


def paths(data, path=()):
    for key, value in data.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from paths(value, (*path, key))


def holds_or_is_refused(source, overrides=()):
    scenario = refusal = None
    try:
        scenario = load_scenario(source, overrides)
    except InputError as error:
        refusal = str(error)
    if scenario is None:
        assert refusal.isprintable(), "not one line"
        return
    assert isinstance(scenario, Scenario)
    assert len(scenario.hash) == 12
    assert scenario.num_slots >= 1
    assert load_scenario(scenario) == scenario
    to_yaml(scenario).encode()


@QUICK
@given(st.dictionaries(keys, trees, max_size=6))
def test_any_tree(tree):
    holds_or_is_refused(tree)


@QUICK
@given(st.sampled_from(list(paths(WHOLE))), trees)
def test_any_value_of_any_key(path, value):
    holds_or_is_refused({**WHOLE}, {".".join(path): value})


@QUICK
@given(st.sampled_from(list(paths(WHOLE))))
def test_any_missing_key(path):
    def without(data, path):
        first, *rest = path
        if not rest:
            return {k: v for k, v in data.items() if k != first}
        return {**data, first: without(data[first], rest)}

    holds_or_is_refused(without(WHOLE, path))


@QUICK
@given(st.sampled_from(list(paths(WHOLE))), trees)
def test_any_value_in_a_file(tmp_path, path, value):
    for key in reversed(path):
        value = {key: value}
    written = io.StringIO()
    with suppress(Exception):  # what YAML cannot write
        YAML(typ="safe", pure=True).dump({"extends": "paper/k3-fdd", **value}, written)
    file = tmp_path / "fuzz.yaml"
    file.write_text(written.getvalue(), encoding="utf-8", errors="replace")
    holds_or_is_refused(file)


axes = st.dictionaries(
    st.sampled_from(["nodes.count", "age.maximum", "duplex", "a", "extends", ""]),
    st.lists(scalars, max_size=3)
    | st.dictionaries(st.text(max_size=3), st.dictionaries(keys, trees, max_size=2), max_size=3)
    | trees,
    max_size=3,
)
matrices = st.fixed_dictionaries(
    {"axes": axes},
    optional={
        "name": st.sampled_from(["{a}", "k{nodes.count}", "{duplex}-{age.maximum}", "{"]) | scalars,
        "without": st.lists(st.text(max_size=3), max_size=2) | trees,
        "cases": st.lists(st.fixed_dictionaries({"when": trees, "set": trees}), max_size=2) | trees,
    },
)


@QUICK
@given(matrices | trees)
def test_any_matrix(tmp_path, matrix):
    written = io.StringIO()
    with suppress(Exception):  # what YAML cannot write
        YAML(typ="safe", pure=True).dump({"extends": "paper/k3-fdd", "matrix": matrix}, written)
    file = tmp_path / "fuzz.yaml"
    file.write_text(written.getvalue(), encoding="utf-8", errors="replace")
    with suppress(InputError):
        for name in member_names(file)[:3]:
            holds_or_is_refused(name)
    holds_or_is_refused(file)


@QUICK
@example("age: {initial: &x 2, maximum: *x}")
@given(st.text(st.sampled_from("ab:-[]{}&*!|>%@`'\"#,?~ \n\t\0\\0123456789._xeE"), max_size=40))
def test_any_text(tmp_path, text):
    file = tmp_path / "fuzz.yaml"
    file.write_text("extends: paper/k3-fdd\n" * ("a" in text) + text, encoding="utf-8")
    holds_or_is_refused(file)


@QUICK
@given(st.binary(max_size=40))
def test_any_bytes(tmp_path, data):
    file = tmp_path / "fuzz.yaml"
    file.write_bytes(data)
    holds_or_is_refused(file)
    assert show_file(file)


@QUICK
@given(st.lists(st.text(max_size=20) | st.from_regex(r"[a-z]+(\.[a-z_]+)?=.{0,9}"), max_size=3))
def test_any_overrides(overrides):
    holds_or_is_refused({**WHOLE}, overrides)
