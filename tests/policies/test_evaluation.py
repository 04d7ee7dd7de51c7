"""The evaluator: seeded, honest about its spread, and the same as stepping by hand."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import scipy.stats

from iout_marl import Evaluation, InputError, World, evaluate, iout_v0, load_scenario
from iout_marl.evaluation import METRICS, Estimate
from iout_marl.files import to_json
from iout_marl.policies import BASELINES, Greedy
from iout_marl.world import node_codes

RANDOM_LAYOUT = {
    "nodes": {"kind": "random", "count": 4},
    "observation": {"node_positions": True, "time": True},
    "auvs.start_cells": [[5, 5, 2], [1, 2, 1]],
}
CONTRACT = [
    "mean_aoi", "final_aoi", "peak_aoi", "jain", "harvested_kj", "uplink_success", "reward",
]  # fmt: skip


@pytest.fixture(scope="module")
def random_layout():
    return load_scenario("paper/k3-fdd", RANDOM_LAYOUT)


def fixed_plan(observation):
    """Hears the oldest node, charges the one with the least energy, flies in a square."""
    k = (observation.shape[-1] - 4) // 5
    age, energy = observation[..., 3 : 3 + k], observation[..., 3 + k : 3 + 2 * k]
    direction = np.array([0, 2, 1, 3])[(observation[..., -1] * 100).round().astype(int) % 4]
    return np.stack([direction, energy.argmin(-1), age.argmax(-1)], axis=-1)


@pytest.mark.slow
@pytest.mark.parametrize("policy", [*BASELINES, fixed_plan])
def test_same_seed_same_figures(random_layout, policy):
    first, second = (evaluate(random_layout, policy, 5, seed=3) for _ in range(2))
    for name in METRICS:
        assert np.array_equal(first.samples[name], second.samples[name])


@pytest.mark.slow
@pytest.mark.parametrize("policy", [*BASELINES, fixed_plan])
def test_other_seed_other_figures(random_layout, policy):
    first, second = (evaluate(random_layout, policy, 5, seed=seed) for seed in (3, 99))
    assert not np.array_equal(first.samples["mean_aoi"], second.samples["mean_aoi"])


def test_global_generator_stays_as_it_was():
    before = np.random.get_state(legacy=False)  # noqa: NPY002
    evaluate("paper/k3-fdd", "random-walk", 2)
    after = np.random.get_state(legacy=False)  # noqa: NPY002
    assert (before["state"]["key"] == after["state"]["key"]).all()
    assert before["state"]["pos"] == after["state"]["pos"]


def test_episodes_are_those_of_environments_with_consecutive_seeds(random_layout):
    evaluation = evaluate(random_layout, fixed_plan, episodes=4, seed=11)
    env = iout_v0.parallel_env(random_layout)
    for i in range(4):
        observations, _ = env.reset(seed=11 + i)
        total, ages, peak = 0.0, [], 0.0
        while env.agents:
            stacked = np.stack([observations[a] for a in env.agents])[None]
            actions = dict(zip(env.agents, fixed_plan(stacked)[0], strict=True))
            observations, rewards, _, _, infos = env.step(actions)
            total += np.mean(list(rewards.values()))
            ages.append(observations["auv_0"][3:7].mean())
            peak = max(peak, observations["auv_0"][3:7].max())
        by_hand = {
            "mean_aoi": np.mean(ages),
            "final_aoi": ages[-1],
            "peak_aoi": peak,
            "jain": infos["auv_0"]["jain"],
            "harvested_kj": infos["auv_0"]["total_harvested_j"] / 1000,
            "reward": total,
        }
        for name, value in by_hand.items():
            assert evaluation.samples[name][i] == pytest.approx(value, rel=1e-5), name


def test_layouts_drawn_once_for_a_run_are_the_same_in_all_episodes(random_layout):
    scenario = load_scenario(random_layout, {"nodes.redraw": "run"})
    evaluation = evaluate(scenario, fixed_plan, episodes=4, seed=11)
    assert evaluation.episodes == 4
    assert len(set(evaluation.samples["mean_aoi"])) == 1
    env = iout_v0.parallel_env(scenario)
    env.reset(seed=11)
    layout = env.state()[: 6 + 3 * 4 + 3 * 4]

    class Watching(Greedy):
        def act(self, world, state, rng):
            seen.append(world.observer.observe_globally(state)[:, : len(layout)])
            return super().act(world, state, rng)

    seen = []
    evaluate(scenario, Watching(), episodes=3, seed=11)
    assert np.allclose(seen[0], layout)


def test_every_episode_is_whole(random_layout):
    slots = []
    evaluate(random_layout, lambda o: slots.append(o) or fixed_plan(o), episodes=2)
    assert len(slots) == random_layout.num_slots
    assert slots[0].shape == (2, 2, 3 + 2 * 4 + 3 * 4 + 1 + 3)
    assert slots[0].dtype == np.float32


@pytest.mark.parametrize("kind", [str, Path, load_scenario, lambda name: {"extends": name}])
def test_accepts_names_paths_mappings_and_scenarios(kind, tmp_path):
    (tmp_path / "mine.yaml").write_text("extends: paper/k3-fdd")
    expected = evaluate("paper/k3-fdd", "greedy", 2).samples["mean_aoi"]
    source = kind(str(tmp_path / "mine.yaml") if kind is Path else "paper/k3-fdd")
    assert np.array_equal(evaluate(source, "greedy", 2).samples["mean_aoi"], expected)


@pytest.mark.parametrize(
    ("policy", "name"), [("greedy", "greedy"), (Greedy(), "greedy"), (fixed_plan, "fixed_plan")]
)
def test_policy_is_called_by_its_name(random_layout, policy, name):
    assert evaluate(random_layout, policy, 1).policy == name


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (
            ("paper/k3-fdd", "gredy"),
            "policy gredy: neither a baseline nor the folder of a run; did you mean 'greedy'?",
        ),
        (("paper/k3-fd", "greedy"), "no scenario 'paper/k3-fd'"),
        (("paper/k3-fdd", "greedy", 0), "episodes must be at least 1, not 0"),
        (("paper/k3-fdd", "greedy", -1), "episodes must be at least 1, not -1"),
        (("paper/k3-fdd", "greedy", 10**19), "episodes must be at most 1,000,000, not 1000000"),
        (("paper/k3-fdd", "greedy", 10**6000), "not a number of too many digits"),
        (("paper/k3-fdd", "greedy", 1.5), "episodes must be a whole number, not 1.5"),
        (("paper/k3-fdd", "greedy", "3"), "episodes must be a whole number, not '3'"),
        (("paper/k3-fdd", "greedy", True), "episodes must be a whole number, not True"),
        (("paper/k3-fdd", "greedy", None), "episodes must be a whole number, not None"),
        (("paper/k3-fdd", "greedy", math.nan), "episodes must be a whole number, not nan"),
        (("paper/k3-fdd", "greedy", math.inf), "episodes must be at most 1,000,000, not inf"),
        (("paper/k3-fdd", "greedy", [3, 4]), "episodes must be a whole number, not [3, 4]"),
        (("paper/k3-fdd", "greedy", 1, -1), "seed must be at least 0, not -1"),
        (("paper/k3-fdd", "greedy", 1, 0.5), "seed must be a whole number, not 0.5"),
        (("paper/k3-fdd", "greedy", 1, None), "seed must be a whole number, not None"),
        (("paper/k3-fdd", "greedy", 1, 2**64), "seed must be at most 18,446,"),
        (("paper/k3-fdd", ""), "policy '': neither a baseline nor the folder of a run"),
        (("paper/k3-fdd", "."), ".: holds no trained policy"),
        (("paper/k3-fdd", Path()), ".: holds no trained policy"),
        (("paper/k3-fdd", Path("missing")), "policy missing: neither a baseline nor"),
    ],
)
def test_bad_arguments(arguments, expected):
    with pytest.raises(InputError) as raised:
        evaluate(*arguments)
    assert expected in str(raised.value)


@pytest.mark.parametrize("number", [np.int64(2), np.uint8(2), 2.0, np.float32(2)])
def test_whole_numbers_of_any_type(number):
    found = evaluate("paper/k3-fdd", "greedy", number, number)
    assert (found.episodes, found.seed) == (2, 2)
    assert json.loads(to_json(found.to_json()))["seed"] == 2


@pytest.mark.parametrize("policy", [3, None, 0.5, [1], {"name": "x"}], ids=str)
def test_policy_that_is_none(policy):
    with pytest.raises(TypeError, match="a policy needs a name and a method act, or must be"):
        evaluate("paper/k3-fdd", policy)


def test_class_of_a_policy():
    with pytest.raises(TypeError, match=r"must be an object, not its class: Greedy\(…\)"):
        evaluate("paper/k3-fdd", Greedy)


@pytest.mark.parametrize(
    "choose",
    [
        lambda seen: None,
        lambda seen: 3,
        lambda seen: [],
        lambda seen: "north",
        lambda seen: [[[0, 0, 0]]],
        lambda seen: [[[0, 0, 0]], [[0, 0]]],
        lambda seen: np.zeros((*seen.shape[:2], 3)),
        lambda seen: np.full((*seen.shape[:2], 3), np.nan),
        lambda seen: np.zeros((*seen.shape[:2], 2), dtype=int),
        lambda seen: np.full((*seen.shape[:2], 3), 99),
    ],
)
def test_bad_actions_are_refused_in_one_line_that_names_the_policy(choose):
    choose.__name__ = "choose"
    with pytest.raises(InputError) as raised:
        evaluate("paper/k3-fdd", choose, 2)
    line = str(raised.value)
    assert line.startswith("policy choose, slot 1: ")
    assert "action" in line
    assert len(line) < 400


def test_actions_may_be_a_list():
    found = evaluate("paper/k3-fdd", lambda seen: [[[0, 1, 2]]] * len(seen), 2)
    assert found.episodes == 2


def test_what_a_policy_raises_is_told_with_its_place():
    def fails(seen):
        raise ZeroDivisionError("in a policy")

    line = r"^policy fails: raises ZeroDivisionError: in a policy \(.*test_evaluation\.py:\d+\)$"
    with pytest.raises(InputError, match=line) as raised:
        evaluate("paper/k3-fdd", fails, 2)
    assert isinstance(raised.value.__cause__, ZeroDivisionError)


@pytest.mark.parametrize("count", [2, 3, 10, 100])
def test_interval_is_that_of_students_t(count):
    samples = np.random.default_rng(count).normal(5, 2, count)
    estimate = Estimate.from_samples(samples)
    low, high = scipy.stats.t.interval(
        0.95, count - 1, loc=samples.mean(), scale=scipy.stats.sem(samples)
    )
    assert (estimate.mean, estimate.low, estimate.high) == pytest.approx(
        (samples.mean(), low, high), rel=1e-12
    )
    assert estimate.margin == pytest.approx((high - low) / 2)


@pytest.mark.parametrize("count", [3, 20])
def test_interval_covers_the_mean_in_95_of_100_cases(count):
    rng = np.random.default_rng(0)
    estimates = [Estimate.from_samples(rng.normal(7, 3, count)) for _ in range(4000)]
    covered = np.mean([e.low <= 7 <= e.high for e in estimates])
    # Four standard deviations of such a share.
    assert covered == pytest.approx(0.95, abs=4 * math.sqrt(0.95 * 0.05 / 4000))


def test_equal_samples_leave_no_interval():
    estimate = Estimate.from_samples([4.0, 4.0, 4.0])
    assert (estimate.low, estimate.mean, estimate.high) == (4, 4, 4)


def test_json_has_the_schema_of_the_contract():
    evaluation = evaluate("best/k3-tdd", "greedy", episodes=3, seed=2)
    record = json.loads(json.dumps(evaluation.to_json(), allow_nan=False))
    assert list(record) == [
        *("scenario", "scenario_hash", "policy", "episodes", "deterministic", "seed", "metrics")
    ]
    assert record["scenario"] == "best/k3-tdd"
    assert record["scenario_hash"] == load_scenario("best/k3-tdd").hash
    assert (record["policy"], record["episodes"], record["seed"]) == ("greedy", 3, 2)
    assert set(CONTRACT) <= set(record["metrics"])
    for metric in record["metrics"].values():
        assert list(metric) == ["mean", "ci95"]
        low, high = metric["ci95"]
        assert low <= metric["mean"] <= high


def test_single_episode_has_a_null_interval_in_json():
    record = evaluate("paper/k3-fdd", "greedy", episodes=1).to_json()
    for metric in record["metrics"].values():
        assert metric["ci95"] is None
    assert json.loads(json.dumps(record, allow_nan=False)) == record


def test_metrics_are_those_of_the_world(random_layout):
    evaluation = evaluate(random_layout, fixed_plan, episodes=3, seed=5)
    world = World(random_layout, 3)
    streams = [np.random.default_rng(5 + i) for i in range(3)]
    state = world.reset(node_codes(random_layout, world.grid, streams))
    for _ in range(world.num_slots):
        observation = np.asarray(world.observe(state), dtype=np.float32)
        state, _ = world.step(state, fixed_plan(observation))
    for name, values in world.metrics(state).items():
        assert np.array_equal(evaluation.samples[name], values), name


def test_evaluation_keeps_every_sample():
    evaluation = evaluate("paper/k3-fdd", "random-walk", episodes=6)
    assert isinstance(evaluation, Evaluation)
    for name, estimate in evaluation.metrics.items():
        assert evaluation.samples[name].shape == (6,)
        assert estimate.mean == pytest.approx(evaluation.samples[name].mean())


@pytest.mark.parametrize(
    "action",
    [[7, 0, 0], [-1, 0, 0], [0, 12, 0], [0.9, 0, 0], [0, 0]],
    ids=["direction", "negative", "node", "float", "short"],
)
def test_actions_outside_their_space_are_refused(action):
    with pytest.raises(ValueError, match="action"):
        evaluate("paper/k10-fdd", lambda seen: np.tile(action, (*seen.shape[:2], 1)), 2)
