"""Two processes on this machine, over its loopback, learn what one alone does."""

import json
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import forked
import pytest
import torch
from safetensors.torch import load_file

from iout_marl.scenario import to_yaml
from trainers import RunFolder, started_group, train

pytestmark = pytest.mark.slow

HERE = Path(__file__).parent
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


def torchrun(*command):
    """What torchrun is told to run a command by two processes, with a port of its own choice."""
    return [
        *("--nnodes", "1", "--nproc-per-node", "2"),
        *("--rdzv-backend", "c10d", "--rdzv-endpoint", "localhost:0"),
        *map(str, command),
    ]


def environment():
    # More threads than cores would make the processes wait for one another.
    return {**os.environ, "OMP_NUM_THREADS": "1"}


@pytest.fixture
def scenario_file(tiny, tmp_path):
    def write(changes=()):
        path = tmp_path / "scenario.yaml"
        path.write_text(to_yaml(tiny({"training.steps": 400, **dict(changes)})), encoding="utf-8")
        return path

    return write


def side_by_side(*words, processes=2):
    """Trainings started with what torchrun lets each know, but without it; what became of them."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = str(free.getsockname()[1])
    started = []
    for rank in map(str, range(processes)):
        place = {"RANK": rank, "LOCAL_RANK": rank, "WORLD_SIZE": str(processes)}
        group = {"MASTER_ADDR": "127.0.0.1", "MASTER_PORT": port, "TORCHELASTIC_RUN_ID": "tests"}
        started.append(forked.Iout(("train", *words), env={**environment(), **place, **group}))
    ended = []
    for process in started:
        with process:
            out, err = process.communicate(forked.PATIENCE_S)
        ended.append(subprocess.CompletedProcess(words, process.returncode, out, err))
    return ended


def under_torchrun(*words):
    """A training by two processes that torchrun starts, as users do."""
    command = [sys.executable, "-m", TORCHRUN, *torchrun("-m", "trainers.ppo", *words)]
    return [subprocess.run(command, capture_output=True, text=True, env=environment(), check=False)]


@pytest.mark.parametrize(
    ("changes", "started"),
    [*zip(VARIANTS.values(), (under_torchrun, side_by_side, under_torchrun), strict=True)],
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
    lines = all_refused(str(scenario_file()), "--out", str(tmp_path / "run"), processes=3)
    expected = "iout: training.environments: 4 cannot be shared evenly by 3 processes"
    assert expected in lines


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


@pytest.mark.parametrize("lost", [0, 1])
def test_lost_process_ends_the_training_and_leaves_a_checkpoint(
    scenario_file, tmp_path, tiny, lost
):
    changes = {"training.steps": 80_000, "training.checkpoint_steps": 80}
    run = tmp_path / "run"
    command = torchrun(HERE / "lost_rank.py", scenario_file(changes), "--out", run)
    result = forked.run(*command, program=TORCHRUN, env={**environment(), "LOST": str(lost)})
    assert result.returncode != 0
    assert f"iout: {run}: another process of the training was lost after" in result.stderr
    assert "last checkpoint: " in result.stderr
    saved = RunFolder(run).load_checkpoint()["env_steps"]
    assert 80 <= saved <= 400
    outcome = train(tiny({"training.steps": 800}), run, resume=True)
    assert outcome.finished


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_stop_signal_saves_all_at_the_same_step(scenario_file, tmp_path, tiny, number):
    run = tmp_path / "run"
    endless = scenario_file({"training.steps": 10_000_000})
    command = torchrun("-m", "trainers.ppo", endless, "--out", run)
    with forked.Iout(command, program=TORCHRUN, env=environment()) as process:
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
