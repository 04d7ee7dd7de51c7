"""A training that was stopped, by a signal or a crash, continues as if it never had been."""

import io
import json
import os
import signal
import threading
import time

import pytest
import safetensors.torch
import torch
from forked import Iout
from rich.console import Console
from seas import OF_ANY
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from iout_marl import InputError
from iout_marl.scenario import Training
from trainers import DivergedError, RunFolder, Trainer, train, training_run
from trainers.runs import saving

RANDOM_NODES = {"kind": "random", "count": 2}
SIGNALS = [getattr(signal, n) for n in ("SIGHUP", "SIGINT", "SIGTERM") if hasattr(signal, n)]
VARIANTS = {
    "a changing sea": OF_ANY,
    "whole episodes": {},
    "mid-episode": {"training.rollout_slots": 13, "training.steps": 364},
    "random layouts, mid-episode": {
        "nodes": RANDOM_NODES,
        "training.rollout_slots": 13,
        "training.steps": 364,
    },
    "layout drawn once": {"nodes": RANDOM_NODES | {"redraw": "run"}},
    "running normalisers": {
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
        "training.rollout_slots": 13,
        "training.steps": 364,
    },
    "two auvs, tdd, masks": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "duplex.kind": "tdd",
        "training.mask_actions": True,
        "training.target_kl": 0.001,
    },
    "mappo, limited view, difference rewards": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.critic": "central",
        "reward.credit": "difference",
        "observation.view_range_m": 100,
        "training.rollout_slots": 13,
        "training.steps": 364,
    },
}


@pytest.fixture(scope="module")
def run(tiny):
    """Trains the tiny scenario quietly."""

    def go(folder, changes=(), **options):
        quiet = Console(file=open(os.devnull, "w"))  # noqa: PTH123, SIM115
        with quiet.file:
            return train(
                tiny(changes), folder, seed=3, console=quiet, evaluation_episodes=3, **options
            )

    return go


@pytest.fixture(scope="module")
def whole(run, tmp_path_factory):
    """The folder of a training that nothing stops, trained once; nobody writes into it."""
    known = {}

    def find(changes=()):
        key = json.dumps(dict(changes), sort_keys=True)
        if key not in known:
            known[key] = tmp_path_factory.mktemp("whole") / "run"
            run(known[key], changes)
        return known[key]

    return find


@pytest.fixture
def interrupt(monkeypatch):
    """Lets something happen at the end of a certain iteration, once."""
    iterate = Trainer.iterate_all

    def at(number, happens):
        left = [number]

        def iterate_and_stop(trainer):
            log = iterate(trainer)
            left[0] -= 1
            if left[0] == 0:
                happens()
            return log

        monkeypatch.setattr(Trainer, "iterate_all", iterate_and_stop)

    return at


class CrashError(Exception):
    """A process that ends as nothing has foreseen."""


def crash():
    raise CrashError


def lines(folder):
    """What `metrics.jsonl` says, but for how fast it went."""
    text = (folder / "metrics.jsonl").read_text()
    return [
        {k: v for k, v in json.loads(line).items() if not k.startswith("speed/")}
        for line in text.splitlines()
    ]


def tensors(data, path=""):
    """All tensors and numbers in a checkpoint by their place."""
    if isinstance(data, dict):
        for key, value in data.items():
            yield from tensors(value, f"{path}.{key}")
    elif isinstance(data, list | tuple):
        for i, value in enumerate(data):
            yield from tensors(value, f"{path}[{i}]")
    else:
        yield path, data


def assert_equal_runs(first, second):
    saved = [
        dict(tensors(torch.load(f / "checkpoint.pt", weights_only=True))) for f in (first, second)
    ]
    assert set(saved[0]) == set(saved[1])
    for place, value in saved[0].items():
        other = saved[1][place]
        same = torch.equal(value, other) if isinstance(value, torch.Tensor) else value == other
        assert same, place
    weights = [safetensors.torch.load_file(f / "policy.safetensors") for f in (first, second)]
    assert all(torch.equal(weights[0][k], weights[1][k]) for k in weights[0])
    assert lines(first) == lines(second)
    results = [json.loads((f / "result.json").read_text())["evaluation"] for f in (first, second)]
    assert results[0]["metrics"] == results[1]["metrics"]


def test_signals_have_their_usual_effect_where_they_are_not_to_be_caught(run, interrupt, tmp_path):
    interrupt(2, lambda: os.kill(os.getpid(), signal.SIGINT))
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "run", catch_signals=False)


@pytest.mark.slow
@pytest.mark.parametrize("changes", VARIANTS.values(), ids=list(VARIANTS))
def test_stopped_run_goes_on_bit_for_bit(tmp_path, run, whole, interrupt, changes):
    expected = whole(changes)
    interrupt(3, lambda: signal.raise_signal(signal.SIGTERM))
    stopped = run(tmp_path / "stopped", changes)
    assert not stopped.finished
    assert stopped.evaluation is None
    assert len(lines(tmp_path / "stopped")) == 3
    assert not (tmp_path / "stopped" / "result.json").exists()
    resumed = run(tmp_path / "stopped", changes, resume=True)
    assert resumed.finished
    assert_equal_runs(expected, tmp_path / "stopped")


@pytest.mark.slow
@pytest.mark.parametrize("changes", VARIANTS.values(), ids=list(VARIANTS))
def test_crashed_run_goes_on_from_its_last_checkpoint(tmp_path, run, whole, interrupt, changes):
    changes = dict(changes) | {"training.checkpoint_steps": 150}
    expected = whole(changes)
    interrupt(5, crash)
    with pytest.raises(CrashError):
        run(tmp_path / "crashed", changes)
    assert len(lines(tmp_path / "crashed")) == 4
    run(tmp_path / "crashed", changes, resume=True)
    assert_equal_runs(expected, tmp_path / "crashed")


def test_stopped_twice(tmp_path, run, whole, interrupt):
    expected = whole()
    interrupt(2, lambda: signal.raise_signal(signal.SIGINT))
    run(tmp_path / "stopped")
    interrupt(2, lambda: signal.raise_signal(signal.SIGINT))
    assert not run(tmp_path / "stopped", resume=True).finished
    run(tmp_path / "stopped", resume=True)
    assert_equal_runs(expected, tmp_path / "stopped")


@pytest.mark.slow
def test_tensorboard_shows_every_iteration_once(tmp_path, run, interrupt):
    interrupt(5, crash)
    with pytest.raises(CrashError):
        run(tmp_path / "run")
    time.sleep(1.1)  # event files are ordered by the second that stands in their names
    run(tmp_path / "run", resume=True)
    events = EventAccumulator(str(tmp_path / "run"))
    events.Reload()
    shown = [(event.step, pytest.approx(event.value)) for event in events.Scalars("aoi/mean")]
    assert shown == [(line["env_steps"], line["aoi/mean"]) for line in lines(tmp_path / "run")]


@pytest.mark.slow
@pytest.mark.parametrize("garbage", [b'{"env_st', b"\xff\xfe", b"null\n", b'{"a": 1}\n'])
def test_line_that_a_crash_cut_short_is_dropped(tmp_path, run, whole, interrupt, garbage):
    expected = lines(whole())
    interrupt(3, lambda: signal.raise_signal(signal.SIGINT))
    run(tmp_path / "stopped")
    with (tmp_path / "stopped" / "metrics.jsonl").open("ab") as file:
        file.write(garbage)
    run(tmp_path / "stopped", resume=True)
    assert lines(tmp_path / "stopped") == expected


def test_handlers_of_signals_are_put_back(tmp_path, run, interrupt):
    before = [signal.getsignal(n) for n in SIGNALS]
    interrupt(1, lambda: signal.raise_signal(signal.SIGINT))
    run(tmp_path / "run")
    assert [signal.getsignal(n) for n in SIGNALS] == before


def test_second_signal_has_its_usual_effect(tmp_path, run, interrupt):
    def twice():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)

    interrupt(1, twice)
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "run")


@pytest.mark.slow
def test_longer_training_may_be_asked_for(tmp_path, run):
    run(tmp_path / "run", {"training.learning_rate_schedule": "constant"})
    longer = {"training.learning_rate_schedule": "constant", "training.steps": 720}
    run(tmp_path / "longer", longer)
    outcome = run(tmp_path / "run", longer, resume=True)
    assert outcome.trainer.env_steps == 720
    assert_equal_runs(tmp_path / "longer", tmp_path / "run")
    assert RunFolder(tmp_path / "run").scenario().training.steps == 720


def test_finished_run_is_evaluated_again(tmp_path, run):
    first = run(tmp_path / "run")
    again = run(tmp_path / "run", resume=True)
    assert again.finished
    assert len(lines(tmp_path / "run")) == 7
    assert (again.evaluation.samples["reward"] == first.evaluation.samples["reward"]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"reward.kind": "paper"}, "reward.kind"),
        ({"age.maximum": 14}, "age.maximum"),
        ({"training.discount": 0.5}, "training.discount"),
        ({"training.hidden_units": [9]}, "training.hidden_units"),
        ({"duplex.kind": "tdd"}, "duplex."),
    ],
)
def test_run_of_another_scenario_is_not_resumed(tmp_path, run, changes, key):
    run(tmp_path / "run")
    before = (tmp_path / "run" / "checkpoint.pt").read_bytes()
    with pytest.raises(InputError, match="is a run of another scenario, best/k3-fdd") as raised:
        run(tmp_path / "run", changes, resume=True)
    assert f": {key}" in str(raised.value)
    assert (tmp_path / "run" / "checkpoint.pt").read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
@pytest.mark.posix
def test_signal_to_the_process_saves_and_leaves_with_its_status(
    tmp_path, iout, tiny_settings, number
):
    folder = tmp_path / "run"
    words = ["train", "best/k3-fdd", *tiny_settings]
    endless = ["--steps", str(10**9), "--out", str(folder)]
    process = Iout([*words, *endless])
    deadline = time.monotonic() + 60
    while not (folder / "metrics.jsonl").is_file() or not (folder / "metrics.jsonl").stat().st_size:
        assert time.monotonic() < deadline
        assert process.poll() is None, process.stderr.read()
        time.sleep(0.05)
    process.send_signal(number)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 128 + number, err
    assert "Traceback" not in err
    assert "stopped after" in out
    assert "--resume" in out
    done = lines(folder)[-1]["env_steps"]
    status, out, err = iout(*words, "--steps", done + 80, "--resume", folder)
    assert status == 0, err
    assert lines(folder)[-1]["env_steps"] == done + 80
    assert (folder / "result.json").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("steps", [1, 80, 479, 480])
def test_fewer_steps_than_were_taken_are_refused(tmp_path, run, steps):
    run(tmp_path / "run")
    before = (tmp_path / "run" / "scenario.yaml").read_bytes()
    with pytest.raises(InputError, match="has taken 560 steps already"):
        run(tmp_path / "run", {"training.steps": steps}, resume=True)
    assert (tmp_path / "run" / "scenario.yaml").read_bytes() == before


@pytest.mark.slow
@pytest.mark.parametrize("steps", [481, 500, 559, 560])
def test_steps_that_are_no_multiple_of_a_rollout(tmp_path, run, monkeypatch, steps):
    """A run that has taken all of them, killed before its result was written, and after."""
    changes = {"training.steps": steps}
    whole = run(tmp_path / "run", changes)
    assert whole.trainer.env_steps == 560
    complete = (tmp_path / "run/result.json").read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(training_run, "evaluate", lambda *_, **__: crash())
        with pytest.raises(CrashError):
            run(tmp_path / "killed", changes)
    assert not (tmp_path / "killed/result.json").exists()
    for name in ("killed", "run", "run"):
        again = run(tmp_path / name, changes, resume=True)
        assert again.finished
        assert again.trainer.env_steps == 560
    assert (tmp_path / "run/result.json").read_bytes() == complete
    assert_equal_runs(tmp_path / "run", tmp_path / "killed")
    assert run(tmp_path / "run", {"training.steps": 561}, resume=True).trainer.env_steps == 640


def test_signal_before_the_first_iteration(tmp_path, run, whole, monkeypatch):
    begin = training_run.TrainingLog.on_start

    def stop_and_begin(log, going):
        signal.raise_signal(signal.SIGTERM)
        begin(log, going)

    with monkeypatch.context() as patch:
        patch.setattr(training_run.TrainingLog, "on_start", stop_and_begin)
        stopped = run(tmp_path / "stopped")
    assert (stopped.finished, stopped.signal) == (False, signal.SIGTERM)
    assert stopped.trainer.env_steps == 0
    run(tmp_path / "stopped", resume=True)
    assert_equal_runs(whole(), tmp_path / "stopped")


@pytest.mark.slow
@pytest.mark.parametrize("number", SIGNALS, ids=lambda number: number.name)
def test_signal_during_the_final_evaluation(tmp_path, run, whole, monkeypatch, number):
    def stop(*_, **__):
        signal.raise_signal(number)
        raise AssertionError("the evaluation continues")

    with monkeypatch.context() as patch:
        patch.setattr(training_run, "evaluate", stop)
        stopped = run(tmp_path / "stopped")
    assert (stopped.finished, stopped.signal, stopped.evaluations) == (False, number, [])
    assert stopped.trainer.env_steps == 560
    assert run(tmp_path / "stopped", resume=True).finished
    assert_equal_runs(whole(), tmp_path / "stopped")


@pytest.mark.posix
def test_hangup_that_is_ignored_stays_so(tmp_path, run, interrupt):
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        interrupt(1, lambda: signal.raise_signal(signal.SIGHUP))
        outcome = run(tmp_path / "run")
        assert (outcome.finished, outcome.signal) == (True, None)
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_in_another_thread_signals_have_their_usual_effect(tmp_path, run):
    outcomes = []
    thread = threading.Thread(target=lambda: outcomes.append(run(tmp_path / "run")))
    thread.start()
    thread.join()
    assert outcomes[0].finished


@pytest.mark.posix
def test_command_line_is_done_only_where_the_training_is(tmp_path, iout, tiny_settings, interrupt):
    words = ["train", "best/k3-fdd", *tiny_settings]
    interrupt(2, lambda: signal.raise_signal(signal.SIGHUP))
    status, out, _ = iout(*words, "--out", tmp_path / "a run")
    assert status == 128 + signal.SIGHUP
    assert f"--resume '{tmp_path / 'a run'}'" in out
    status, out, _ = iout(*words, "--resume", tmp_path / "a run")
    assert status == 0
    status, _, err = iout(*words, "--resume", tmp_path / "a run")
    assert status == 0
    assert "a run: is complete" in err


def test_result_of_a_shorter_training_does_not_outlive_it(tmp_path, run, interrupt):
    run(tmp_path / "run")
    interrupt(1, lambda: signal.raise_signal(signal.SIGINT))
    run(tmp_path / "run", {"training.steps": 800}, resume=True)
    assert not (tmp_path / "run" / "result.json").exists()


def test_divergence_says_what_there_is_to_go_on_from(tmp_path, run):
    expected = r"run: training diverged after 80 .*; nothing was saved yet$"
    with pytest.raises(DivergedError, match=expected) as raised:
        run(tmp_path / "run", {"training.learning_rate": 1e30})
    assert str(tmp_path) not in raised.value.reason
    assert {path.name for path in (tmp_path / "run").iterdir()}.isdisjoint(saving.NAMES)


#: Every setting of a training that is a number, and has no upper limit of its own.
UNBOUNDED = [
    key
    for key, field in Training.model_fields.items()
    if field.annotation is float and not any(hasattr(m, "le") for m in field.metadata)
]


@pytest.mark.parametrize("value", [1e30, 1e300, 1.7e308])
@pytest.mark.parametrize("key", UNBOUNDED)
def test_settings_that_are_too_large_end_in_one_line_or_not_at_all(tmp_path, tiny, key, value):
    try:
        scenario = tiny({f"training.{key}": value})
        train(scenario, tmp_path, console=Console(file=io.StringIO()), evaluation_episodes=1)
    except InputError as error:
        assert str(error).isprintable()  # noqa: PT017 (a training that copes is right too)


def test_resumed_run_takes_no_other_seed(iout, tmp_path):
    status, _, err = iout("train", "best/k3-fdd", "--resume", tmp_path, "--seed", 3)
    assert status == 2
    assert "--seed: a resumed run continues with its own seed" in err


@pytest.mark.parametrize("idle_choices", [False, True])
def test_states_have_what_was_unasked_where_nobody_can_be_named(tiny, idle_choices):
    scenario = tiny({"auvs.idle_choices": idle_choices})
    first, second = Trainer(scenario, 0), Trainer(scenario, 1)
    first.iterate()
    saved = first.state_dict()
    assert ("unasked" in saved["collector"]["state"]) == idle_choices
    second.load_state_dict(saved)
    first.iterate()
    second.iterate()
    expected = first.weights()
    assert all(torch.equal(tensor, expected[name]) for name, tensor in second.weights().items())
