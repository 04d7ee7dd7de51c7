"""Trainings that are killed, at every write and at any time, and what is left of them.

Whoever reads what a killed training has left sees the state of one moment, of all policies, or
that nothing was saved yet; and the training continues to the weights that it would have come to
without. Trainings run in forks of this process, where torch is loaded already.
"""

import functools
import hashlib
import io
import os
import signal
import sys
import tempfile
import time
import traceback
import warnings
from dataclasses import dataclass
from pathlib import Path

import torch
from rich.console import Console
from tiny_study import TINY

from campaigns.campaign import Campaign, Tally
from iout_marl import InputError, load_scenario
from iout_marl.cli import main
from iout_marl.scenario import to_yaml
from trainers import RunFolder, Trainer, train

SEED = 3
#: How many policies side by side.
GROUPS = (1, 2, 3)
SIGNALS = (signal.SIGTERM, signal.SIGHUP, signal.SIGINT)
#: What writing is made of; before each of them a kill may come.
WRITES = {"open", "os.rename", "os.remove", "os.mkdir"}


@dataclass(frozen=True)
class Reference:
    """A training that nothing has come in the way of.

    Attributes:
        weights: their digest by seed and environment steps.
        scores: the final mean AoI, by seed.
        moments: how many writes there were.
        seconds: how long it took.
    """

    weights: dict[int, dict[int, str]]
    scores: dict[int, float]
    moments: int
    seconds: float


@functools.cache
def scenario():
    """Three rollouts, a save after each."""
    changes = {**TINY, "training.steps": 240, "training.checkpoint_steps": 80}
    return load_scenario(load_scenario("best/k3-fdd", changes))


def digest(weights):
    """Of a network's weights."""
    found = hashlib.sha256()
    for name, tensor in sorted(weights.items()):
        found.update(name.encode() + tensor.contiguous().numpy().tobytes())
    return found.hexdigest()


def go(folder, replicas=1, **options):
    """Train quietly."""
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 3}
    return train(scenario(), folder, SEED, replicas=replicas, **quiet, **options)


@functools.cache
def reference(replicas):
    """What a training of so many policies comes to."""
    weights = {SEED + i: {} for i in range(replicas)}
    iterate = Trainer.iterate_all

    def iterate_and_note(trainer):
        log = iterate(trainer)
        for i, seed in enumerate(trainer.seeds):
            weights[seed][trainer.env_steps] = digest(trainer.weights(i))
        return log

    begun = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        Trainer.iterate_all = iterate_and_note
        try:
            outcome = go(Path(folder) / "run", replicas)
        finally:
            Trainer.iterate_all = iterate
    seconds = time.monotonic() - begun
    scores = {
        seed: float(evaluation.samples["mean_aoi"].mean())
        for seed, evaluation in zip(outcome.trainer.seeds, outcome.evaluations, strict=True)
    }
    with tempfile.TemporaryDirectory() as folder:
        counted = Path(folder) / "moments"
        _in_fork(Path(folder), lambda: _go_and_count(Path(folder) / "run", replicas, counted))
        moments = int(counted.read_text())
    return Reference(weights, scores, moments, seconds)


def _in_fork(folder, work, meanwhile=None):
    """Do work in a fork of this process: its wait status, and what it has printed.

    Args:
        folder: where what it prints goes.
        work: what to do.
        meanwhile: is called with the process's id.
    """
    printed = folder / "printed"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of threads: none of them counts
        signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
        pid = os.fork()
    if pid == 0:
        status = 70
        try:
            for number, usual in zip(
                SIGNALS, (signal.SIG_DFL, signal.SIG_DFL, signal.default_int_handler), strict=True
            ):
                signal.signal(number, usual)
            with printed.open("w") as file:
                os.dup2(file.fileno(), 1)
                os.dup2(file.fileno(), 2)
            sys.stdout = os.fdopen(1, "w", buffering=1)
            sys.stderr = os.fdopen(2, "w", buffering=1)
            torch.set_num_threads(1)
            status = 130
            signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)  # may be interrupted right here
            status = 70
            work()
            status = 0
        except SystemExit as end:
            status = end.code or 0
        except BaseException:  # a fork must not continue with what its parent does
            if status == 70:
                traceback.print_exc()
        finally:
            os._exit(status)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    if meanwhile is not None:
        meanwhile(pid)
    return os.waitpid(pid, 0)[1], printed.read_text() if printed.exists() else ""


def _before_each_write(folder, act):
    """Call `act`, in this process from now on, before each write in a folder.

    It gets the open file where one is about to be brought to the disk, else None.
    """
    place, fsync = str(folder), os.fsync

    def hook(event, arguments):
        if event not in WRITES or not str(arguments[0]).startswith(place):
            return
        is_read = event == "open" and not (arguments[2] or 0) & (os.O_WRONLY | os.O_RDWR)
        if not is_read:
            act(None)

    def fsync_and_act(handle):
        act(handle)
        fsync(handle)

    sys.addaudithook(hook)
    os.fsync = fsync_and_act


def _go_and_count(folder, replicas, counted):
    count = 0

    def act(_):
        nonlocal count
        count += 1

    _before_each_write(folder, act)
    go(folder, replicas)
    counted.write_text(str(count))


def _go_until(folder, replicas, moment):
    """Train until a certain write, and die there."""
    left = moment

    def act(handle):
        nonlocal left
        if left == 0:
            if handle is not None and moment % 2:  # of a file not all has come to the disk
                os.ftruncate(handle, os.fstat(handle).st_size // 2)
            os.kill(os.getpid(), signal.SIGKILL)
        left -= 1

    _before_each_write(folder, act)
    go(folder, replicas)


def _runs(folder, replicas):
    if replicas == 1:
        return {SEED: RunFolder(folder)}
    return {SEED + i: RunFolder(folder / f"seed-{SEED + i}") for i in range(replicas)}


def left_by(folder, replicas, right):
    """Of how many steps the save is that a killed training has left; None where there is none.

    Raises:
        AssertionError: it is not the state of one moment.
    """
    found = set()
    for seed, run in _runs(folder, replicas).items():
        try:
            steps = run.policy_shape()["env_steps"]
        except InputError as error:
            if not str(error).endswith("holds no trained policy"):
                raise
            steps = None
        found.add(steps)
        if steps:
            assert digest(run.load_policy().network.state_dict()) == right.weights[seed][steps]
            checkpoint = run.load_checkpoint()
            assert checkpoint["env_steps"] == steps, "checkpoint and policy differ"
            assert digest(checkpoint["network"]) == right.weights[seed][steps]
            if run.result() is not None:
                assert steps == max(right.weights[seed]), "a result of an unfinished training"
    (steps,) = found
    return steps


def check(folder, replicas, right):
    """Read what is there, and train to the end: what was left, in a word.

    Raises:
        AssertionError: something is lost.
    """
    steps = left_by(folder, replicas, right)
    outcome = go(folder, replicas, resume=steps is not None)
    assert outcome.finished
    last = max(right.weights[SEED])
    assert left_by(folder, replicas, right) == last
    for seed, evaluation in zip(outcome.trainer.seeds, outcome.evaluations, strict=True):
        assert float(evaluation.samples["mean_aoi"].mean()) == right.scores[seed]
    for run in outcome.runs:
        assert not list(run.path.glob("*.part")), "something is left over"
        assert run.result() is not None
    return "nothing saved yet" if steps is None else "gone on with"


def _killed_at(folder, replicas, moment):
    run, right = folder / "run", reference(replicas)
    status, printed = _in_fork(folder, lambda: _go_until(run, replicas, moment))
    assert os.WIFSIGNALED(status), printed
    return f"killed at a write, {check(run, replicas, right)}"


def _killed_after(folder, replicas, seconds):
    run, right = folder / "run", reference(replicas)

    def kill(pid):
        time.sleep(seconds)
        os.kill(pid, signal.SIGKILL)

    _in_fork(folder, lambda: go(run, replicas), kill)
    return f"killed at any time, {check(run, replicas, right)}"


def _signalled_after(folder, replicas, number, seconds):
    run, right = folder / "run", reference(replicas)
    source = folder / "scenario.yaml"
    source.write_text(to_yaml(scenario()), encoding="utf-8")
    words = ["train", str(source), "--out", str(run), "--seed", str(SEED)]
    words += ["--replicas", str(replicas)]

    def ask(pid):
        time.sleep(seconds)
        os.kill(pid, number)

    status, printed = _in_fork(folder, lambda: main(words), ask)
    # Before a training catches signals, and after, they have their usual effect.
    code = -status if os.WIFSIGNALED(status) else os.WEXITSTATUS(status)
    assert code in (0, -number, 128 + number), (code, printed)
    assert "Traceback" not in printed, printed
    if code == 128 + number and "stopped after" in printed:
        assert left_by(run, replicas, right) is not None, "it has stopped without a save"
    return f"asked to end, {check(run, replicas, right)}"


def _plan(rng, cases):
    """Every write first, then kills and signals at any time, as many as there is room for."""
    writes = [
        (_killed_at, replicas, moment)
        for replicas in GROUPS[:2]
        for moment in range(reference(replicas).moments)
    ]
    others = []
    for i in range(max(cases - len(writes), cases // 5, 2)):
        replicas = GROUPS[i % len(GROUPS)]
        seconds = float(rng.uniform(0, 1.2 * reference(replicas).seconds))
        if i % 2:
            others.append((_killed_after, replicas, seconds))
        else:
            others.append((_signalled_after, replicas, SIGNALS[i // 2 % 3], seconds))
    chosen = rng.permutation(len(writes))[: cases - len(others)]
    return [*(writes[i] for i in sorted(chosen)), *others]


def run(rng, cases):
    """Kill so many trainings."""
    tally = Tally()
    for kill, *arguments in _plan(rng, cases):
        case = f"{kill.__name__}{tuple(arguments)}"
        with tempfile.TemporaryDirectory() as folder:
            try:
                tally.note(kill(Path(folder), *arguments))
            except Exception as error:  # whatever a reader or a training raises is a fault
                tally.fault(case, error)
    return tally


CAMPAIGN = Campaign("killed trainings", cases=320, short=3, run=run, parts=1)
