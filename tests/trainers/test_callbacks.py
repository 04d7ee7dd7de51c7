"""What is called as a training goes, and what comes of what it raises."""

import json
import os
import signal

import pytest
import torch

from iout_marl import InputError, load_policy
from trainers import Callback, RunFolder, Trainer, train


class Noting(Callback):
    """Notes each call, and the steps that were taken."""

    def __init__(self):
        self.calls = []

    def note(self, event, training):
        self.calls.append((event, training.trainer.env_steps))
        self.training = training

    def on_start(self, training):
        self.note("start", training)

    def on_iteration(self, training):
        self.note("iteration", training)

    def on_checkpoint(self, training):
        self.note("checkpoint", training)

    def on_end(self, training):
        self.note("end", training)


class Raising(Noting):
    """Raises at an event, once so many steps were taken."""

    def __init__(self, event, at=0, error=None):
        super().__init__()
        self.event, self.at = event, at
        self.error = error or ValueError("of its own")

    def note(self, event, training):
        super().note(event, training)
        if event == self.event and training.trainer.env_steps >= self.at:
            raise self.error


class Stopping(Noting):
    """Ends the training once so many steps were taken."""

    def __init__(self, at):
        super().__init__()
        self.at = at

    def note(self, event, training):
        super().note(event, training)
        if event == "iteration" and training.trainer.env_steps >= self.at:
            training.stop()


@pytest.fixture
def short(tiny):
    return tiny({"training.steps": 320, "training.checkpoint_steps": 160})


def test_events_come_in_order_with_what_they_are_about(short, tmp_path):
    log = Noting()
    outcome = train(short, tmp_path, callbacks=[log], evaluation_episodes=2)
    assert log.calls == [
        ("start", 0),
        ("iteration", 80),
        ("iteration", 160),
        ("checkpoint", 160),
        ("iteration", 240),
        ("iteration", 320),
        ("checkpoint", 320),
        ("end", 320),
    ]
    (figures,) = log.training.figures
    rows = [json.loads(row) for row in RunFolder(tmp_path).metrics_path.read_text().splitlines()]
    shown = {k: v for k, v in rows[-1].items() if k not in ("env_steps", "speed/logging_share")}
    assert figures == pytest.approx(shown)
    assert log.training.evaluations == outcome.evaluations
    assert log.training.failure is None
    assert log.training.is_first


def test_checkpoint_is_there_when_it_is_called(short, tmp_path):
    found = []

    class Looking(Callback):
        def on_checkpoint(self, training):
            found.append(RunFolder(tmp_path).load_checkpoint()["env_steps"])
            found.append(training.saved_at)

    train(short, tmp_path, callbacks=[Looking()], evaluation_episodes=1)
    assert found == [160, 160, 320, 320]


@pytest.mark.slow
def test_stopped_training_is_saved_evaluated_and_can_be_resumed(short, tmp_path):
    outcome = train(short, tmp_path, callbacks=[Stopping(at=160)], evaluation_episodes=2)
    assert outcome.finished
    assert not outcome.trainer.finished
    assert outcome.evaluations
    assert json.loads((tmp_path / "result.json").read_text())["env_steps"] == 160
    again = train(short, tmp_path, resume=True, evaluation_episodes=2)
    assert again.trainer.env_steps == 320
    whole = train(short, tmp_path / "whole", evaluation_episodes=2)
    assert all(
        torch.equal(tensor, whole.trainer.weights()[name])
        for name, tensor in again.trainer.weights().items()
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("event", "at", "saved"),
    [
        ("start", 0, "nothing was saved yet"),
        ("iteration", 80, "last checkpoint: 80 steps"),
        ("iteration", 240, "last checkpoint: 240 steps"),
        ("checkpoint", 160, "last checkpoint: 160 steps"),
        ("checkpoint", 320, "last checkpoint: 320 steps"),
        ("end", 0, "last checkpoint: 320 steps"),
    ],
)
def test_what_one_raises_ends_the_training_once_it_is_saved(short, tmp_path, event, at, saved):
    before, after = Noting(), Noting()
    callbacks = [before, Raising(event, at), after]
    with pytest.raises(InputError) as raised:
        train(short, tmp_path, callbacks=callbacks, evaluation_episodes=1)
    message = str(raised.value)
    assert "callback Raising: raises ValueError: of its own (" in message
    assert f"{__file__}:" in message
    assert saved in message
    assert message.isprintable()
    # All that were begun are ended, and know why.
    assert [callback.calls[-1][0] for callback in callbacks] == ["end"] * 3
    if event != "end":
        assert isinstance(before.training.failure, InputError)
    if event == "start":
        return
    assert (tmp_path / "result.json").exists() == (event == "end")
    outcome = train(short, tmp_path, resume=True, evaluation_episodes=1)
    assert outcome.trainer.env_steps == 320


def test_of_several_that_raise_the_first_is_named(short, tmp_path):
    raising = [Raising("iteration", 80, TypeError("first")), Raising("iteration", 80)]
    with pytest.raises(InputError, match="TypeError: first"):
        train(short, tmp_path, callbacks=raising)
    assert RunFolder(tmp_path).load_checkpoint()["env_steps"] == 80


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(3)], ids=["^C", "exit"])
def test_what_ends_a_program_passes_through(short, tmp_path, error):
    log = Noting()
    with pytest.raises(type(error)):
        train(short, tmp_path, callbacks=[log, Raising("iteration", 80, error)])
    assert log.calls[-1][0] == "end"
    assert log.training.failure is error


def test_signals_reach_them_as_an_end(short, tmp_path):
    class Signalling(Noting):
        def on_iteration(self, training):
            super().on_iteration(training)
            os.kill(os.getpid(), signal.SIGTERM)

    log = Signalling()
    outcome = train(short, tmp_path, callbacks=[log])
    assert outcome.signal == signal.SIGTERM
    assert [event for event, _ in log.calls] == ["start", "iteration", "checkpoint", "end"]


@pytest.mark.parametrize("wrong", [Noting, print, "log"], ids=["a class", "a function", "a word"])
def test_what_is_no_callback_is_refused_before_anything_is_written(short, tmp_path, wrong):
    with pytest.raises(InputError, match=r"callbacks: \w+ must be an object of a class that"):
        train(short, tmp_path / "run", callbacks=[wrong])
    assert not (tmp_path / "run").exists()


def test_callbacks_of_replicas_see_the_figures_of_each(short, tmp_path):
    log = Noting()
    train(short, tmp_path, callbacks=[log], replicas=3, evaluation_episodes=1)
    assert len(log.training.figures) == len(log.training.evaluations) == 3
    assert len(log.training.runs) == 3


class TestSave:
    """`Trainer.save`."""

    @pytest.mark.slow
    @pytest.mark.parametrize("replicas", [1, 2])
    def test_makes_a_run_that_can_be_loaded_and_resumed(self, short, tmp_path, replicas):
        trainer = Trainer(short, 3, replicas=replicas)
        trainer.iterate_all()
        trainer.save(tmp_path / "run")
        trainer.iterate_all()
        trainer.save(tmp_path / "run")
        folder = tmp_path / "run" if replicas == 1 else tmp_path / "run" / "seed-3"
        assert RunFolder(folder).load_checkpoint()["env_steps"] == 160
        policy = load_policy(folder)
        for name, tensor in trainer.weights().items():
            assert torch.equal(policy.network.state_dict()[name], tensor)
        outcome = train(short, tmp_path / "run", resume=True, evaluation_episodes=1)
        while not trainer.finished:
            trainer.iterate_all()
        for name, tensor in trainer.weights(replicas - 1).items():
            assert torch.equal(outcome.trainer.weights(replicas - 1)[name], tensor)

    def test_leaves_alone_what_is_of_others(self, short, tmp_path):
        trainer = Trainer(short, 3)
        trainer.save(tmp_path / "run")
        with pytest.raises(InputError, match="holds another run; save to another folder"):
            Trainer(short, 4).save(tmp_path / "run")
        (tmp_path / "mine").mkdir()
        (tmp_path / "mine" / "scenario.yaml").write_text("a: 1\n")
        with pytest.raises(InputError, match=r"holds scenario\.yaml"):
            trainer.save(tmp_path / "mine")
        assert (tmp_path / "mine" / "scenario.yaml").read_text() == "a: 1\n"

    def test_refuses_weights_that_are_not_finite(self, short, tmp_path):
        trainer = Trainer(short)
        trainer.network.actor[0].weight.data.fill_(torch.nan)
        with pytest.raises(InputError, match="the weights are not finite; not saved"):
            trainer.save(tmp_path / "run")
        assert not (tmp_path / "run" / "run.json").exists()
