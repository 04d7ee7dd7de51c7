"""Processes of one machine that exchange what they have through memory that they share.

What `torch.distributed` exchanges between processes on CPUs goes through sockets and threads that
have to be woken: 1 to 3 ms on a virtual machine of two cores, where a minibatch takes 10 ms. Here
each writes its part where the others read it, and looks again and again until theirs are there.
On Linux alone.
"""

from __future__ import annotations

import errno
import fcntl
import mmap
import os
import platform
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, distributed

from trainers.accel.group import TIMEOUT, LostProcessError, ProcessGroup

#: Files that are memory alone.
MEMORY = Path("/dev/shm")
#: Bytes that a process can hand over at once; more goes in pieces.
CAPACITY = 1 << 20
#: Bytes between two counts: no two are in one line of a cache.
_LINE = 64
#: How often to look for the others before sleeping in between: some ten milliseconds, more than
#: what the shares of a minibatch differ by.
_LOOKS = 20_000
_NAP_S = 1e-3
#: Processors whose writes others see in the order in which they were written.
_ORDERED = ("x86_64", "AMD64", "i686")


class SharedMemoryGroup(ProcessGroup):
    """Processes of one machine, on CPUs.

    Each has two buffers, used in turn: before it writes over what it has handed over, all have
    handed over what came next, and so have read it. Each holds a lock for as long as it lives.

    Args:
        rank: which one this is.
        size: how many there are.
        file: `needed_bytes(size)` of zeros, opened by each for itself.
    """

    def __init__(self, rank: int, size: int, file: BinaryIO) -> None:
        self.rank, self.size = rank, size
        self._file = file
        memory = mmap.mmap(file.fileno(), needed_bytes(size))
        start = size * _LINE
        #: How many exchanges each process has handed over its part of.
        self._counts = np.frombuffer(memory, np.int64, start // 8).reshape(size, -1)[:, 0]
        self._buffers = np.frombuffer(memory, np.uint8, offset=start).reshape(2, size, CAPACITY)
        self._count = 0
        fcntl.lockf(file, fcntl.LOCK_EX, 1, rank)

    @classmethod
    def of_one_machine(cls) -> SharedMemoryGroup | None:
        """The processes of `torch.distributed`; None, in all, where they cannot share memory."""
        rank, size = distributed.get_rank(), distributed.get_world_size()
        own = _new_file(size) if rank == 0 else None
        names, group = [own], None
        try:
            distributed.broadcast_object_list(names)
            (name,) = names
            if name is not None:
                with suppress(OSError):  # that of another machine
                    group = cls(rank, size, Path(name).open("r+b"))  # noqa: SIM115
            failures = torch.tensor(float(group is None))
            distributed.all_reduce(failures)
        except BaseException:
            if group is not None:
                group._file.close()
            raise
        finally:
            if own is not None:
                Path(own).unlink()
        return None if failures > 0 else group

    def sum(self, tensor: Tensor) -> Tensor:
        total = np.add.reduce(self._parts(tensor), axis=0)
        return tensor.copy_(torch.from_numpy(total).reshape(tensor.shape))

    def any(self, flag: bool) -> bool:  # noqa: FBT001
        return bool(self._parts(torch.tensor(flag)).any())

    def largest(self, number: int) -> int:
        return int(self._parts(torch.tensor(number)).max())

    def join(self, tensor: Tensor) -> Tensor:
        parts = torch.from_numpy(self._parts(tensor).copy())
        return parts.reshape(self.size * tensor.shape[0], *tensor.shape[1:])

    def _parts(self, tensor: Tensor) -> npt.NDArray[np.generic]:
        """(processes, elements): every process's tensor, until the exchange after the next."""
        values = tensor.detach().contiguous().numpy().reshape(-1)
        own = values.view(np.uint8)
        if own.size <= CAPACITY:
            return self._exchange(own).view(values.dtype)
        pieces = [
            self._exchange(own[at : at + CAPACITY]).copy() for at in range(0, own.size, CAPACITY)
        ]
        return np.concatenate(pieces, axis=1).view(values.dtype)

    def _exchange(self, own: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
        self._count += 1
        buffers = self._buffers[self._count % 2, :, : own.size]
        buffers[self.rank] = own
        self._counts[self.rank] = self._count
        for rank in range(self.size):
            self._await(rank)
        return buffers

    def _await(self, rank: int) -> None:
        """Wait until a process has handed over its part.

        Raises:
            LostProcessError: it is gone, or takes longer than any should.
        """
        count, counted = self._count, self._counts.item
        for _ in range(_LOOKS):
            if counted(rank) >= count:
                return
            os.sched_yield()
        until = time.monotonic() + TIMEOUT.total_seconds()
        while counted(rank) < count:
            # Gone first: what it has handed over before may be there all the same.
            if (self._is_gone(rank) or time.monotonic() > until) and counted(rank) < count:
                raise LostProcessError("another process of the training was lost")
            time.sleep(_NAP_S)

    def _is_gone(self, rank: int) -> bool:
        """Whether a process has ended, however: the system has taken its lock away."""
        try:
            fcntl.lockf(self._file, fcntl.LOCK_SH | fcntl.LOCK_NB, 1, rank)
        except OSError as error:
            if error.errno in (errno.EACCES, errno.EAGAIN):
                return False
            raise
        fcntl.lockf(self._file, fcntl.LOCK_UN, 1, rank)
        return True


def needed_bytes(size: int) -> int:
    """What so many processes share."""
    return size * (_LINE + 2 * CAPACITY)


def _new_file(size: int) -> str | None:
    """Memory for so many processes; None where there is none, or none to rely on."""
    if platform.machine() not in _ORDERED:
        return None
    name = None
    try:
        handle, name = tempfile.mkstemp(prefix="iout-", dir=MEMORY)
        with os.fdopen(handle, "wb") as file:
            os.posix_fallocate(file.fileno(), 0, needed_bytes(size))
    except OSError:  # no such folder, or it is full
        if name is not None:
            Path(name).unlink()
        return None
    return name
