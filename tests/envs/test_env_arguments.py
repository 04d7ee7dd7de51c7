"""Every factory and every call refuses a bad argument in one line that names it."""

import itertools
import math
import pathlib

import gymnasium
import numpy as np
import pettingzoo
import pytest
from env_cases import SLOTS, scenario
from gymnasium.vector import AutoresetMode
from gymnasium.wrappers.vector import (
    ClipReward,
    DictInfoToList,
    FlattenObservation,
    NormalizeObservation,
    NormalizeReward,
    NumpyToTorch,
    RecordEpisodeStatistics,
    TransformObservation,
)

from iout_marl import World, iout_v0, load_scenario
from iout_marl.envs import AUVEnv, AUVParallelEnv, AUVVectorEnv, sb3_vec_env, supersuit_vec_env
from iout_marl.errors import InputError
from iout_marl.world import node_codes

WORLD = scenario()
FACTORIES = {
    "parallel_env": iout_v0.parallel_env,
    "raw_env": iout_v0.raw_env,
    "env": iout_v0.env,
    "AUVParallelEnv": AUVParallelEnv,
    "AUVEnv": AUVEnv,
    "AUVVectorEnv": AUVVectorEnv,
    "sb3_vec_env": sb3_vec_env,
    "supersuit_vec_env": supersuit_vec_env,
    "gymnasium.make": lambda scenario, **more: gymnasium.make(
        "iout_marl:AUV-v0", scenario=scenario, **more
    ),
    "gymnasium.make_vec": lambda scenario, **more: gymnasium.make_vec(
        "iout_marl:AUV-v0", scenario=scenario, **more
    ),
}
NO_COUNT = [0, -1, 1.5, "2", True, None, math.nan, [2], 10**30, np.array([2])]
each_factory = pytest.mark.parametrize("make", FACTORIES.values(), ids=FACTORIES)


@each_factory
@pytest.mark.parametrize("bad", [None, 5, 1.5, True, ["paper/k3-fdd"], object()])
def test_what_is_no_scenario_is_refused(make, bad):
    with pytest.raises(InputError, match=r"^scenario: must be a name, a path, a mapping"):
        make(bad)


@each_factory
@pytest.mark.parametrize("bad", ["paper/k3-fd", "", pathlib.Path("nowhere.yaml"), {}, {"x": 1}])
def test_an_unknown_or_incomplete_scenario_is_refused_in_one_line(make, bad):
    with pytest.raises(InputError) as refused:
        make(bad)
    assert str(refused.value).isprintable()


@each_factory
def test_a_mapping_is_a_scenario(make):
    make({"extends": "paper/k3-fdd", "episode": {"duration_s": 100.0}}).close()


# `gymnasium.make` warns of these itself.
@pytest.mark.parametrize("name", sorted(set(FACTORIES) - {"supersuit_vec_env", "gymnasium.make"}))
@pytest.mark.parametrize("bad", ["ascii", "", 1, True, ["human"], b"human", "HUMAN"])
def test_an_unknown_render_mode_is_refused(name, bad):
    with pytest.raises(InputError, match=r"^render_mode must be one of .* or None, not "):
        FACTORIES[name](WORLD, render_mode=bad)


@pytest.mark.parametrize("make", [iout_v0.parallel_env, iout_v0.raw_env, iout_v0.env])
@pytest.mark.parametrize("bad", [each for each in NO_COUNT if each is not None])
def test_max_cycles_that_is_no_count_is_refused(make, bad):
    with pytest.raises(InputError, match=r"^max_cycles must be (a whole number|at (least|most))"):
        make(WORLD, max_cycles=bad)


@pytest.mark.parametrize("cycles", [1, 7, np.int64(3), 12_345, 1e3, np.float64(3)])
def test_max_cycles_is_the_number_of_slots(cycles):
    assert iout_v0.parallel_env("paper/k3-fdd", max_cycles=cycles).scenario.num_slots == cycles


@pytest.mark.parametrize("bad", NO_COUNT)
def test_num_envs_that_is_no_count_is_refused(bad):
    for make in (lambda n: AUVVectorEnv(WORLD, n), lambda n: World(WORLD, n)):
        with pytest.raises(InputError, match=r"^num_envs must be (a whole number|at (least|most))"):
            make(bad)
    for make in (sb3_vec_env, supersuit_vec_env):
        with pytest.raises(InputError, match=r"^num_envs must be (a whole number|at (least|most))"):
            make(WORLD, num_envs=bad)


@pytest.mark.parametrize("count", [2.0, np.int64(2), np.float32(2)])
def test_num_envs_may_be_of_any_type_of_whole_numbers(count):
    assert World(WORLD, count).num_envs == AUVVectorEnv(WORLD, count).num_envs == 2
    assert sb3_vec_env(WORLD, count).num_envs == 2


@pytest.mark.parametrize("bad", [-1, 0.5, "1", None, True, 10**6])
def test_processes_that_are_no_count_are_refused(bad):
    with pytest.raises(InputError, match=r"^processes must be (a whole number|at (least|most))"):
        supersuit_vec_env(WORLD, processes=bad)


@pytest.mark.parametrize("bad", ["SameSteps", "", 1, True, ["SameStep"], "same_step"])
def test_an_unknown_autoreset_mode_is_refused(bad):
    with pytest.raises(InputError, match=r"^autoreset_mode: no mode is called"):
        AUVVectorEnv(WORLD, autoreset_mode=bad)


@pytest.mark.parametrize("bad", ["float16", "int64", None, 64, np.float64])
def test_another_type_of_numbers_is_refused(bad):
    with pytest.raises(InputError, match=r"^dtype must be one of float64, float32, not"):
        World(WORLD, dtype=bad)


def test_a_world_is_given_its_layouts_or_draws_them_but_not_both():
    world = World("paper/k3-fdd", 2, overrides={"nodes": {"kind": "random", "count": 3}})
    layouts = node_codes(world.scenario, world.grid, [np.random.default_rng(i) for i in (7, 8)])
    assert (world.reset(seed=7).node_cell == layouts).all()
    assert (world.reset(layouts).node_cell == layouts).all()
    assert (world.reset().node_cell != world.reset().node_cell).any()
    with pytest.raises(InputError, match=r"^seed: node_cell says where the nodes lie"):
        world.reset(layouts, seed=7)
    for bad in (-1, 1.5, "7", True):
        with pytest.raises(InputError, match=r"^seed must be (a whole number|at least 0), not"):
            world.reset(seed=bad)


# Calls ----------------------------------------------------------------------------------

APIS = {name: FACTORIES[name] for name in ("parallel_env", "raw_env", "env", "AUVEnv")}
APIS["AUVVectorEnv"] = lambda world: AUVVectorEnv(world, 2)
each_api = pytest.mark.parametrize("make", APIS.values(), ids=APIS)


@each_api
@pytest.mark.parametrize("bad", [-1, "x", 1.5, True, b"1", {"seed": 1}, object(), math.nan])
def test_what_is_no_seed_is_refused(make, bad):
    env = make(WORLD)
    with pytest.raises(InputError, match=r"^seed must be (a whole number|at least 0), not "):
        env.reset(seed=bad)
    env.reset(seed=0)


@each_api
@pytest.mark.parametrize("seed", [0, np.int64(5), 2**40, 1e3, np.float64(3), None])
def test_seeds_may_be_of_any_type_of_whole_numbers(make, seed):
    make(WORLD).reset(seed=seed)


@pytest.mark.parametrize(
    ("seeds", "message"),
    [
        ([1, -1], r"^seed\[1\] must be"),
        ([1, "x"], r"^seed\[1\] must be"),
        ([1, 1.5], r"^seed\[1\] must be"),
        ([1, 2, 3], "^seed: expected 2 seeds, not 3"),
        ([], "^seed: expected 2 seeds, not 0"),
    ],
)
def test_a_bad_seed_among_several_is_named(seeds, message):
    with pytest.raises(InputError, match=message):
        AUVVectorEnv(WORLD, 2).reset(seed=seeds)


@each_api
@pytest.mark.parametrize("bad", [1, "x", [1], object()])
def test_options_that_are_no_mapping_are_refused(make, bad):
    with pytest.raises(InputError, match=r"^options must be a mapping or None, not"):
        make(WORLD).reset(options=bad)


@each_api
def test_unknown_options_have_no_effect(make):
    make(WORLD).reset(seed=0, options={"layout": 3})


@each_api
def test_closing_twice_and_rendering_without_a_mode_do_nothing(make):
    env = make(WORLD)
    env.reset(seed=0)
    assert env.render() is None
    env.close()
    env.close()


GOOD = {"parallel_env": {"auv_0": [0, 0, 0]}, "AUVVectorEnv": [[0, 0, 0]] * 2}


@each_api
def test_steps_before_a_reset_and_after_the_end_are_refused_alike(make, request):
    name = request.node.callspec.id
    action = GOOD.get(name, np.array([0, 0, 0]))
    env = AUVVectorEnv(WORLD, 2, autoreset_mode="Disabled") if "Vector" in name else make(WORLD)
    if name != "raw_env":  # PettingZoo's own form, without checks
        with pytest.raises(
            RuntimeError, match=r"^the episode has not begun: call reset\(\) first$"
        ):
            env.step(action)
    env.reset(seed=0)
    for _ in range(SLOTS):
        env.step(action)
    if name == "env":
        with pytest.raises(InputError, match=r"the episode of auv_0 is over: step\(None\)"):
            env.step(action)
        env.step(None)
    if name != "raw_env":
        with pytest.raises(RuntimeError, match=r"^the episode is over: call reset\(\) first$"):
            env.step(action)
    env.reset()
    env.step(action)


BAD_ACTIONS = [
    [6, 0, 0],
    [0, 0, 3],
    [0, -1, 0],
    [0, 0],
    [0, 0, 0, 0],
    [0.0, 0, 0],
    None,
    "000",
    3,
    [[0, 0, 0]],
    [0, [0], 0],
    [math.nan, 0, 0],
    [2**63, 0, 0],
    [10**30, 0, 0],
    object(),
]


@each_api
@pytest.mark.parametrize("bad", BAD_ACTIONS)
def test_a_bad_action_is_refused_in_one_line_and_changes_nothing(make, bad):
    env = make(WORLD)
    env.reset(seed=0)
    if isinstance(env, AUVParallelEnv):
        bad = {"auv_0": bad}
    elif isinstance(env, AUVVectorEnv):
        bad = [[0, 0, 0], bad]
    with pytest.raises(InputError, match=r"action.* (must|lies outside)") as refused:
        env.step(bad)
    assert str(refused.value).isprintable()
    assert not env.unwrapped._episodes.current.slot.any()


def test_unknown_agents_are_refused_by_name():
    env = iout_v0.parallel_env(scenario(auvs=3))
    env.reset(seed=0)
    good = {agent: [0, 0, 0] for agent in env.agents}
    calls = [
        lambda: env.step(good | {"auv_3": [0, 0, 0]}),
        lambda: env.action_space("auv_3"),
        lambda: env.observation_space("auv_3"),
    ]
    for call in calls:
        with pytest.raises(InputError, match=r"^there is no agent 'auv_3'; did you mean 'auv_"):
            call()
    for bad in ([[0, 0, 0]] * 3, None, 3):
        with pytest.raises(InputError, match=r"^actions must be a mapping by agent, not"):
            env.step(bad)
    aec = iout_v0.env(scenario(auvs=3))
    aec.reset(seed=0)
    with pytest.raises(InputError, match=r"^there is no agent 'auv_3'"):
        aec.observe("auv_3")
    env.step(good)


def test_the_action_that_is_wrong_is_named():
    env = iout_v0.parallel_env(scenario(auvs=3))
    env.reset(seed=0)
    with pytest.raises(InputError, match=r"auv_1: action \[0, 0, 3\] lies outside"):
        env.step({"auv_0": [0, 0, 0], "auv_1": [0, 0, 3], "auv_2": [0, 0, 0]})
    envs = AUVVectorEnv(WORLD, 3)
    envs.reset(seed=0)
    with pytest.raises(InputError, match=r"^environment 2, auv_0: action \[9, 0, 0\] lies outside"):
        envs.step([[0, 0, 0], [0, 0, 0], [9, 0, 0]])


# Infos ----------------------------------------------------------------------------------


@pytest.mark.parametrize("auvs", [1, 3])
def test_infos_of_single_environments_are_plain_numbers(auvs):
    world = scenario("tdd", auvs)
    joint, parallel = AUVEnv(world), iout_v0.parallel_env(world)
    infos = [joint.reset(seed=0)[1], parallel.reset(seed=0)[1]["auv_0"]]
    infos += [joint.step([0, 0] * auvs)[-1]]
    infos += [parallel.step({a: [0, 0] for a in parallel.agents})[-1]["auv_0"]]
    for info in infos:
        assert {type(value) for value in info.values()} == {float}


# Gymnasium's vector wrappers ------------------------------------------------------------

MODES = pytest.mark.parametrize("mode", AutoresetMode, ids=lambda mode: mode.name)
WRAPPERS = {
    "statistics": RecordEpisodeStatistics,
    "observations": NormalizeObservation,
    "rewards": NormalizeReward,
    "clip": lambda env: ClipReward(env, -1, 1),
    "list": DictInfoToList,
    "flatten": FlattenObservation,
    "torch": NumpyToTorch,
    "transform": lambda env: TransformObservation(env, lambda o: o / 2, env.observation_space),
}


def test_make_vec_takes_an_autoreset_mode():
    for mode, form in itertools.product(AutoresetMode, ["name", "value", None]):
        given = mode if form is None else getattr(mode, form)
        envs = gymnasium.make_vec(
            "iout_marl:AUV-v0", num_envs=2, scenario=WORLD, autoreset_mode=given
        )
        assert envs.metadata["autoreset_mode"] is mode
    # Of one environment's own, not of the class.
    assert AUVVectorEnv.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert AUVVectorEnv(WORLD).metadata["autoreset_mode"] is AutoresetMode.SAME_STEP


@pytest.mark.parametrize("wrap", WRAPPERS.values(), ids=WRAPPERS)
def test_gymnasiums_vector_wrappers_take_mode_next_step(wrap):
    envs = wrap(AUVVectorEnv(scenario(layout="episode"), 3, autoreset_mode="NextStep"))
    envs.reset(seed=0)
    for _ in range(3 * SLOTS):
        envs.step(np.zeros((3, 3), dtype=int))
    envs.close()


@MODES
def test_statistics_count_whole_episodes_in_every_mode(mode):
    envs = RecordEpisodeStatistics(AUVVectorEnv(WORLD, 2, autoreset_mode=mode))
    envs.reset(seed=0)
    lengths, total, totals = [], np.zeros(2), []
    for _ in range(3 * SLOTS + 3):
        _, rewards, _, truncations, infos = envs.step([[0, 1, 1], [1, 0, 0]])
        total = total + rewards
        if truncations.all():
            lengths.append(infos["episode"]["l"].tolist())
            np.testing.assert_allclose(infos["episode"]["r"], total)
            totals.append(total)
            total = np.zeros(2)
            if mode is AutoresetMode.DISABLED:
                envs.reset(options={"reset_mask": np.ones(2, dtype=bool)})
    assert lengths == [[SLOTS, SLOTS]] * 3


def test_a_step_that_begins_the_next_episode_reads_no_actions():
    envs = AUVVectorEnv(scenario(layout="episode"), 2, autoreset_mode="NextStep")
    envs.reset(seed=0)
    for _ in range(SLOTS):
        *_, truncations, infos = envs.step([[0, 0, 0]] * 2)
    assert truncations.all()
    assert "final_obs" not in infos
    observations, rewards, terminations, truncations, infos = envs.step([[99, 0, 0]] * 2)
    assert rewards.tolist() == [0, 0]
    assert not (terminations | truncations).any()
    assert infos["total_harvested_j"].tolist() == [0, 0]
    single = AUVEnv(scenario(layout="episode"))
    single.reset(seed=1)
    np.testing.assert_array_equal(observations[1], single.reset()[0])


def test_pettingzoos_registry_names_arguments_as_well():
    with pytest.raises(InputError, match=r"^max_cycles must be"):
        pettingzoo.make("parallel", "iout/AUV-v0", scenario=WORLD, max_cycles=0)


# The world ------------------------------------------------------------------------------


def world_and_state(num_envs=1, **changes):
    world = World(scenario(**changes), num_envs)
    rngs = [np.random.default_rng(i) for i in range(num_envs)]
    return world, world.reset(node_codes(world.scenario, world.grid, rngs))


@pytest.mark.parametrize(
    ("layout", "message"),
    [
        ([[10**6, 0, 1]], "1000000 is the code of no cell"),
        ([[-1, 0, 1]], "-1 is the code of no cell"),
        ([[0, 4, 1]], "4 is the code of no cell"),  # between those of cells
        ([[0, 0, 1]] * 5, r"of shape \(1, 3\), not \(5, 3\)"),
        ([[0, 1]], r"of shape \(1, 3\), not \(1, 2\)"),
        ([0, 1, 2], r"of shape \(1, 3\), not \(3,\)"),
        ([[0.0, 1, 2]], "must be integers"),
        ("abc", "must be integers"),
    ],
)
def test_a_layout_off_the_grid_is_refused(layout, message):
    with pytest.raises(InputError, match=f"^node_cell.*{message}"):
        World(WORLD).reset(layout)


@pytest.mark.parametrize("library", ["numpy", "torch"])
def test_a_checked_step_takes_what_step_takes(library):
    torch = pytest.importorskip("torch")
    world = World(WORLD, 2, library=torch if library == "torch" else np)
    state = world.reset(node_codes(WORLD, world.grid, [np.random.default_rng(0)] * 2))
    action = [[[0, 1, 2]], [[5, 0, 0]]]
    expected, _ = world.step(state, world.backend.integers(action))
    for form in (action, np.array(action, dtype=np.int8), torch.tensor(action)):
        found, _ = world.checked_step(state, form)
        assert (found.cell == expected.cell).all()


@pytest.mark.parametrize("bad", BAD_ACTIONS)
def test_a_checked_step_refuses_a_bad_action(bad):
    world, state = world_and_state(2)
    with pytest.raises(InputError):
        world.checked_step(state, [[[0, 0, 0]], [bad]])


def test_a_checked_step_refuses_another_worlds_state_and_the_end():
    world, state = world_and_state()
    _, five = world_and_state(5)
    with pytest.raises(InputError, match=r"^state must be one that"):
        world.checked_step(None, [[[0, 0, 0]]])
    with pytest.raises(InputError, match=r"^state is that of another world"):
        world.checked_step(five, [[[0, 0, 0]]])
    for _ in range(SLOTS):
        state, _ = world.checked_step(state, [[[0, 0, 0]]])
    with pytest.raises(RuntimeError, match=r"^the episode is over, after 10 slots"):
        world.checked_step(state, [[[0, 0, 0]]])


# Small grids ----------------------------------------------------------------------------

SIZES = list(itertools.product([1, 2], repeat=3))


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES, ids=str)
@pytest.mark.parametrize("motion", ["six", "hover"])
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_a_mask_allows_no_way_out_of_the_grid_and_always_one_to_go(size, motion, duplex):
    changes = {
        "grid.cells": list(size),
        "nodes": {"kind": "fixed", "cells": [[1, 1, 1]], "count": 1},
        "auvs": {"start_cells": [[1, 1, 1]], "speed_m_per_s": 4.0, "motion": motion},
        "observation.action_mask": "info",
    }
    env = iout_v0.parallel_env(load_scenario(f"paper/k3-{duplex}", changes))
    _, infos = env.reset(seed=0)
    rng = np.random.default_rng(0)
    while env.agents:
        mask = infos["auv_0"]["action_mask"]
        directions = np.flatnonzero(mask[: 7 if motion == "hover" else 6])
        assert directions.size
        assert mask[-1]
        nodes = [0] * (len(env.action_space("auv_0").nvec) - 1)
        before = env._episodes.current.cell.copy()
        _, _, _, _, infos = env.step({"auv_0": [int(rng.choice(directions)), *nodes]})
        assert not env._episodes._running.last("left_grid").any()
        if size == (1, 1, 1):
            assert (env._episodes.current.cell == before).all()


def test_too_little_room_is_said_by_the_scenario_where_it_is_written(tmp_path):
    file = tmp_path / "mine.yaml"
    file.write_text("extends: paper/k3-fdd\nauvs:\n  count: 5\n  separation_cells: 9\n")
    with pytest.raises(InputError, match=r"mine\.yaml:3: auvs\.count: is 5, but only 1 AUVs find"):
        load_scenario(file)
