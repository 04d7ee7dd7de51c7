"""Cells on a Dask cluster (extra `cluster`)."""

from __future__ import annotations

import asyncio
import functools
import logging
import re
import tempfile
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

from iout_marl import machine
from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.study.cells import Cell
from iout_marl.study.fields import show
from iout_marl.study.pools import Outcomes
from iout_marl.study.worker import Output, run_cell
from iout_marl.words import counted

#: Seconds in which a scheduler must answer.
CONNECT_S = 10
#: Seconds that taking leave of it may take.
CLOSE_S = 3
#: Seconds in which a client notices that its scheduler has gone.
NOTICE_S = 10.0


class LostClusterError(InputError):
    """The scheduler has gone, and all cells with it that had not ended."""


class DaskCluster:
    """The workers of a Dask cluster.

    Dask itself runs a cell once more where its worker is lost.

    Args:
        address: of the scheduler, `tcp://HOST:PORT`.

    Raises:
        InputError: Dask is not installed, or no scheduler answers there.
    """

    def __init__(self, address: str) -> None:
        require("--scheduler", "cluster")
        from distributed import Client
        from distributed.versions import VersionMismatchWarning

        self._name = f"--scheduler {address}"
        if not re.fullmatch(r"(\w+://)?[^\s/]+:\d+", address):
            raise InputError(f"{self._name}: must be an address such as tcp://127.0.0.1:8786")
        for name in ("distributed", "distributed.client", "tornado.application", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters is told in a line
        kind = self._ask(address)
        if kind != "Scheduler":
            raise InputError(f"{self._name}: is the address of a {kind}, not of a scheduler")
        with warnings.catch_warnings(record=True) as found:
            warnings.simplefilter("always", VersionMismatchWarning)
            try:
                self._client: Any = Client(address, timeout=CONNECT_S, set_as_default=False)
            except (OSError, ValueError, TypeError) as error:
                raise self._no_scheduler(error) from None
        self._differing = _packages(str(w.message) for w in found)

    def _ask(self, address: str) -> str:
        """What is there: the client itself waits without end for whatever only listens."""

        async def identify() -> Any:
            from distributed.comm.core import connect
            from distributed.security import Security

            how = Security().get_connection_args("client")
            line = await connect(address, timeout=CONNECT_S, **how)
            try:
                await line.write({"op": "identity", "reply": True})
                return await line.read()
            finally:
                line.abort()

        async def identify_in_time() -> Any:
            return await asyncio.wait_for(identify(), CONNECT_S)

        try:
            # In a thread of its own: that of a notebook has an event loop already.
            with ThreadPoolExecutor(1) as thread:
                return str(thread.submit(lambda: asyncio.run(identify_in_time())).result()["type"])
        except TimeoutError:
            raise self._no_scheduler(f"nothing that it understands in {CONNECT_S} s") from None
        # Whatever comes of reading a stranger's bytes as a message.
        except Exception as error:
            raise self._no_scheduler(error) from None

    def _no_scheduler(self, why: object) -> InputError:
        reason = (str(why).strip() or type(why).__name__).splitlines()[0]
        return InputError(f"{self._name}: no scheduler answers: {reason}")

    def describe(self) -> str:
        """See `Pool`."""
        workers = len(self._client.scheduler_info(n_workers=-1)["workers"])
        text = f"{counted(workers, 'worker')} of the cluster"
        if not workers:
            text += f": waiting for the first (dask worker {self._client.scheduler.address})"
        if self._differing:
            text += f" (versions differ between its machines: {', '.join(self._differing)})"
        return text

    def run(self, cells: Sequence[Cell], carbon_g_per_kwh: float) -> Outcomes:
        """See `Pool`.

        Raises:
            LostClusterError: the scheduler has gone.
        """
        from distributed import as_completed

        submit = functools.partial(self._client.submit, _run_cell, pure=False)
        try:
            futures = {
                submit(cell, carbon_g_per_kwh, priority=-i): cell for i, cell in enumerate(cells)
            }
        # Dask has changed what it raises here from version to version.
        except Exception:
            if self._client.status == "running":
                raise
            raise self._lost() from None
        try:
            for future in as_completed(list(futures), loop=self._client.loop):
                yield futures.pop(future), self._outcome(future)
                future.release()
        finally:
            with suppress(Exception):  # it may have gone
                self._client.cancel(list(futures))
                self._client.close(CLOSE_S)

    def _outcome(self, future: Any) -> Output | Exception:
        from distributed import CancelledError
        from distributed.comm.core import CommClosedError

        if future.status in ("finished", "error"):
            try:
                error = future.exception()
                return _same_software(future.result()) if error is None else error
            except CancelledError:
                pass
            except CommClosedError as error:
                # The client takes a moment to see that it was the scheduler's end, not a worker's.
                deadline = time.monotonic() + NOTICE_S
                while self._client.status == "running":
                    if time.monotonic() > deadline:
                        return error
                    time.sleep(0.05)
            # What a worker sends may not be readable here.
            except Exception as error:
                if self._client.status == "running":
                    return error
        raise self._lost()

    def _lost(self) -> LostClusterError:
        return LostClusterError(f"{self._name}: the scheduler has gone")


def _run_cell(cell: Cell, carbon_g_per_kwh: float) -> Output:
    """Run a cell in the folder of the worker, which Dask clears away even after a kill."""
    from distributed import get_worker

    tempfile.tempdir = get_worker().local_directory
    return run_cell(cell, carbon_g_per_kwh)


def _same_software(output: Output) -> Output | InputError:
    """What a worker has computed, unless its software is of another version."""
    own, its = machine.versions().get("iout-marl"), output.record.machine.get("iout-marl")
    if its == own:
        return output
    return InputError(f"a worker has iout-marl {show(str(its))}, not {own}: install the same there")


def _packages(messages: Any) -> list[str]:
    """The packages in Dask's tables of versions that differ."""
    rows = (line.split("|") for message in messages for line in message.splitlines())
    names = (row[1].strip() for row in rows if len(row) > 3)
    return sorted({name for name in names if name and name != "Package"})
