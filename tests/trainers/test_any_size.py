"""Runs whose networks are for any size: where they play, and what begins with their weights."""

import numpy as np
import pytest
import torch

from iout_marl import evaluate, iout_v0, load_policy, load_scenario, pretrained
from iout_marl.errors import InputError, InputTypeError
from iout_marl.policies import BestOf, GuidedBeam, make_baseline
from iout_marl.policies.guided import GuidedSearch
from iout_marl.policies.rehearsal import Mirror
from iout_marl.world import World
from trainers import Trainer, train, trained
from trainers.runs.loading import load_run

SMALL = {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "pair_width": 4, "critic_width": 8}
SETTINGS = {
    "observation": {"kind": "table"},
    "training.network": SMALL,
    "training.environments": 4,
    "training.rollout_slots": 10,
    "training.minibatches": 2,
    "training.steps": 40,
    "training.mask_actions": True,
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """The folder of a short run on the paper's three nodes."""
    folder = tmp_path_factory.mktemp("any-size") / "run"
    train("paper/k3-fdd", folder, overrides=SETTINGS, evaluation_episodes=1)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["paper/k3-fdd", "random/k7-fdd", "multi/m2-k10-fdd", "sea/bay", "multi/m2-k13-fdd"]
)
def test_plays_anywhere(run, name):
    """Also where the scenario shows something else to others; masks hold."""
    policy = load_policy(run)
    world = World(name, 3)
    state = world.reset(seed=1)
    chance = world.expected
    for _ in range(4):
        action = policy.act(world, state, np.random.default_rng(0))
        starts = np.cumsum([0, *world.action_sizes[:-1]])
        mask = np.asarray(world.action_mask(state))
        assert np.take_along_axis(mask, action + starts, axis=-1).all()
        state, _ = world.step(state, action, chance)


@pytest.mark.parametrize("sampled", [False, True])
@pytest.mark.parametrize("name", ["random/k7-fdd", "multi/m2-k10-fdd"])
def test_parts_of_the_environments_decide_as_all_of_them(run, monkeypatch, name, sampled):
    world, policy = World(name, 7), load_policy(run, sampled=sampled)
    state = world.reset(seed=1)
    together = policy.act(world, state, np.random.default_rng(0))
    rows = world.num_auvs * world.num_nodes
    for at_once in (1, 2 * rows, 7 * rows):  # fewer than one environment's, two's, all
        monkeypatch.setattr(trained, "_ROWS_AT_ONCE", at_once)
        actions = policy.act(world, state, np.random.default_rng(0))
        np.testing.assert_array_equal(actions, together)


@pytest.mark.slow
def test_sees_what_a_table_shows(run):
    """Actions in the scenario as it is are those in the same one with tables."""
    policy = load_policy(run)
    plain, shown = (
        evaluate(load_scenario("random/k5-fdd", {"observation": seen}), policy, 2, seed=4)
        for seen in ({"kind": "paper"}, {"kind": "table"})
    )
    assert plain.samples["mean_aoi"].tolist() == shown.samples["mean_aoi"].tolist()


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"observation": "table"}], ids=["paper", "table"])
def test_is_asked_in_environments(run, changes):
    """Of other sizes, whatever they hand out; the episode is that of an evaluation."""
    policy = load_policy(run)
    env = iout_v0.parallel_env("random/k7-fdd", overrides=changes)
    observations, _ = env.reset(seed=3)
    infos = {}
    while env.agents:
        observations, *_, infos = env.step(policy.predict(observations, env=env))
    expected = evaluate(load_scenario("random/k7-fdd", changes), policy, 1, seed=3)
    found = infos["auv_0"]["time_mean_aoi"]
    assert found == pytest.approx(expected.samples["mean_aoi"][0], rel=1e-12)


@pytest.mark.slow
def test_what_auvs_know_must_be_as_in_the_training(run, tmp_path):
    """A view with a limit has a column more, which other weights know nothing of."""
    limit = {"observation.view_range_m": 800}
    limited, whole = load_scenario("random/k5-fdd", limit), load_scenario("random/k5-fdd")
    other = tmp_path / "limited"
    train("random/k5-fdd", other, overrides={**SETTINGS, **limit}, evaluation_episodes=1)
    assert evaluate(limited, load_policy(other), 1).episodes == 1
    said = r": was trained {} observation\.view_range_m, which in random/k5-fdd is {}$"
    for start, wrong, message in (
        (str(run), limited, said.format("without", "800 m")),
        ("pretrained", limited, said.format("without", "800 m")),
        (str(other), whole, said.format("with", "null")),
    ):
        with pytest.raises(InputError, match=message):
            evaluate(wrong, load_policy(start), 1)
        with pytest.raises(InputError, match=message):
            train(wrong, tmp_path / "never", start=start)
    assert not (tmp_path / "never").exists()


def test_where_runs_fit(run):
    load_run(run, load_scenario("paper/k3-fdd"), transfer=False)
    with pytest.raises(InputError, match="--transfer"):
        load_run(run, load_scenario("paper/k5-fdd"), transfer=False)
    load_run(run, load_scenario("paper/k5-fdd"), transfer=True)
    with pytest.raises(InputError, match=r"duplex\.kind fdd, not tdd"):
        load_run(run, load_scenario("paper/k3-tdd"), transfer=True)


class TestStart:
    """`--from RUN`."""

    def test_begins_with_the_weights(self, run):
        trainer = Trainer("multi/m2-k10-fdd", start=str(run))
        expected = load_policy(run).network.state_dict()
        assert trainer.settings.preset == "fine-tune"
        assert trainer.source.observation.kind == "table"
        for name, tensor in trainer.weights().items():
            torch.testing.assert_close(tensor, expected[name])

    @pytest.mark.slow
    def test_settings_of_the_user_hold(self, run, tmp_path):
        outcome = train(
            "paper/k5-fdd",
            tmp_path / "tuned",
            start=str(run),
            overrides=["training.steps=80", "training.environments=4", "training.rollout_slots=10"],
            evaluation_episodes=1,
        )
        assert outcome.trainer.env_steps == 80
        assert evaluate("paper/k5-fdd", tmp_path / "tuned", 1).episodes == 1
        before, after = load_policy(run), load_policy(tmp_path / "tuned")
        moved = [
            not torch.equal(tensor, after.network.state_dict()[name])
            for name, tensor in before.network.state_dict().items()
        ]
        assert any(moved)

    @pytest.mark.parametrize(
        ("start", "scenario", "message"),
        [
            ("nowhere", "paper/k3-fdd", "neither pretrained nor the folder of a run"),
            (None, "paper/k3-tdd", r"was trained for duplex\.kind fdd"),
        ],
    )
    def test_what_cannot_begin(self, run, start, scenario, message):
        with pytest.raises(InputError, match=message):
            Trainer(scenario, start=start or str(run))

    @pytest.mark.parametrize(
        ("said", "message"),
        [
            ({"training.network": "mlp"}, r"training\.network is set, not mlp$"),
            ({"training.network.width": 16}, r"training\.network\.width is 8, not 16$"),
            (
                {"observation.kind": "table", "observation.entries": ["time"]},
                r"observation\.entries",
            ),
        ],
    )
    def test_other_networks_are_refused(self, run, said, message):
        with pytest.raises(InputError, match=f"^--from {run}: its .*{message}"):
            Trainer("paper/k5-fdd", start=str(run), overrides=said)

    def test_other_networks_are_refused_wherever_they_are_said(self, run, tmp_path):
        message = r"its training\.network is set, not mlp$"
        with pytest.raises(InputError, match=message):
            Trainer("paper/k5-fdd", start=str(run), network="mlp")
        (tmp_path / "own.yaml").write_text("extends: paper/k5-fdd\ntraining: {network: mlp}\n")
        with pytest.raises(InputError, match=message):
            Trainer(tmp_path / "own.yaml", start=str(run))
        with pytest.raises(InputError, match=r"width is 8, not 16$"):
            Trainer(
                load_scenario("paper/k5-fdd", SETTINGS | {"training.network.width": 16}),
                start=str(run),
            )

    def test_what_the_scenario_says_itself_holds(self, run):
        changes = {"training.mask_actions": False, "training.network": {"width": 8}}
        trainer = Trainer("paper/k5-fdd", start=str(run), overrides=changes)
        assert not trainer.settings.mask_actions
        assert Trainer(load_scenario("paper/k5-fdd"), start=str(run)).settings.mask_actions

    def test_networks_of_one_size_cannot(self, tmp_path):
        few = {k: v for k, v in SETTINGS.items() if k.startswith("training") and "net" not in k}
        train("paper/k3-fdd", tmp_path / "run", overrides=few, evaluation_episodes=1)
        with pytest.raises(InputError, match="for one size"):
            Trainer("paper/k5-fdd", start=str(tmp_path / "run"))


@pytest.mark.slow
def test_best_of(run):
    """No worse than the most probable actions; of several episodes the better ones differ."""
    policy = load_policy(run)
    players = [policy, *(BestOf(policy, n, mirrored=m) for n, m in ((1, 0), (12, 0), (1, 1)))]
    found = [evaluate("paper/k3-fdd", player, 1).samples["mean_aoi"][0] for player in players]
    assert found[0] == found[1] > found[2]
    assert found[0] >= found[3]
    assert not policy.sampled


@pytest.mark.slow
@pytest.mark.parametrize("scenario", ["random/k3-tdd", "multi/m2-k10-fdd"])
def test_guided_beam(scenario):
    """No worse than the policy, the same in any company, and played as it was planned."""
    policy = pretrained()
    settings = {"nodes": {"kind": "random", "count": 3}, "episode.duration_s": 1500}
    world = World(load_scenario(scenario, settings), 3)
    start = world.reset(seed=2)
    states = [start.map(lambda array, env=env: array[[env]]) for env in range(3)]
    search = GuidedSearch(world.scenario, policy, 2)
    plans = search.plans(states)
    assert search.plans(states[1:2])[0].age_sum == plans[1].age_sum
    plain = planned = start
    for slot in range(world.num_slots):
        actions = np.array([plan.actions[slot] for plan in plans])
        assert (np.array([plan.states.cell[slot] for plan in plans]) == planned.cell).all()
        planned, _ = world.step(planned, actions)
        plain, _ = world.step(plain, policy.act(world, plain, np.random.default_rng(0)))
    assert planned.age_sum.tolist() == [plan.age_sum for plan in plans]
    assert (planned.age_sum <= plain.age_sum).all()
    assert (planned.age_sum < plain.age_sum).any()


@pytest.mark.slow
def test_guided_beam_of_a_network_for_observations():
    """Guided by what was trained on one scenario alone."""
    policy = Trainer("paper/k3-tdd", overrides={"training.steps": 1}).policy()
    plain = evaluate("paper/k3-tdd", policy, 1).samples["mean_aoi"][0]
    assert evaluate("paper/k3-tdd", GuidedBeam(policy, 2), 1).samples["mean_aoi"][0] < plain


@pytest.mark.parametrize("search", [BestOf, GuidedBeam])
def test_only_trained_policies_search(search):
    with pytest.raises(InputTypeError, match=rf"{search.__name__}: needs a trained policy.*greedy"):
        search(make_baseline("greedy"))
    with pytest.raises(InputError, match="at least one episode, not 0"):
        search(pretrained(), 0)


def test_mirror_images(run):
    """A policy that sees a mirrored world does the mirrored thing."""
    policy = load_policy(run)
    images = np.array([[False] * 3, [True, False, True], [False, True, False]])
    world = World("random/k5-fdd", len(images))
    state = world.reset(seed=0)
    state = state.map(lambda array: array[[0, 0, 0]])
    mirror = Mirror(world, images)
    shown = mirror.state(state)
    assert len({tuple(cells) for cells in shown.node_cell.tolist()}) == 3
    again = mirror.state(shown)
    assert (again.node_cell == state.node_cell).all()
    chosen = policy.act(world, shown, np.random.default_rng(0))
    done, _ = world.step(state, mirror.action(chosen))
    there, _ = world.step(shown, chosen)
    assert (mirror.state(there).cell == done.cell).all()
    np.testing.assert_allclose(there.energy_j, done.energy_j, rtol=1e-12)
