"""Compiled slots are those of the world on NumPy."""

import os

import numpy as np
import pytest

pytest.importorskip("numba")

from hypothesis import given, settings
from hypothesis import strategies as st
from test_unrolled import PAPERS_REWARD, PARTS
from test_world_laws import NAMES, STARTS

from iout_marl.compiled import module
from iout_marl.compiled.slot import CompiledSlot
from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes

#: Of two sums in different orders, and of two libraries' exponentials.
ROUNDING = {"float64": 1e-12, "float32": 1e-4}


def assert_alike(scenario, dtype="float64", slots=30, envs=5, seed=0):
    """A compiled slot gives what the world gives, to the last digit where it says so."""
    world = World(scenario, envs, dtype=dtype)
    slot = CompiledSlot(scenario, dtype, with_mask=True, with_terms=True, summed=world.summed)
    rng = np.random.default_rng(seed)
    streams = [np.random.default_rng(seed + i) for i in range(envs)]
    state = world.reset(node_codes(scenario, world.grid, streams))
    rows, chance = slot.rows(state), world.draw_chance(seed)

    def same(found, expected, name):
        assert found.dtype == expected.dtype, name
        if slot.is_exact or expected.dtype.kind != "f":
            np.testing.assert_array_equal(found, expected, name)
        else:
            error = ROUNDING[dtype]
            np.testing.assert_allclose(found, expected, error, error, err_msg=name)

    for _ in range(slots):
        shape = (envs, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
        drawn = next(chance)
        state, events = world.step(state, action, drawn)
        played = slot(rows, action, drawn)
        rows = played.rows
        for name in state._fields:
            same(slot.now(rows, name), getattr(state, name), name)
        for name in events._fields:
            same(slot.last(played.events, name), getattr(events, name), name)
        same(played.reward, world.reward(state, events), "reward")
        same(played.observation, world.observe(state), "observation")
        same(played.mask, world.action_mask(state), "mask")
        for name, term in world.reward_terms(state, events).items():
            same(slot.split_terms(played.terms)[name], term, name)
        if not slot.is_exact:
            rows = slot.rows(state)  # a last digit may decide whether an uplink succeeds
    assert all(map(np.array_equal, slot.state(rows), state))


@pytest.mark.slow
@pytest.mark.parametrize("dtype", ["float64", "float32"])
@pytest.mark.parametrize(
    ("name", "is_exact"),
    [("paper/k10-fdd", True), ("best/k3-tdd", False), ("sea/bay-tide", False)],
)
def test_a_compiled_slot_is_that_of_the_world(name, is_exact, dtype):
    scenario = load_scenario(name)
    assert CompiledSlot(scenario).is_exact is is_exact
    assert_alike(scenario, dtype)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("name", ["multi/m2-k10-fdd", "sea/slope"])
def test_slots_with_all_that_there_is(name):
    """Several AUVs on one band; polling, currents, losses."""
    assert_alike(load_scenario(name))


@pytest.mark.campaign
@settings(max_examples=3, deadline=None)
@given(st.sampled_from(NAMES), st.integers(1, 3), PARTS, PAPERS_REWARD, st.integers(0, 10**6))
def test_compiled_slots_of_random_scenarios_are_those_of_the_world(
    name, auvs, parts, rewards, seed
):
    starts = {"auvs.start_cells": [*STARTS, [3, 8, 2]][:auvs]}
    changed = parts | starts | (rewards if name.startswith("paper") else {})
    if auvs == 1:
        changed.pop("auvs.separation_cells", None)
    assert_alike(load_scenario(name, changed), seed=seed)


def source(scenario):
    return CompiledSlot(scenario)._source


def of_size(nodes, auvs=1):
    return {"auvs.count": auvs, "nodes": {"kind": "random", "count": nodes}}


@pytest.mark.parametrize("auvs", [1, 2])
def test_the_source_does_not_grow_with_nodes(auvs):
    few, many = (
        source(load_scenario("multi/m2-k10-fdd", of_size(nodes, auvs))) for nodes in (12, 300)
    )
    assert many.count("\n") == few.count("\n")


def test_scenarios_that_differ_in_numbers_share_a_source():
    one = load_scenario("paper/k5-fdd")
    other = load_scenario("paper/k5-fdd", {"charging.power_w": 123.0, "age.maximum": 50})
    assert source(one) == source(other)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    module.compiled_function.cache_clear()
    yield tmp_path / "iout_marl" / "compiled"
    module.compiled_function.cache_clear()


#: Compiled in a fraction of a second.
SMALL = """
from numba import njit
@njit("int64(int64)", cache=KEPT)
def slots(number):
    return number + 1
"""


@pytest.mark.slow
def test_what_is_compiled_is_kept(folder):
    assert not module.is_kept(SMALL)
    assert module.compiled_function(SMALL)(1) == 2
    assert module.is_kept(SMALL)
    assert folder.stat().st_mode & 0o777 == 0o700
    made = {path: path.stat().st_mtime_ns for path in folder.rglob("*.nb?")}
    module.compiled_function.cache_clear()
    again = module.compiled_function(SMALL)
    assert again(1) == 2
    assert sum(again.stats.cache_hits.values()) == 1
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.nb?")} == made


def test_a_module_that_was_changed_is_written_anew(folder):
    module.compiled_function(SMALL)
    (path,) = folder.glob("*.py")
    path.write_text("def slots(number):\n    return 0\n")
    module.compiled_function.cache_clear()
    assert module.compiled_function(SMALL)(1) == 2


@pytest.mark.slow
def test_what_nothing_has_used_for_long_is_removed(folder):
    old, used, new = (SMALL.replace("+ 1", f"+ {n}") for n in (2, 3, 4))
    for source in (old, used):
        module.compiled_function(source)
        path = module._path(source)
        os.utime(path, (path.stat().st_atime - 61 * 86400, path.stat().st_mtime))
    module.compiled_function.cache_clear()
    assert sum(module.compiled_function(used).stats.cache_hits.values()) == 1
    module.compiled_function(new)
    assert [module.is_kept(source) for source in (old, used, new)] == [False, True, True]
    stems = {path.name.partition(".")[0] for path in folder.rglob("slot_*.*")}
    assert stems == {module._path(source).stem for source in (used, new)}


@pytest.mark.parametrize("kind", ["no folder", "others write there", "a file"])
def test_without_a_folder_it_is_compiled_all_the_same(folder, kind):
    folder.parent.mkdir(parents=True)
    if kind == "no folder":
        folder.parent.chmod(0o500)
        if folder.parent.stat().st_uid == 0:
            folder.write_text("")
    elif kind == "others write there":
        folder.mkdir()
        folder.chmod(0o777)
    else:
        folder.write_text("")
    try:
        assert module.compiled_function(SMALL)(1) == 2
        assert not module.is_kept(SMALL)
    finally:
        folder.parent.chmod(0o700)
