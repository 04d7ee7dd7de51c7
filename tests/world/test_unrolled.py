"""A slot of one environment, number by number, is that of the batched world to the last digit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_world_laws import ACCESS, NAMES, STARTS

from iout_marl.scenario import load_scenario
from iout_marl.tracing.library import UnknownOperationError
from iout_marl.tracing.program import Program
from iout_marl.tracing.symbols import LIBRARY, SymbolArray
from iout_marl.tracing.unrolled import UnrolledSlot, numbers, pays_unrolled, unrolled_slot
from iout_marl.world import World, node_codes

#: Settings that between them use every part of the world.
PARTS = st.fixed_dictionaries(
    {},
    optional={
        "auvs.motion": st.sampled_from(["six", "hover"]),
        "auvs.separation_cells": st.sampled_from([0, 1, 3]),
        "auvs.idle_choices": st.booleans(),
        "episode.slot_s": st.sampled_from([None, 7, 25, 60]),
        "channel.access": st.sampled_from(ACCESS),
        "observation.kind": st.sampled_from(["paper", "scaled"]),
        "observation.node_positions": st.booleans(),
        "observation.time": st.booleans(),
        "observation.other_auvs": st.booleans(),
        "observation.agent_index": st.booleans(),
        "observation.view_range_m": st.sampled_from([None, 300]),
        "reward.credit": st.sampled_from(["team", "difference"]),
        "uplink.packet_bits": st.sampled_from([10000, 60000]),
        "age.maximum": st.sampled_from([5, 100]),
        "age.sampling": st.sampled_from(["slot_end", "packet_start"]),
    },
)
PAPERS_REWARD = st.fixed_dictionaries(
    {},
    optional={
        "reward.unserved_penalty": st.just(0.5),
        "reward.no_able_node_penalty": st.just(3.0),
        "reward.only_transmitting_penalty": st.just(2.0),
        "reward.separation_penalty": st.just(4.0),
    },
)


def assert_alike(scenario, slots=40, seed=0):
    world = World(scenario)
    rng = np.random.default_rng(seed)
    state = world.reset(node_codes(scenario, world.grid, [rng]))
    slot = UnrolledSlot(scenario, with_mask=True)
    now = numbers(state)
    for _ in range(slots):
        shape = (1, world.num_auvs)
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
        state, events = world.step(state, action)
        now, last, reward, observation, mask = slot(now, numbers([action]))
        assert now == numbers(state)
        assert last == numbers(events)
        # Sums with weights: NumPy adds up in an order of its own.
        np.testing.assert_allclose(reward, world.reward(state, events)[0], 1e-12, 1e-12)
        assert observation == numbers([world.observe(state)])
        assert mask == numbers([world.action_mask(state)])
        again = (*slot.state(now), *slot.events(last))
        for found, array in zip(again, (*state, *events), strict=True):
            assert found.dtype == array.dtype
            np.testing.assert_array_equal(found, array)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.sampled_from(NAMES), st.integers(1, 4), PARTS, PAPERS_REWARD, st.integers(0, 10**6))
def test_unrolled_slot_is_that_of_the_world(name, auvs, parts, rewards, seed):
    starts = {"auvs.start_cells": [*STARTS, [3, 8, 2]][:auvs]}
    settings = parts | starts | (rewards if name.startswith("paper") else {})
    if auvs == 1:
        settings.pop("auvs.separation_cells", None)
    assert_alike(load_scenario(name, settings), seed=seed)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["paper/k10-fdd", "best/k10-tdd", "multi/m3-k10-fdd"])
def test_unrolled_slot_is_that_of_the_world_for_a_whole_episode(name):
    scenario = load_scenario(name)
    assert pays_unrolled(scenario)
    assert_alike(scenario, scenario.num_slots)


def test_unequal_nodes():
    scenario = load_scenario("paper/k5-fdd", {"nodes.weights": [1, 2, 3, 0.5, 0.7]})
    assert_alike(scenario)


@pytest.mark.parametrize(("auvs", "nodes", "pays"), [(1, 40, True), (1, 41, False), (5, 5, False)])
def test_large_networks_and_teams_are_left_to_numpy(auvs, nodes, pays):
    settings = {"auvs.count": auvs, "nodes": {"kind": "random", "count": nodes}}
    assert pays_unrolled(load_scenario("multi/m4-k10-fdd", settings)) is pays


def test_large_grids_are_left_to_numpy():
    scenario = load_scenario("paper/k10-fdd", {"grid.cells": [100, 100, 4]})
    assert not pays_unrolled(scenario)


def test_unrolled_slot_of_a_scenario_is_made_once():
    first, second = (load_scenario("paper/k3-fdd") for _ in range(2))
    assert unrolled_slot(first) is unrolled_slot(second)
    assert unrolled_slot(first) is not unrolled_slot(first, with_mask=True)


def evaluated(function, *values):
    """A function of symbols at some values."""
    program = Program()
    symbols = [
        SymbolArray.unknown(program, f"x{i}", np.array([value])) for i, value in enumerate(values)
    ]
    parameters = [symbol.values.tolist() for symbol in symbols]
    result = program.function(parameters, [function(*symbols).values.tolist()])
    return result(*((value,) for value in values))[0]


def test_a_number_out_of_bounds_is_what_numpy_makes_of_it():
    assert evaluated(lambda a, b: a / b, 1.0, 0.0) == np.inf
    assert np.isnan(evaluated(lambda a, b: a / b, 0.0, 0.0))
    assert np.isnan(evaluated(LIBRARY.sqrt, -1.0))
    assert evaluated(LIBRARY.where, True, -0.0, np.inf) == 0.0


def test_lines_without_a_use_and_repeated_ones_are_left_out():
    program = Program()
    a = SymbolArray.unknown(program, "a", np.array([2.0]))
    assert (a + 1.0).values[0] is (a + 1.0).values[0]
    unused = a * 7.0
    function = program.function([a.values.tolist()], [((a + 1.0) * (a + 1.0)).values.tolist()])
    assert function((2.0,)) == (9.0,)
    assert 7.0 not in function.__code__.co_consts
    assert unused.values[0].name not in function.__code__.co_varnames


@pytest.mark.parametrize(
    "operation",
    [
        lambda a: a**3,
        lambda a: bool(a > 0),
        lambda a: float(a[0]),
        np.argsort,
        LIBRARY.cumulative_sum,
        lambda a: LIBRARY.astype(a, np.int32),
        lambda a: a @ np.ones((2, 2)),
        lambda a: ~a,
        lambda a: a & a,
    ],
)
def test_what_no_symbol_can_answer_is_refused(operation):
    with pytest.raises(UnknownOperationError):
        operation(SymbolArray.unknown(Program(), "a", np.array([2.0, 1.0])))
