"""Where cells run: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import re
import shutil
import signal
import tempfile
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any, Protocol, TypeAlias

from iout_marl.errors import InputError
from iout_marl.study.cells import Cell
from iout_marl.study.worker import Output, run_cell

#: A cell, and what came of it.
Outcome: TypeAlias = tuple[Cell, Output | Exception]
#: Seconds in which a scheduler must answer.
CONNECT_S = 10


class Pool(Protocol):
    """Runs cells."""

    def describe(self) -> str:
        """Where they run, in a few words."""
        ...

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Iterator[Outcome]:
        """Run cells, the first ones first, and yield each as it ends.

        A cell that fails yields its exception; the others go on.
        """
        ...


class WorkerDiedError(Exception):
    """The process of a cell ended: out of memory, or killed."""

    def __init__(self) -> None:
        super().__init__("its process died, twice (out of memory?)")


class LocalProcesses:
    """Processes of this machine, one thread each.

    Args:
        jobs: how many.
    """

    #: What each process does; it goes there by its name.
    task = staticmethod(run_cell)

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def describe(self) -> str:
        """See `Pool`."""
        return f"{self.jobs} process" + ("es" if self.jobs > 1 else "")

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Iterator[Outcome]:
        """See `Pool`. Cells that ran as a process died are run once more, one by one."""
        waiting = list(cells)
        with tempfile.TemporaryDirectory(prefix="iout-") as folder:
            while waiting:
                suspects, waiting = yield from self._round(
                    waiting, self.jobs, carbon_g_per_kwh, folder
                )
                # Whose fault it was shows as they run one by one.
                while suspects:
                    guilty, suspects = yield from self._round(suspects, 1, carbon_g_per_kwh, folder)
                    for cell in guilty:
                        yield cell, WorkerDiedError()

    def _round(
        self, cells: Sequence[Cell], jobs: int, carbon_g_per_kwh: float, folder: str
    ) -> Generator[Outcome, None, tuple[list[Cell], list[Cell]]]:
        """Run cells until all are done or a process dies; the cells it took along, and the rest."""
        waiting = list(cells)
        running: dict[Future[Output], Cell] = {}
        suspects: list[Cell] = []
        others = set(multiprocessing.active_children())
        executor = ProcessPoolExecutor(
            min(jobs, len(waiting)),
            # A forked copy of torch's thread pools would hang.
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_start_worker,
            initargs=(folder,),
        )
        try:
            while (waiting or running) and not suspects:
                while waiting and len(running) < jobs:
                    running[executor.submit(self.task, waiting[0], carbon_g_per_kwh)] = waiting[0]
                    del waiting[0]
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    cell = running.pop(future)
                    try:
                        output = future.result()
                    except BrokenProcessPool:
                        suspects.append(cell)
                    except Exception as error:  # whatever it is, the other cells go on
                        yield cell, error
                    else:
                        yield cell, output
            return [*suspects, *running.values()], waiting
        except BrokenProcessPool:  # by submit, where a process died between two cells
            return [*suspects, *running.values()], waiting
        finally:
            if running:
                # Cells have nothing to save.
                for process in set(multiprocessing.active_children()) - others:
                    process.kill()
            executor.shutdown(cancel_futures=True)


def _start_worker(folder: str) -> None:
    """Leave Ctrl-C to the main process, and end with it, however it ends.

    Args:
        folder: where temporary files go. It belongs to the main process, for a worker that is
            killed clears nothing away; one that outlives the main process does it in its stead.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # which the main process may ignore
    tempfile.tempdir = folder
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        for _ in range(10):  # a training may write into it meanwhile
            shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


class DaskCluster:
    """The workers of a Dask cluster (extra `cluster`).

    Dask itself runs a cell once more where its worker is lost.

    Args:
        address: of the scheduler, `tcp://HOST:PORT`.

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError:
            raise InputError(
                "--scheduler: Dask is not installed; pip install 'iout-marl[cluster]'"
            ) from None
        if not re.fullmatch(r"(\w+://)?[^\s/]+:\d+", address):
            raise InputError(
                f"--scheduler {address}: must be an address such as tcp://127.0.0.1:8786"
            )
        try:
            self._client: Any = Client(address, timeout=CONNECT_S, set_as_default=False)
        except (OSError, ValueError, TypeError) as error:
            reason = (str(error).strip() or type(error).__name__).splitlines()[0]
            raise InputError(f"--scheduler {address}: no scheduler answers: {reason}") from None

    def describe(self) -> str:
        """See `Pool`."""
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        joined = f"{workers} worker" + ("" if workers == 1 else "s")
        return f"{joined} of the cluster" + ("" if workers else ": waiting for the first")

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Iterator[Outcome]:
        """See `Pool`."""
        from distributed import as_completed

        futures = {
            self._client.submit(run_cell, cell, carbon_g_per_kwh, pure=False, priority=-i): cell
            for i, cell in enumerate(cells)
        }
        try:
            for future in as_completed(list(futures), loop=self._client.loop):
                cell = futures.pop(future)
                error = future.exception()
                yield cell, (future.result() if error is None else error)
                future.release()
        finally:
            self._client.cancel(list(futures))
            self._client.close()
