"""The same study on a real Dask cluster: a scheduler and two workers on loopback."""

import json
import os
import subprocess
import sys

import pytest
from tiny_study import PATIENCE_S, STUDY, wait_for, write_study

from iout_marl import InputError
from iout_marl.study.cluster import DaskCluster


@pytest.fixture
def cluster(tmp_path):
    """The address of the scheduler, and the processes of the workers."""
    started = []

    def start(module, *words):
        command = [sys.executable, "-m", f"distributed.cli.{module}", *words]
        with (tmp_path / f"{module}-{len(started)}.log").open("w") as log:
            started.append(subprocess.Popen(command, stdout=log, stderr=log, cwd=tmp_path))
        return started[-1]

    file = tmp_path / "scheduler.json"
    loopback = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    start("dask_scheduler", *loopback, "--scheduler-file", str(file))
    address = json.loads(wait_for(lambda: file.exists() and file.read_text()))["address"]
    alone = ("--no-nanny", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard")
    workers = [start("dask_worker", address, *alone) for _ in range(2)]
    yield address, workers
    for process in started:
        process.kill()
        process.wait()


def test_a_study_survives_the_loss_of_a_worker(cluster, tmp_path):
    address, workers = cluster
    trained = {**STUDY["groups"]["trained"], "seeds": [0, 1, 2]}
    trained["settings"] = {**trained["settings"], "training.steps": 4_000}
    path = write_study(
        tmp_path / "study.yaml", groups={**STUDY["groups"], "trained": trained}, quick={}
    )
    out = tmp_path / "out"
    words = ["--study", str(path), "--out", str(out), "--scheduler", address]
    study = subprocess.Popen(
        [sys.executable, "-m", "iout_marl", "reproduce", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )
    wait_for(lambda: list((out / "cells").glob("*-ppo-*.json")) or study.poll() is not None)
    workers[0].kill()
    _, told = study.communicate(timeout=PATIENCE_S)
    assert study.returncode == 0, told
    results = json.loads((out / "results.json").read_text())
    assert len(results["cells"]) == 8
    assert results["failures"] == []
    assert len(list((out / "runs").iterdir())) == 6
    assert all((run / "policy.safetensors").stat().st_size for run in (out / "runs").iterdir())


def test_an_address_without_a_scheduler_is_told(monkeypatch):
    monkeypatch.setattr("iout_marl.study.cluster.CONNECT_S", 1)
    with pytest.raises(InputError, match=r"--scheduler tcp://127\.0\.0\.1:9: no scheduler"):
        DaskCluster("tcp://127.0.0.1:9")


def test_an_address_that_is_none_is_told_at_once():
    command = [sys.executable, "-m", "iout_marl", "reproduce", "--scheduler", "foo"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == (
        "iout: --scheduler foo: must be an address such as tcp://127.0.0.1:8786\n"
    )


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install 'iout-marl\[cluster\]'"):
        DaskCluster("tcp://127.0.0.1:9")
