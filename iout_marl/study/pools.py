"""Where cells run: in processes of this machine, or on a Dask cluster."""

from __future__ import annotations

import multiprocessing
import os
import secrets
import shutil
import signal
import tempfile
import threading
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import resource_tracker
from multiprocessing.context import BaseContext
from pathlib import Path
from typing import Protocol, TypeAlias

from iout_marl.study.cells import Cell
from iout_marl.study.worker import Output, run_cell

#: A cell, and what came of it.
Outcome: TypeAlias = tuple[Cell, Output | Exception]
Outcomes: TypeAlias = Generator[Outcome, None, None]
#: What a terminal sends to all processes that it has started. SIGHUP is not everywhere.
_OF_TERMINAL = [getattr(signal, name) for name in ("SIGINT", "SIGHUP") if hasattr(signal, name)]


class Pool(Protocol):
    """Runs cells."""

    def describe(self) -> str:
        """Where they run, in a few words."""
        ...

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Outcomes:
        """Run cells, the first ones first, and yield each as it ends.

        A cell that fails yields its exception; the others continue. Where the generator is
        closed, cells that have not ended are given up.
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
    #: How processes start. A forked copy of torch's thread pools would hang.
    context: BaseContext = multiprocessing.get_context("spawn")

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs

    def describe(self) -> str:
        """See `Pool`."""
        return f"{self.jobs} process" + ("es" if self.jobs > 1 else "")

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Outcomes:
        """See `Pool`. Cells that ran as a process died are run once more, one by one."""
        waiting = list(cells)
        # Made by the workers: before there is one, nobody would clear it away after a kill.
        folder = str(Path(tempfile.gettempdir()) / f"iout-{secrets.token_hex(8)}")
        try:
            while waiting:
                suspects, waiting = yield from self._round(
                    waiting, self.jobs, carbon_g_per_kwh, folder
                )
                # Whose fault it was shows as they run one by one.
                while suspects:
                    guilty, suspects = yield from self._round(suspects, 1, carbon_g_per_kwh, folder)
                    for cell in guilty:
                        yield cell, WorkerDiedError()
        finally:
            shutil.rmtree(folder, ignore_errors=True)

    def _round(
        self, cells: Sequence[Cell], jobs: int, carbon_g_per_kwh: float, folder: str
    ) -> Generator[Outcome, None, tuple[list[Cell], list[Cell]]]:
        """Run cells until all are done or a process dies; the cells it took along, and the rest."""
        waiting = list(cells)
        running: dict[Future[Output], Cell] = {}
        suspects: list[Cell] = []
        others = set(multiprocessing.active_children())
        with _terminal_held_back():
            executor = ProcessPoolExecutor(
                min(jobs, len(waiting)),
                mp_context=self.context,
                initializer=_start_worker,
                initargs=(folder,),
            )
        try:
            while (waiting or running) and not suspects:
                while waiting and len(running) < jobs:
                    with _terminal_held_back():
                        future = executor.submit(self.task, waiting[0], carbon_g_per_kwh)
                        running[future] = waiting.pop(0)
                done, _ = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    cell = running.pop(future)
                    try:
                        output = future.result()
                    except BrokenProcessPool:
                        suspects.append(cell)
                    except Exception as error:  # whatever it is, the other cells continue
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


@contextmanager
def _terminal_held_back() -> Iterator[None]:
    """Let Ctrl-C and a lost terminal wait; a process that is started meanwhile lets them wait, too.

    It could do nothing else with them than show a traceback, until it has come to ignore them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, _OF_TERMINAL)
    try:
        # The process in which Python counts semaphores; its start lets Ctrl-C through again.
        resource_tracker.ensure_running()
        signal.pthread_sigmask(signal.SIG_BLOCK, _OF_TERMINAL)
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _start_worker(folder: str) -> None:
    """Leave Ctrl-C and a lost terminal to the main process, and end with it, however it ends.

    Args:
        folder: where temporary files go. It belongs to the main process, for a worker that is
            killed clears nothing away; one that outlives the main process does it in its stead.
    """
    for number in _OF_TERMINAL:
        signal.signal(number, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _OF_TERMINAL)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # which the main process may ignore
    Path(folder).mkdir(mode=0o700, exist_ok=True)
    tempfile.tempdir = folder
    parent = multiprocessing.parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        for _ in range(10):  # a training may write into it meanwhile
            shutil.rmtree(folder, ignore_errors=True)
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()
