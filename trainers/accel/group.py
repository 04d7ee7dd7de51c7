"""The processes that train one policy together; one alone is the smallest group."""

from __future__ import annotations

import datetime as dt

from torch import Tensor

#: How long a process waits for the others: longer than the first one takes to save.
TIMEOUT = dt.timedelta(minutes=5)


class LostProcessError(Exception):
    """Another process of the group is gone."""


class ProcessGroup:
    """Processes that each run a share of the environments: here, the only one.

    Attributes:
        rank: which one this is, 0 the first.
        size: how many there are.
    """

    rank = 0
    size = 1

    def share(self, count: int) -> slice:
        """Which of `count` things, a multiple of `size`, are this process's."""
        part = count // self.size
        return slice(self.rank * part, (self.rank + 1) * part)

    def sum(self, tensor: Tensor) -> Tensor:
        """The sum of every process's tensor, the same in all; may be written into it."""
        return tensor

    def any(self, flag: bool) -> bool:  # noqa: FBT001
        """Whether any process's flag is set, the same in all."""
        return flag

    def largest(self, number: int) -> int:
        """The largest of every process's numbers, the same in all."""
        return number

    def join(self, tensor: Tensor) -> Tensor:
        """The tensors of all processes, one after the other along the first axis."""
        return tensor
