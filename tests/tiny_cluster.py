"""A Dask cluster on loopback, in processes of its own."""

import json
import os
import subprocess
import sys

import forked
from tiny_study import wait_for


class Cluster:
    """A scheduler and workers, started in a folder and ended on leaving.

    Args:
        folder: for the log, and for what workers put down.
        workers: how many there are at first.
        forks: whether its processes need not import anything.
    """

    def __init__(self, folder, workers=2, *, forks=False):
        self.folder = folder
        self.forks = forks
        self.started = []
        self.log = (folder / "cluster.log").open("w")
        file = folder / "scheduler.json"
        file.unlink(missing_ok=True)
        loopback = ("--host", "127.0.0.1", "--port", "0", "--no-dashboard")
        self.scheduler = self._start("scheduler", *loopback, "--scheduler-file", str(file))
        self.address = json.loads(wait_for(lambda: file.exists() and file.read_text()))["address"]
        self.workers = [self.add_worker() for _ in range(workers)]

    def add_worker(self):
        """One more worker, in a process of its own."""
        alone = ("--no-nanny", "--nthreads", "1", "--host", "127.0.0.1", "--no-dashboard")
        return self._start("worker", self.address, *alone)

    def _start(self, kind, *words):
        program = f"distributed.cli.dask_{kind}"
        environment = {**os.environ, "TMPDIR": str(self.folder)}
        if self.forks:
            streams = (forked.PIPE, self.log.fileno(), self.log.fileno())
            options = {"streams": streams, "env": environment, "folder": self.folder}
            self.started.append(forked.Iout(words, program=program, **options))
        else:
            output = {"stdout": self.log, "stderr": self.log}
            command = [sys.executable, "-m", program, *words]
            self.started.append(
                subprocess.Popen(command, cwd=self.folder, env=environment, **output)
            )
        return self.started[-1]

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for process in self.started:
            process.kill()
            process.wait()
            if self.forks:
                process.close()
        self.log.close()
