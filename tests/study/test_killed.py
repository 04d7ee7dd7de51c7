"""Studies as processes of their own: what happens when one of them is killed."""

import json
import os
import signal
import time

import forked
import psutil
import pytest
from tiny_study import PATIENCE_S, STUDY, let_last, wait_for, write_study

pytestmark = pytest.mark.slow

#: Trainings of half a second: long enough to be killed in.
SETTINGS = {"training.steps": 1_600}
CELLS = 6


@pytest.fixture
def study(tmp_path):
    trained = STUDY["groups"]["trained"]
    trained = {**trained, "settings": {**trained["settings"], **SETTINGS}, "seeds": [0, 1, 2]}
    trained.pop("variants")
    more = {**trained, "series": "more", "settings": {**trained["settings"], "nodes.count": 3}}
    groups = {"trained": {**trained, "series": "ppo"}, "more": more}
    return write_study(tmp_path / "study.yaml", groups=groups)


@pytest.fixture
def start(study, tmp_path):
    """Starts `iout reproduce` on the study; whatever is left of it is ended.

    Where what counts is how long cells last, not how workers begin, these are forked.
    """
    started = []
    temporary = tmp_path / "temporary"
    temporary.mkdir()

    def starter(*, forks=True):
        words = ("reproduce", "--study", study, "--out", tmp_path / "out", "--jobs", "2")
        env = {**os.environ, "TMPDIR": str(temporary)}
        started.append(forked.Iout(words, env=env, folder=tmp_path, leads=True, forks=forks))
        return started[-1]

    yield starter
    for process in started:
        process.kill()
        process.close()


def finished_cells(tmp_path):
    return sorted((tmp_path / "out" / "cells").glob("*.json"))


def workers_of(process):
    """Its children but for the one that keeps count of semaphores."""
    children = psutil.Process(process.pid).children()
    return [p for p in children if "resource_tracker" not in str(p.cmdline())]


def results(tmp_path):
    return json.loads((tmp_path / "out" / "results.json").read_text())


def test_a_killed_worker_costs_no_cell(start, tmp_path):
    process = start()
    wait_for(lambda: finished_cells(tmp_path))
    workers_of(process)[0].kill()
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0, told
    assert len(results(tmp_path)["cells"]) == CELLS
    assert results(tmp_path)["failures"] == []


def test_a_killed_study_takes_its_workers_along_and_goes_on_where_it_was(start, tmp_path):
    process = start()
    wait_for(lambda: finished_cells(tmp_path))
    workers = workers_of(process)
    assert workers
    process.kill()
    process.wait(PATIENCE_S)
    wait_for(lambda: not any(worker.is_running() for worker in workers))
    assert list((tmp_path / "temporary").glob("iout-*")) == []
    before = {path: path.stat().st_mtime_ns for path in finished_cells(tmp_path)}
    assert 1 <= len(before) < CELLS
    again = start()
    _, told = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0, told
    assert f"{len(before)} are there already" in told
    assert len(finished_cells(tmp_path)) == CELLS
    assert before == {path: path.stat().st_mtime_ns for path in before}


@pytest.mark.parametrize("number", [signal.SIGHUP, signal.SIGINT, signal.SIGTERM])
def test_a_stopped_study_says_how_to_go_on(start, study, tmp_path, number):
    let_last(study)
    process = start()
    wait_for(lambda: finished_cells(tmp_path))
    process.send_signal(number)
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number
    assert "stopped; what is finished stays. Continue with: iout reproduce" in told
    assert "Traceback" not in told
    assert not (tmp_path / "out" / "results.json").exists()


#: When a signal comes: what has been seen to be there, and how many seconds later.
MOMENTS = {
    "second worker": (lambda process, _: len(workers_of(process)) == 2, 0.0),
    "workers that start": (lambda process, _: workers_of(process), 0.5),
    "workers that import": (lambda process, _: workers_of(process), 1.5),
    "first cell": (lambda _, tmp_path: finished_cells(tmp_path), 0.0),
}


@pytest.mark.parametrize(
    ("number", "moment"),
    [*((signal.SIGINT, moment) for moment in MOMENTS), (signal.SIGHUP, "workers that start")],
    ids=lambda value: getattr(value, "name", value),
)
def test_a_signal_of_the_terminal_to_all_processes_makes_no_traceback(
    start, study, tmp_path, number, moment
):
    is_there, seconds = MOMENTS[moment]
    let_last(study)
    process = start(forks=moment == "first cell")
    wait_for(lambda: is_there(process, tmp_path))
    time.sleep(seconds)
    workers = workers_of(process)
    os.killpg(process.pid, number)
    _, told = process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 128 + number, told
    assert "stopped; what is finished stays. Continue with: iout reproduce" in told
    assert "Traceback" not in told
    assert "Error" not in told
    wait_for(lambda: not any(worker.is_running() for worker in workers))
    assert list((tmp_path / "temporary").glob("iout-*")) == []
