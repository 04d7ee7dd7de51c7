"""Trainings that begin with what another policy does."""

import json
import math
from signal import SIGTERM, raise_signal

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from iout_marl import evaluate, load_scenario
from iout_marl.errors import InputError
from iout_marl.policies.search import Planner
from trainers import Callback, Trainer, train
from trainers.imitation import Teacher, imitation_loss
from trainers.networks import IMPOSSIBLE

SET = {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "pair_width": 4, "critic_width": 8}
SHOWN = {
    "training.imitate": "return",
    "training.imitation_share": 0.5,
    "training.rollout_slots": 8,  # which a teacher takes no notice of
    "training.imitation_epochs": 4,
    "training.steps": 1600,
    "training.mask_actions": True,
}


FEW = {
    "training.imitate": "tour",
    "training.environments": 2,
    "training.epochs": 1,
    "training.minibatches": 2,
    "training.hidden_units": [4],
}


class Misshapen:
    name = "misshapen"

    def act(self, world, state, rng):
        return np.zeros((1, 1), dtype=np.int64)


def played(trainer, iterations=1):
    """What an iteration has learnt from."""
    rollouts = []
    update = trainer._captured_update
    trainer._captured_update = lambda rollout, *rest: (
        rollouts.append(rollout) or update(rollout, *rest)
    )
    for _ in range(iterations):
        trainer.iterate()
    return rollouts


def test_loss_is_the_cross_entropy_of_what_is_possible():
    logits = torch.tensor([[[[1.0, 2.0, IMPOSSIBLE], [0.5, 0.0, 0.25]]]], requires_grad=True)
    for action, counted in (([1, 2], (0, 1)), ([2, 0], (1,))):
        found = imitation_loss(logits, torch.tensor([[action]]), 0.1, samples=2)
        log_p = logits[0, 0].log_softmax(-1)
        wanted = -sum(log_p[entry, action[entry]] for entry in counted) / 2
        entropy = -(log_p.exp() * log_p).sum() / 2
        torch.testing.assert_close(found.policy_loss[0], wanted)
        torch.testing.assert_close(found.entropy[0], entropy)
        torch.testing.assert_close(found.loss[0], wanted - 0.1 * entropy)
        (gradient,) = torch.autograd.grad(found.loss.sum(), logits)
        assert gradient.isfinite().all()
        assert gradient[..., 0, 2] == 0  # nothing makes it more probable


@pytest.mark.slow
def test_learner_plays_more_and_more_and_learns_what_the_teacher_would_do(tiny):
    trainer = Trainer(tiny(SHOWN), seed=3)
    shares, shows = [], Teacher.shows

    def watched(self, state, own, num_envs, place):
        action, chosen = shows(self, state, own, num_envs, place)
        is_own = (chosen == own).all(-1).all(-1)
        is_shown = (chosen == action).all(-1).all(-1)
        assert (is_own | is_shown).all()
        shares.append((~is_shown).double().mean().item())
        return action, chosen

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Teacher, "shows", watched)
        rollouts = played(trainer, 20)
    assert len(shares) == 10 * 20  # half of the steps, in whole episodes
    by_rollout = np.array(shares).reshape(10, 20).mean(-1)
    assert by_rollout[0] == 0
    assert by_rollout[-3:].mean() > by_rollout[1:4].mean()
    assert [rollout.log_probability is None for rollout in rollouts] == [True] * 10 + [False] * 10
    assert [len(rollout.action) for rollout in rollouts] == [20] * 10 + [8] * 10


@pytest.mark.slow
def test_actor_comes_to_do_as_its_teacher(tiny):
    """Before PPO has begun."""
    changes = {**SHOWN, "training.imitation_share": 1.0, "training.steps": 2400}
    scenario = tiny({**changes, "training.imitation_epochs": 10, "training.learning_rate": 5e-3})
    trainer = Trainer(scenario, seed=1)
    losses = []
    while not trainer.finished:
        losses.append(trainer.iterate()["ppo/policy_loss"])
    assert losses[-1] < losses[0] / 2
    aoi = [
        evaluate(scenario, policy, 1).metrics["mean_aoi"].mean
        for policy in ("return", trainer.policy(), Trainer(scenario, seed=1).policy())
    ]
    assert aoi[1] - aoi[0] < (aoi[2] - aoi[0]) / 2


@pytest.mark.slow
def test_plans_are_kept_to(tiny, monkeypatch):
    """A tour has planned for its own actions alone."""
    made, plan = [], Planner.plan
    monkeypatch.setattr(Planner, "plan", lambda *args: made.append(1) or plan(*args))
    trainer = Trainer(tiny({**SHOWN, "training.imitate": "tour"}))
    aoi = evaluate(tiny(SHOWN), "tour", 1).metrics["mean_aoi"].mean
    for _ in range(10):
        log = trainer.iterate()
        assert log["aoi/mean"] == pytest.approx(aoi, rel=1e-5)
        assert log["ppo/kl"] == log["ppo/clip_fraction"] == 0
        assert math.isfinite(log["ppo/loss"])
    assert len(made) == 2  # for the evaluation, and for all rollouts


@pytest.mark.slow
def test_resumed_training_is_as_if_never_stopped(tiny, tmp_path):
    scenario = tiny({**SHOWN, "training.imitate": "greedy"})  # which leaves ties to chance
    whole = Trainer(scenario, seed=5)
    for _ in range(14):
        whole.iterate()
    stopped = Trainer(scenario, seed=5)
    for _ in range(6):
        stopped.iterate()
    resumed = Trainer(scenario, seed=5)
    resumed.load_state_dict(stopped.state_dict())
    for _ in range(8):
        resumed.iterate()
    for name, tensor in whole.weights().items():
        assert torch.equal(resumed.weights()[name], tensor), name


@pytest.mark.slow
@pytest.mark.parametrize("at", [160, 480])
def test_stopped_run_goes_on(tiny, tmp_path, at):
    """While the teacher shows, and after it."""

    class Stops(Callback):
        def on_iteration(self, training):
            if training.trainer.env_steps >= at:
                raise_signal(SIGTERM)

    scenario = tiny({**SHOWN, "training.imitation_epochs": 30, "training.steps": 640})
    outcome = train(scenario, tmp_path / "run", callbacks=[Stops()], evaluation_episodes=1)
    assert not outcome.finished
    outcome = train(scenario, tmp_path / "run", resume=True, evaluation_episodes=1)
    assert outcome.finished
    alone = train(scenario, tmp_path / "alone", evaluation_episodes=1)
    for name, tensor in load_file(alone.run.path / "policy.safetensors").items():
        assert torch.equal(load_file(outcome.run.path / "policy.safetensors")[name], tensor), name


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::iout_marl.errors.Note")
def test_what_is_planned_in_a_sea_is_shown_anew_after_a_stop():
    scenario = load_scenario("sea/array", {"episode.duration_s": 2000, **SHOWN, **FEW})
    whole, stopped = Trainer(scenario), Trainer(scenario)
    whole.iterate(), stopped.iterate()
    resumed = Trainer(scenario)
    resumed.load_state_dict(stopped.state_dict())
    assert resumed.iterate()["aoi/mean"] == whole.iterate()["aoi/mean"]


@pytest.mark.slow
def test_a_training_that_goes_on_for_longer_is_not_taught_again(tiny, tmp_path):
    teacher = train(tiny({"training.steps": 160}), tmp_path / "teacher", evaluation_episodes=1).run
    scenario = tiny({**SHOWN, "training.imitate": str(teacher.path), "training.steps": 320})
    train(scenario, tmp_path / "run", evaluation_episodes=1)
    teacher.path.rename(tmp_path / "elsewhere")  # nor does it ask for the teacher
    longer = load_scenario(scenario, {"training.steps": 640})
    done = train(longer, tmp_path / "run", resume=True, evaluation_episodes=1)
    lines = [json.loads(line) for line in done.run.metrics_path.read_text().splitlines()]
    taught = [line["ppo/kl"] == 0 for line in lines]
    assert taught == [True] * 2 + [False] * (len(taught) - 2)


@pytest.mark.slow
@pytest.mark.parametrize("teacher", ["return", "greedy"])  # which leaves ties to chance
def test_policies_side_by_side_learn_what_each_would_alone(tiny, teacher):
    scenario = tiny({**SHOWN, "training.imitate": teacher})
    two, alone = Trainer(scenario, seed=2, replicas=2), Trainer(scenario, seed=3)
    for _ in range(12):
        two.iterate_all()
        alone.iterate()
    for name, tensor in alone.weights().items():
        torch.testing.assert_close(two.weights(1)[name], tensor, rtol=1e-4, atol=1e-5)


@pytest.mark.slow
def test_every_family_has_a_teacher(tiny):
    changes = {
        "nodes": {"kind": "random", "count": 2},
        "observation": {"kind": "table"},
        "training.network": SET,
        "training.over": [{"vary": {"nodes.count": {"from": 1, "to": 4}, "auvs.count": [1, 2]}}],
    }
    trainer = Trainer(tiny({**SHOWN, **changes}), seed=1)
    sizes = set()
    while trainer.env_steps < 800:
        assert trainer.iterate()["ppo/kl"] == 0
        world = trainer.turn.collector.world
        sizes.add((world.num_nodes, world.num_auvs))
    assert len(sizes) > 2
    assert trainer.iterate()["ppo/kl"] > 0


@pytest.mark.slow
def test_run_teaches_another_network(tiny, tmp_path):
    """As it was written: by its folder."""
    first = train(tiny({"training.steps": 400}), tmp_path / "first", evaluation_episodes=1).run
    changes = {**SHOWN, "training.imitate": str(first.path), "training.hidden_units": [4]}
    second = train(tiny(changes), tmp_path / "second", evaluation_episodes=1).run
    assert second.scenario().training.imitate == str(first.path)
    assert load_file(second.path / "policy.safetensors")


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"training.imitate": "tuor"}, "training.imitate tuor: .*did you mean 'tour'"),
        (
            {"training.imitate": "no/run", "training.imitation_share": 0.0},
            "training.imitate no/run: neither a baseline nor",
        ),
        ({"training.imitate": f"{__name__}:Misshapen"}, "training.imitate: policy misshapen: an "),
    ],
)
def test_what_cannot_be_shown_is_refused(tiny, changes, said):
    with pytest.raises(InputError, match=said):
        Trainer(tiny({**SHOWN, **changes})).check_imitation()


def test_scenarios_that_imitate_nobody_are_as_they_were(tiny):
    plain = tiny()
    assert tiny({"training.imitate": None, "training.imitation_epochs": 10}).hash == plain.hash
    assert tiny({"training.imitate": "tour"}).hash != plain.hash
