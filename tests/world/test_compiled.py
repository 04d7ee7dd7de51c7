"""Compiled slots are those of the world on NumPy."""

import copy
import os
import pickle
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

pytest.importorskip("llvmlite")

from batteries import BATTERY
from hypothesis import given, settings
from hypothesis import strategies as st
from test_unrolled import PAPERS_REWARD, PARTS
from test_world_laws import NAMES, STARTS

from iout_marl.compiled import llvm, module
from iout_marl.compiled.slot import CompiledSlot
from iout_marl.errors import InputError
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
    columns, chance = slot.columns(state), world.draw_chance(seed)

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
        played = slot(columns, action, drawn)
        columns = played.columns
        for name in state._fields:
            same(slot.now(columns, name), getattr(state, name), name)
        for name in events._fields:
            same(slot.last(columns, name), getattr(events, name), name)
        same(played.reward, world.reward(state, events), "reward")
        same(played.observation, world.observe(state), "observation")
        same(played.mask, world.action_mask(state), "mask")
        for name, term in world.reward_terms(state, events).items():
            same(played.terms[name], term, name)
        if not slot.is_exact:
            columns = slot.columns(state)  # a last digit may decide whether an uplink succeeds
    assert all(map(np.array_equal, slot.state(columns), state))


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
def test_many_auvs_on_one_band():
    """NumPy leaves the powers of more than four to LAPACK, which rounds in its own way."""
    exact = [
        CompiledSlot(load_scenario("multi/m4-k10-fdd", {"auvs.count": auvs})).is_exact
        for auvs in (4, 5)
    ]
    assert exact == [True, False]
    assert_alike(load_scenario("multi/m4-k10-fdd", {"auvs.count": 5}), slots=8)


def test_auvs_in_one_cell():
    """Which of them comes first matters to what an AUV knows of the others."""
    crowded = {
        "auvs.count": 4,
        "auvs.separation_cells": 0,
        "auvs.start_cells": [[1, 1, 1], [2, 1, 1], [1, 2, 1], [2, 2, 1]],
        "grid.cells": [2, 2, 1],
        "nodes": {"kind": "random", "count": 3},
        "observation.entries": ["position", "other_auvs", "batteries"],
        "vehicle": BATTERY,
    }
    assert_alike(load_scenario("multi/m4-k10-fdd", crowded), slots=20)


def four(name):
    scenario = load_scenario(name)
    world, slot = World(scenario, 4), CompiledSlot(scenario)
    codes = node_codes(scenario, world.grid, [np.random.default_rng(0)] * 4)
    return world, slot, slot.columns(world.reset(codes))


@pytest.mark.parametrize("action", [[-1, 0, 0], [0, 10, 0], [0, 0, 10**9], [2**40, 0, 0]])
def test_actions_that_there_are_not(action):
    _, slot, columns = four("paper/k10-fdd")
    with pytest.raises(InputError, match=r"^environment 3, auv_0: action \[.*\] lies outside"):
        slot(columns, np.array([[[0, 0, 0]]] * 3 + [[action]]), None)


def test_actions_of_another_number():
    _, slot, columns = four("paper/k10-fdd")
    with pytest.raises(
        InputError, match=r"expected an array of shape \(4, 1, 3\), not \(3, 1, 3\)"
    ):
        slot(columns, np.zeros((3, 1, 3), np.int64), None)


@pytest.mark.slow
def test_chance_that_was_not_drawn_for_so_many():
    world, slot, columns = four("sea/slope")
    action = np.zeros((4, world.num_auvs, len(world.action_sizes)), np.int64)
    alone = next(World(load_scenario("sea/slope")).draw_chance(0))
    for chance in (None, world.expected, alone):
        with pytest.raises(InputError, match=r"chance: a compiled slot takes \w+ of shape \(4, "):
            slot(columns, action, chance)
    slot(columns, action, next(world.draw_chance(0)))


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda slot: pickle.loads(pickle.dumps(slot))])
def test_copies_of_a_slot_have_tables_of_their_own(copied):
    _, slot, columns = four("paper/k3-fdd")
    action = np.ones((4, 1, 3), np.int64)
    expected = slot(columns, action, None)
    twin = copied(slot)
    for table in slot._tables:
        table[...] = 0
    del slot
    found = twin(columns, action, None)
    np.testing.assert_array_equal(found.observation, expected.observation)
    np.testing.assert_array_equal(found.reward, expected.reward)


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
    return CompiledSlot(scenario)._module.source


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


@pytest.mark.parametrize("envs", [1, 127, 128, 129, 300])
def test_tiles_that_are_not_full(envs):
    scenario = load_scenario("paper/k3-fdd")
    assert CompiledSlot(scenario)._module.tile == 128
    assert_alike(scenario, slots=3, envs=envs)


def test_large_worlds_are_played_in_small_tiles():
    tiles = [
        CompiledSlot(load_scenario("multi/m2-k10-fdd", of_size(nodes, 2)))._module.tile
        for nodes in (10, 300)
    ]
    assert tiles == sorted(tiles, reverse=True)
    assert tiles[0] > tiles[-1]


def test_threads_may_share_a_slot():
    scenario = load_scenario("paper/k3-fdd")
    envs = 4096
    world, slot = World(scenario, envs), CompiledSlot(scenario)
    codes = node_codes(scenario, world.grid, [np.random.default_rng(0)] * envs)
    columns = slot.columns(world.reset(codes))
    actions = [np.full((envs, 1, 3), kind) for kind in (0, 1, 2)]
    alone = [slot(columns, action, None) for action in actions]
    with ThreadPoolExecutor(3) as pool:
        for _ in range(20):
            together = pool.map(lambda action: slot(columns, action, None), actions)
            for one, other in zip(alone, together, strict=True):
                np.testing.assert_array_equal(one.observation, other.observation)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    module.loaded_function.cache_clear()
    yield tmp_path / "iout_marl" / "compiled"
    module.loaded_function.cache_clear()


def small(lines, tile=4, **arrays):
    """A module of some arrays, by types of their numbers."""
    return module.Module(lines, tuple(arrays.items()), (), tile, "float64")


SMALL = small("put(a, 0, get(a, 0) + num_envs)", a="int64")


def added(to):
    """What the small module makes of 1 and 1."""
    array = np.ones(1, np.int64)
    module.compiled_function(to)(1, 0, module.address_of(array))
    return array.item()


@pytest.fixture
def compiling(monkeypatch):
    """What has been compiled, not read."""
    done, compiled = [], llvm.compiled
    monkeypatch.setattr(llvm, "compiled", lambda text: done.append(text) or compiled(text))
    return done


def test_what_is_compiled_is_kept(folder, compiling):
    assert not module.is_kept(SMALL)
    assert added(SMALL) == 2
    assert module.is_kept(SMALL)
    assert folder.stat().st_mode & 0o777 == 0o700
    module.loaded_function.cache_clear()
    assert added(SMALL) == 2
    assert len(compiling) == 1


def test_code_that_was_damaged_is_compiled_anew(folder, compiling):
    added(SMALL)
    (path,) = folder.iterdir()
    code = path.read_bytes()
    for damaged in (code[:-1], code[:40] + b"x" + code[41:], b""):
        path.write_bytes(damaged)
        module.loaded_function.cache_clear()
        assert not module.is_kept(SMALL)
        assert added(SMALL) == 2
        assert path.read_bytes() == code
    assert len(compiling) == 4


def test_what_nothing_has_used_for_long_is_removed(folder, compiling):
    old, used, new = (SMALL._replace(tile=tile) for tile in (1, 2, 3))
    for each in (old, used):
        added(each)
        path = module._path(each)
        os.utime(path, (path.stat().st_atime, path.stat().st_mtime - 61 * 86400))
    module.loaded_function.cache_clear()
    added(used)
    assert len(compiling) == 2
    added(new)
    assert [module.is_kept(each) for each in (old, used, new)] == [False, True, True]
    assert set(folder.iterdir()) == {module._path(each) for each in (used, new)}


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
        assert added(SMALL) == 2
        assert not module.is_kept(SMALL)
    finally:
        folder.parent.chmod(0o700)
