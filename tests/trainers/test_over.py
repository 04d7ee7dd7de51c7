"""Training over families of scenarios: turns, returns, the curriculum, resuming."""

import json
import os

import numpy as np
import pytest
import torch
from rich.console import Console
from safetensors.torch import load_file

from iout_marl.errors import InputError
from iout_marl.scenario import load_scenario, to_yaml
from iout_marl.scenario.drawing import Families
from trainers import Callback, RunFolder, Trainer, train
from trainers.accel.group import ProcessGroup
from trainers.curriculum import Curriculum
from trainers.returns import advantages, standardised

SMALL = {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "pair_width": 4, "critic_width": 8}
VARIED = {
    "name": "varied",
    "vary": {
        "nodes.count": {"from": 1, "to": 4},
        "grid.cells": [[3, 2, 1], [4, 3, 2]],
        "auvs.count": [1, 2],
        "episode.duration_s": {"from": 250, "to": 500},
        "nodes.weights": {"each": {"from": 0.5, "to": 2}},
    },
}
SETTINGS = {
    "nodes": {"kind": "random", "count": 2},
    "observation": {"kind": "table"},
    "training.network": SMALL,
    "training.steps": 900,
    "training.environments": 8,
    "training.curriculum": "gap",
    "training.over": [VARIED, {"name": "itself", "weight": 0.5}],
}


@pytest.fixture(scope="module")
def families(tiny):
    def make(changes=()):
        return tiny({**SETTINGS, **dict(changes)})

    return make


@pytest.fixture
def quietly():
    with open(os.devnull, "w") as nowhere:  # noqa: PTH123
        yield lambda scenario, out, **options: train(
            *(scenario, out, 3), console=Console(file=nowhere), evaluation_episodes=2, **options
        )


@pytest.mark.slow
def test_each_turn_plays_whole_episodes_of_what_was_drawn(families):
    trainer = Trainer(families(), seed=1)
    target, steps, seen = 8 * 20, 0, set()
    for _ in range(12):
        trainer.iterate()
        turn, world = trainer.turn, trainer.turn.collector.world
        assert turn.slots == world.num_slots == turn.draw.scenario.num_slots
        envs = turn.collector.num_envs
        assert envs == 8 or abs(envs * turn.slots * world.num_auvs - target) <= target / 2
        assert envs % 8 == 0
        assert turn.network.action_sizes == world.action_sizes
        steps += envs * turn.slots
        seen.add((world.num_nodes, world.num_auvs))
    assert trainer.env_steps == steps
    assert len(seen) > 3
    # Turns share weights; evaluation is of the scenario itself.
    ours = dict(trainer.network.named_parameters())
    assert all(p is ours[name] for name, p in trainer.turn.network.named_parameters())
    assert trainer.policy().network.action_sizes == trainer.collector.world.action_sizes


@pytest.mark.slow
def test_weights_learn_and_families_are_logged(families):
    trainer = Trainer(families(), seed=1)
    before = {name: p.clone() for name, p in trainer.network.named_parameters()}
    logs = [trainer.iterate() for _ in range(6)]
    still = {n for n, p in trainer.network.named_parameters() if torch.equal(before[n], p)}
    assert all("nobody" in name for name in still)  # no choice here
    for log in logs:
        (name,) = {tag.split("/")[1] for tag in log if tag.startswith("family/")}
        assert name in ("varied", "itself")
        assert log[f"family/{name}/aoi"] == log["aoi/mean"]
        assert log[f"family/{name}/gap"] >= 0
        assert np.isfinite(log["ppo/loss"])


def test_standardised_rewards_have_returns_of_mean_0_and_deviation_1():
    generator = torch.Generator().manual_seed(0)
    reward = 5 + 3 * torch.rand(60, 1, 4, 2, generator=generator)
    truncated = torch.zeros(60, dtype=torch.bool)
    truncated[[29, 59]] = True
    discount = 0.9
    scaled = standardised(reward, truncated, discount, ProcessGroup()).double()
    returns, beyond = torch.empty_like(scaled), scaled.mean() / (1 - discount)
    for t in reversed(range(60)):
        following = returns[t + 1] if t < 59 and not truncated[t] else beyond
        returns[t] = scaled[t] + discount * following
    assert returns.mean().item() == pytest.approx(0, abs=1e-5)
    assert returns.std(correction=0).item() == pytest.approx(1, abs=1e-5)


def test_values_of_standardised_rewards_are_standardised_values():
    """The advantages of r' by V' are those of r by μ + σ V', divided by σ."""
    generator = torch.Generator().manual_seed(1)
    reward = torch.rand(20, 1, 3, 1, generator=generator).double()
    value = torch.randn(21, 1, 3, 1, generator=generator).double()
    truncated = torch.zeros(20, dtype=torch.bool)
    scaled = standardised(reward, truncated, 0.9, ProcessGroup())
    std = ((reward[0] - reward[1]) / (scaled[0] - scaled[1])).mean()
    mean = ((reward - scaled * std) / (1 - 0.9)).mean()
    plain, theirs = (
        advantages(r, v[:-1], v[1:], truncated, 0.9, 0.95)
        for r, v in ((scaled, value), (reward, mean + std * value))
    )
    torch.testing.assert_close(plain, theirs / std)


def test_what_follows_an_episode_counts_as_the_mean(families):
    """Whatever the critic makes of a state that no rollout holds."""
    trainer = Trainer(families(), seed=1)
    turn = trainer.next_turn()
    rollout = turn.collector.collect(turn.network, turn.slots, use_mask=False)
    assert rollout.truncated.tolist() == [False] * (turn.slots - 1) + [True]
    assert rollout.next_value[-1].all()
    value = trainer.next_value(rollout)
    assert not value[-1].any()
    assert torch.equal(value[:-1], rollout.next_value[:-1])


def test_a_constant_reward_is_no_division_by_zero():
    scaled = standardised(
        torch.ones(5, 1, 2, 1), torch.zeros(5, dtype=torch.bool), 0.9, ProcessGroup()
    )
    assert scaled.abs().max() < 1e-3


def test_curriculum_spends_its_time_where_the_gap_is(families):
    drawn = Families.from_scenario(families())
    curriculum = Curriculum(drawn, "gap")
    by_weight = [1 / 3, 1 / 3, 1 / 3]
    assert curriculum.shares() == pytest.approx(by_weight)
    rng = np.random.default_rng(0)
    for stratum, gap in ((0, 0.1), (1, 0.4)):
        curriculum.update(drawn.draw(rng, family=0, stratum=stratum), gap)
    few, many, unknown = curriculum.shares()
    assert unknown == pytest.approx(many)
    assert many > few > 0.3 / 3
    curriculum.update(drawn.draw(rng, family=1), 0.0)
    few, many, solved = curriculum.shares()
    assert many > few > solved == pytest.approx(0.1)
    assert sum((few, many, solved)) == pytest.approx(1)
    chosen = [curriculum.choose(rng) for _ in range(600)]
    assert chosen.count((0, 1)) == pytest.approx(600 * many, abs=60)
    for _ in range(60):
        curriculum.update(drawn.draw(rng, family=0, stratum=1), 0.02)
    assert curriculum.gaps[1] == pytest.approx(0.02, abs=1e-3)
    none = Curriculum(drawn, "none")
    none.update(drawn.draw(rng, family=1), 3.0)
    assert none.shares() == pytest.approx(by_weight)


class StopAfter(Callback):
    def __init__(self, steps):
        self.steps = steps

    def on_iteration(self, training):
        if training.trainer.env_steps >= self.steps:
            training.stop()


@pytest.mark.slow
def test_a_stopped_run_goes_on_as_if_it_never_was(families, quietly, tmp_path):
    scenario = families()
    whole = quietly(scenario, tmp_path / "whole").run
    quietly(scenario, tmp_path / "parts", callbacks=[StopAfter(400)])
    stopped = RunFolder(tmp_path / "parts").load_checkpoint()["env_steps"]
    parts = quietly(scenario, tmp_path / "parts", resume=True).run
    assert 400 <= stopped < 900
    ours, theirs = (load_file(run.path / "policy.safetensors") for run in (whole, parts))
    assert all(torch.equal(ours[name], tensor) for name, tensor in theirs.items())
    rows = [
        [json.loads(line) for line in run.metrics_path.read_text().splitlines()]
        for run in (whole, parts)
    ]
    for one, other in zip(*rows, strict=True):
        assert {k: v for k, v in one.items() if not k.startswith("speed/")} == {
            k: v for k, v in other.items() if not k.startswith("speed/")
        }


@pytest.mark.slow
def test_collectors_that_are_kept_make_no_difference(families, monkeypatch):
    kept, fresh = Trainer(families(), seed=2), Trainer(families(), seed=2)
    for _ in range(6):
        fresh._turns._kept.clear()
        assert kept.iterate()["ppo/loss"] == fresh.iterate()["ppo/loss"]
    assert len(kept._turns._kept) > 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"training.network": "mlp"}, "training.network: must be one whose weights do not"),
        (
            {"training.over": [{"vary": {"duplex": [{"kind": "tdd", "frequency_khz": 30}]}}]},
            r"training.over\[0\].vary.duplex\[0\]: has 2 choices in an action",
        ),
    ],
    ids=["mlp", "other actions"],
)
def test_what_one_network_cannot_serve_is_refused(families, changes, message):
    with pytest.raises(InputError, match=message):
        Trainer(families(changes))


def test_replicas_are_refused(families):
    with pytest.raises(InputError, match=r"--replicas: .*training.over"):
        Trainer(families(), replicas=2)


class Three(ProcessGroup):
    size = 3


def test_processes_that_cannot_share_a_turn_evenly_are_refused(families):
    with pytest.raises(InputError, match="3 processes cannot share evenly"):
        Trainer(families({"training.environments": 24}), group=Three())


def test_the_run_keeps_its_families(families, quietly, tmp_path):
    scenario = families({"training.steps": 100})
    outcome = quietly(scenario, tmp_path / "run")
    run = outcome.run
    assert outcome.sampled_aoi == [None]  # no figure of the scenario itself
    assert load_scenario(run.path / "scenario.yaml") == scenario == run.scenario()
    assert "varied" in to_yaml(scenario)
