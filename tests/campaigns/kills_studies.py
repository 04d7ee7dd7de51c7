"""Studies whose processes are killed or stopped at any moment: the same command continues.

A case is a kill: of the main process, of a worker, or of a Dask cluster's scheduler. In the end
the results must be those of a study that nobody disturbed, but for times.
"""

import itertools
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from functools import cache
from pathlib import Path

import psutil
from tiny_cluster import Cluster
from tiny_study import PATIENCE_S, STUDY, SameProcess, wait_for, write_study

from campaigns.campaign import Campaign, Tally
from iout_marl.study import expand, load_study

#: Two trainings of a moment, and four cells that play.
GROUPS = {
    "baseline": {**STUDY["groups"]["baseline"], "seeds": [7, 8]},
    "trained": {**STUDY["groups"]["trained"], "variants": {"paper": {}}},
}
#: What is waited for, before a kill a moment later: files that come to be there, one by one.
EVENTS = (
    *("", "", ".lock", "study.json", "study.json", "cells/*.json", "cells/*.json"),
    *("runs/*/*", "cells/*-ppo-*.json", "results.json", "figures/*"),
)
NAMES = {"stop": "main stopped"}
STOPS = (signal.SIGHUP, signal.SIGINT, signal.SIGTERM)
#: Kills of one study, at most, before it is left in peace.
KILLS = 5
#: What of a record differs from run to run.
OF_ITS_OWN = ("machine", "date")


def run(rng, cases):
    """Disturb studies until there were so many kills, and see each of them to its end."""
    # A shell lets what it starts in the background ignore Ctrl-C, and so its children.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    tally = Tally()
    expected = undisturbed()
    while tally.cases < cases:
        kills = min(int(rng.integers(1, KILLS + 1)), cases - tally.cases)
        on_dask = bool(rng.random() < 0.4)
        with tempfile.TemporaryDirectory() as folder:
            study = Disturbed(Path(folder), rng, on_dask=on_dask)
            try:
                outcomes = list(itertools.takewhile(bool, (study.disturb() for _ in range(kills))))
                study.finish(expected)
            # Whatever goes wrong is what is looked for here.
            except Exception as error:
                tally.fault((on_dask, study.history, study.told()[-1_000:]), error)
            else:
                for outcome in outcomes:
                    tally.note(outcome)
            finally:
                study.close()
    return tally


@cache
def undisturbed():
    """The records of the study, by key, as one process computes them."""
    import torch

    torch.set_num_threads(1)
    with tempfile.TemporaryDirectory() as folder:
        study, layer = load_study(write_study(Path(folder) / "study.yaml", groups=GROUPS))
        outcomes = list(SameProcess().run(expand(study, layer), study.carbon_g_per_kwh))
    return {cell.key: figures(output.record.model_dump()) for cell, output in outcomes}


def figures(record):
    """A record without what differs from run to run."""
    record = {key: value for key, value in record.items() if key not in OF_ITS_OWN}
    if record["training"]:
        kept = ("settings", "env_steps", "curve")
        record["training"] = {key: record["training"][key] for key in kept}
    return record


class Disturbed:
    """A study in a folder, started again after every kill."""

    def __init__(self, folder, rng, *, on_dask):
        self.out = folder / "out"
        self.history = []
        self._rng = rng
        self._temporary = folder / "temporary"
        self._temporary.mkdir()
        self._study = write_study(folder / "study.yaml", groups=GROUPS)
        self._log = folder / "log"
        self._cluster_folder = folder / "dask"
        self._cluster_folder.mkdir()
        self._cluster = Cluster(self._cluster_folder) if on_dask else None
        self._process = None
        self._finished = {}

    def told(self):
        """What the last start wrote."""
        return self._log.read_text() if self._log.exists() else ""

    def disturb(self):
        """Kill or stop something at a moment; how the case is called, None if it came too late."""
        kinds = ("main", "main", "stop", "worker", *(("scheduler",) if self._cluster else ()))
        whom = kinds[self._rng.integers(len(kinds))]
        if self._process is None or self._process.poll() is not None:
            self._start()
        event = EVENTS[self._rng.integers(len(EVENTS))]
        self.history.append((whom, event))
        self._wait(event)
        if self._process.poll() is not None:
            return None
        getattr(self, f"_kill_{whom}")()
        where = "Dask" if self._cluster else "local"
        return f"{where} {NAMES.get(whom, f'{whom} killed')}"

    def finish(self, expected):
        """Let it end; its results are those that were expected, and nothing is left over."""
        if self._process is None or self._process.poll() is not None:
            self._start()
        self.history.append("left in peace")
        assert self._process.wait(PATIENCE_S) == 0, "the last start did not end well"
        data = json.loads((self.out / "results.json").read_text())
        found = {cell["record"]["key"]: figures(cell["record"]) for cell in data["cells"]}
        assert not data["failures"], "cells failed"
        assert found.keys() == expected.keys(), "cells are missing"
        different = [key for key in expected if found[key] != expected[key]]
        assert not different, f"other results: {different}"
        self._check_left()
        again = {path: path.stat().st_mtime_ns for path in self._finished}
        assert again == self._finished, "cells that were finished have been run once more"
        assert not list(self.out.rglob("*.part")), "parts of files are left"

    def close(self):
        """End all processes."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()
        if self._cluster is not None:
            self._cluster.__exit__()

    def _start(self):
        cells = (self.out / "cells").glob("*.json")
        self._finished = {path: path.stat().st_mtime_ns for path in cells}
        where = ("--jobs", "2") if self._cluster is None else ("--scheduler", self._cluster.address)
        words = ["reproduce", "--study", str(self._study), "--out", str(self.out), *where]
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "iout_marl", *words],
                stdout=subprocess.DEVNULL,
                stderr=log,
                env={**os.environ, "TMPDIR": str(self._temporary)},
            )

    def _wait(self, event):
        """Until there is one file more of a kind, or the study has ended, and a moment longer."""
        if event:
            there = len(list(self.out.glob(event)))
            wait_for(
                lambda: self._process.poll() is not None or len(list(self.out.glob(event))) > there
            )
        time.sleep(self._rng.choice((0.001, 0.05, 1.0)) * self._rng.random())

    def _kill_main(self):
        children = self._children()
        self._process.kill()
        self._process.wait()
        wait_for(lambda: not any(child.is_running() for child in children))
        self._check_left()

    def _kill_stop(self):
        children, had_begun = self._children(), "cells on" in self.told()
        number = STOPS[self._rng.integers(len(STOPS))]
        self._process.send_signal(number)
        status = self._process.wait(PATIENCE_S)
        wait_for(lambda: not any(child.is_running() for child in children))
        self._check_left()
        if had_begun:
            assert "Traceback" not in self.told(), "a traceback"
            if status == -number and (self.out / "report.md").exists():
                return  # all was done: the signal had its usual effect
            assert status in (0, 128 + number), f"signal {number}: exit status {status}"
            assert status == 0 or "Continue with: iout reproduce" in self.told(), "no hint"

    def _kill_worker(self):
        if self._cluster is not None:
            self._cluster.workers.pop(0).kill()
            self._cluster.workers.append(self._cluster.add_worker())
            return
        wait_for(lambda: self._process.poll() is not None or self._workers())
        workers = self._workers()
        if workers:
            workers[self._rng.integers(len(workers))].kill()
        # A second one could take the cell that runs alone, because of the first: it would fail.
        assert self._process.wait(PATIENCE_S) == 0, "the study did not survive its worker"

    def _kill_scheduler(self):
        had_begun = "cells on" in self.told()
        self._cluster.scheduler.kill()
        status = self._process.wait(PATIENCE_S)
        assert status in ((0, 2) if had_begun else (0, 1, 2)), f"exit status {status}"
        assert "Traceback" not in self.told(), "a traceback"
        assert status == 0 or self.told().count("iout: ") == 1, "not one line"
        self._cluster.__exit__()
        self._cluster = Cluster(self._cluster_folder)

    def _children(self):
        try:
            return psutil.Process(self._process.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return []

    def _workers(self):
        return [child for child in self._children() if is_worker(child)]

    def _check_left(self):
        """Workers clear away what is theirs, when they see that the main process has gone."""
        wait_for(lambda: not list(self._temporary.glob("iout-*")))


def is_worker(process):
    """Whether a process is one in which cells run."""
    try:
        return any("spawn_main" in word for word in process.cmdline())
    except psutil.NoSuchProcess:
        return False


CAMPAIGN = Campaign("killed studies", cases=50, short=1, run=run)
