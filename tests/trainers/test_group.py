"""Two processes on this machine, over its loopback, learn what one alone does."""

import json
import os
import signal
import socket
import subprocess
import sys
import time

import forked
import pytest
import torch
from safetensors.torch import load_file

from iout_marl.scenario import to_yaml
from iout_marl.signals import StopSignals
from trainers import RunFolder, started_group, train

pytestmark = pytest.mark.slow

VARIANTS = {
    "masks, tdd, random layouts, running normalisers": {
        "duplex.kind": "tdd",
        "training.mask_actions": True,
        "nodes": {"kind": "random", "count": 2},
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
    },
    "two auvs, mid-episode": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "training.rollout_slots": 13,
        "training.minibatches": 3,
    },
    "families of scenarios": {
        "nodes": {"kind": "random", "count": 2},
        "observation": {"kind": "table"},
        "training.network": {"kind": "set", "width": 8, "blocks": 1, "critic_width": 8},
        "training.curriculum": "gap",
        "training.over": [{"vary": {"nodes.count": {"from": 1, "to": 4}, "auvs.count": [1, 2]}}],
    },
}


TORCHRUN = "torch.distributed.run"
#: Lets torchrun fork its processes, which lead sessions of their own as those that it starts do.
FORKS = """
from multiprocessing import forkserver

from torch.distributed.elastic.multiprocessing.subprocess_handler import SubprocessHandler

import forked


def popen(handler, command, environment):
    words = ("train", *command[command.index("trainers.ppo") + 1 :])
    options = {"streams": (0, 1, 2), "env": environment, "leads": True}
    return forked.Iout(words, environment.get("BEFORE", ""), **options)


SubprocessHandler._popen = popen
# By the server that this process is from: it would start one of its own.
forkserver._forkserver.ensure_running = lambda: None
"""
#: The process that LOST names dies in its training.
DIES = """
import os

from trainers import Trainer

iterate, ITERATIONS = Trainer.iterate_all, 5


def iterate_and_die(trainer):
    logs = iterate(trainer)
    is_time = trainer.env_steps >= ITERATIONS * trainer.steps_per_iteration
    if is_time and trainer.runtime.group.rank == int(os.environ["LOST"]):
        os._exit(7)
    return logs


Trainer.iterate_all = iterate_and_die
"""


def torchrun(*words):
    """What torchrun is told to train by two processes, with a port of its own choice."""
    return [
        *("--nnodes", "1", "--nproc-per-node", "2"),
        *("--rdzv-backend", "c10d", "--rdzv-endpoint", "localhost:0"),
        *("-m", "trainers.ppo", *map(str, words)),
    ]


def environment():
    # More threads than cores would make the processes wait for one another.
    return {**os.environ, "OMP_NUM_THREADS": "1"}


def forking_torchrun(*words, **more):
    """`torchrun` in a process that has everything imported, and so have those that it starts."""
    options = {"program": TORCHRUN, "env": {**environment(), **more}}
    return forked.Iout(torchrun(*words), FORKS, **options)


@pytest.fixture
def scenario_file(tiny, tmp_path):
    def write(changes=()):
        path = tmp_path / "scenario.yaml"
        path.write_text(to_yaml(tiny({"training.steps": 400, **dict(changes)})), encoding="utf-8")
        return path

    return write


#: The processes find no memory to share, as those of several machines.
APART = """
from pathlib import Path

from trainers.accel import shared_memory

shared_memory.MEMORY = Path("/nowhere")
"""


def side_by_side(*words, processes=2, before=""):
    """Trainings started with what torchrun lets each know, but without it; what became of them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    started = []
    for rank in map(str, range(processes)):
        place = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": str(processes)}
        group = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "TORCHELASTIC_RUN_ID": "tests"}
        env = {**environment(), **place, **group}
        started.append(forked.Iout(("train", *words), before, env=env))
    ended = []
    for process in started:
        with process:
            out, err = process.communicate(forked.PATIENCE_S)
        ended.append(subprocess.CompletedProcess(words, process.returncode, out, err))
    return ended


def apart(*words):
    """A training by two processes that share no memory."""
    return side_by_side(*words, before=APART)


def under_torchrun(*words):
    """A training by two processes that torchrun starts, as users do."""
    command = [sys.executable, "-m", TORCHRUN, *torchrun(*words)]
    return [subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)]


@pytest.mark.parametrize(
    ("changes", "started"),
    [*zip(VARIANTS.values(), (under_torchrun, side_by_side, apart), strict=True)],
    ids=list(VARIANTS),
)
def test_two_processes_learn_what_one_does(scenario_file, tiny, tmp_path, changes, started):
    path = scenario_file(changes)
    ended = started(path, "--out", tmp_path / "two", "--seed", "4")
    assert not any(each.returncode for each in ended), ended
    alone = train(tiny({"training.steps": 400, **changes}), tmp_path / "one", seed=4)
    two = RunFolder(tmp_path / "two")
    ours, theirs = (load_file(run.path / "policy.safetensors") for run in (two, alone.run))
    # A bias that a softmax takes away again has a gradient of rounding alone, which Adam makes
    # steps of: up to 2e-5 here, where what is learnt moves by 2e-2.
    for name, tensor in theirs.items():
        torch.testing.assert_close(ours[name], tensor, rtol=1e-4, atol=1e-4, msg=name)
    lines = [
        [json.loads(line) for line in run.metrics_path.read_text().splitlines()]
        for run in (two, alone.run)
    ]
    for ours, theirs in zip(*lines, strict=True):
        for tag, value in theirs.items():
            if not tag.startswith("speed/"):
                assert ours[tag] == pytest.approx(value, rel=1e-3, abs=1e-4), tag
    # One reports, and what it reports is the whole.
    assert sum(each.stdout.count("trained for") for each in ended) == 1
    # A checkpoint is that of all environments: one process can continue with it.
    longer = tiny({**changes, "training.steps": 800})
    outcomes = [train(longer, run.path, resume=True) for run in (two, alone.run)]
    ours, theirs = (outcome.trainer.weights() for outcome in outcomes)
    for name, tensor in theirs.items():
        torch.testing.assert_close(ours[name], tensor, rtol=1e-3, atol=1e-4, msg=name)


def all_refused(*words, processes=2):
    """What each process says of a training that does not begin."""
    ended = side_by_side(*words, processes=processes)
    assert all(each.returncode for each in ended)
    return [li for each in ended for li in each.stderr.splitlines() if li.startswith("iout: ")]


def test_environments_that_cannot_be_shared_evenly(scenario_file, tmp_path):
    path = scenario_file()
    lines = all_refused(str(path), "--out", str(tmp_path / "run"), processes=3)
    places = [n for n, li in enumerate(path.read_text().splitlines(), 1) if "environments:" in li]
    expected = "training.environments: 4 cannot be shared evenly by 3 processes"
    assert f"iout: {path}:{places[0]}: {expected}" in lines


def test_policies_side_by_side_are_for_one_process(scenario_file, tmp_path):
    run = tmp_path / "run"
    lines = all_refused(str(scenario_file()), "--out", str(run), "--replicas", "2")
    expected = "policies side by side are trained by one process, without torchrun"
    assert f"iout: --replicas: {expected}" in lines
    assert not run.exists()


def test_folder_in_use_is_told_by_the_first_process(scenario_file, tmp_path, tiny):
    train(tiny(), tmp_path / "run", evaluation_episodes=1)
    lines = all_refused(str(scenario_file()), "--out", str(tmp_path / "run"))
    assert sum("holds a run already" in line for line in lines) == 1


def test_what_schedulers_leave_in_the_environment_starts_no_group(monkeypatch):
    monkeypatch.setenv("WORLD_SIZE", "2")
    with started_group(torch.device("cpu")) as (group, device):
        assert (group.rank, group.size, device.type) == (0, 1, "cpu")


def test_a_signal_that_is_ignored_stays_so_when_signals_are_no_longer_caught():
    before = signal.getsignal(signal.SIGTERM)
    try:
        with StopSignals() as signals:
            signals.ignore(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) is signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
    finally:
        signal.signal(signal.SIGTERM, before)


@pytest.mark.parametrize("lost", [0, 1])
def test_lost_process_ends_the_training_and_leaves_a_checkpoint(
    scenario_file, tmp_path, tiny, lost
):
    changes = {"training.steps": 80_000, "training.checkpoint_steps": 80}
    run = tmp_path / "run"
    words = (scenario_file(changes), "--out", run)
    with forking_torchrun(*words, LOST=str(lost), BEFORE=DIES) as process:
        _, told = process.communicate(forked.PATIENCE_S)
    assert process.returncode != 0
    assert f"iout: {run}: another process of the training was lost after" in told
    assert "last checkpoint: " in told
    saved = RunFolder(run).load_checkpoint()["env_steps"]
    assert 80 <= saved <= 400
    outcome = train(tiny({"training.steps": 800}), run, resume=True)
    assert outcome.finished


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stop_signal_saves_all_at_the_same_step(scenario_file, tmp_path, tiny, number):
    run = tmp_path / "run"
    endless = scenario_file({"training.steps": 10_000_000})
    with forking_torchrun(endless, "--out", run) as process:
        metrics = run / "metrics.jsonl"
        while not (metrics.is_file() and metrics.read_text().count("\n") > 3):
            assert process.poll() is None, process.communicate()
            time.sleep(0.05)
        process.send_signal(number)
        process.communicate(timeout=60)
    saved = RunFolder(run).load_checkpoint()["env_steps"]
    logged = [json.loads(line)["env_steps"] for line in metrics.read_text().splitlines()]
    assert saved == logged[-1]
    assert train(tiny({"training.steps": saved + 80}), run, resume=True).finished
