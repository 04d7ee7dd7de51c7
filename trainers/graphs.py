"""Work that is recorded once and replayed: CUDA graphs, where there is a CUDA device.

A replay hands the device the operations that were recorded, in one go, and runs no Python:
numbers of Python are those of the recording, and tensors are the memory that they were then.
What changes from one replay to the next lies in tensors that stay where they are and are
written in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Generic, Protocol, TypeVar

import torch
from torch import Tensor

from iout_marl.errors import InputError

Result = TypeVar("Result")


class Graph(Protocol):
    """Records the operations of a function, once."""

    def warm_up(self, function: Callable[[], Result]) -> Result:
        """Run the function as it is, before it is recorded."""
        ...

    def record(self, function: Callable[[], Result]) -> Result:
        """Keep the operations of the function, without running them."""
        ...

    def replay(self) -> None:
        """Run the operations that were recorded."""
        ...


class CudaGraph:
    """A CUDA graph, in memory of its own.

    Warm-up and recording share a stream, so that what libraries set up for a stream when
    they are first called is there before the recording, where it is not allowed.
    """

    def __init__(self, device: torch.device) -> None:
        self._stream = torch.cuda.Stream(device)  # type: ignore[no-untyped-call]
        self._graph = torch.cuda.CUDAGraph()

    def warm_up(self, function: Callable[[], Result]) -> Result:
        now = torch.cuda.current_stream(self._stream.device)
        self._stream.wait_stream(now)
        with torch.cuda.stream(self._stream):
            result = function()
        now.wait_stream(self._stream)
        return result

    def record(self, function: Callable[[], Result]) -> Result:
        with torch.cuda.graph(self._graph, stream=self._stream):
            return function()

    def replay(self) -> None:
        self._graph.replay()


#: What records, by type of device; on others everything runs as it is.
GRAPHS: dict[str, Callable[[torch.device], Graph]] = {"cuda": CudaGraph}


def write_over(kept: Iterable[Tensor], new: Iterable[Tensor]) -> None:
    """Write each of the new tensors into the memory of the one that is kept."""
    for old, tensor in zip(kept, new, strict=True):
        if tensor is not old:
            old.copy_(tensor)


class Recorded(Generic[Result]):
    """A function of tensors that runs as it is when first called, then is recorded and replayed.

    The first call also brings what the function keeps to the form in which it stays. From
    the second on, what is returned are the same tensors, written anew.

    Args:
        function: what to record. It never asks the device for a number.
        graph: records it.

    Raises:
        InputError: when called, the graph cannot hold what the function does.
    """

    def __init__(self, function: Callable[..., Result], graph: Graph) -> None:
        self._function = function
        self._graph = graph
        self._inputs: tuple[Tensor, ...] | None = None
        self._is_warm = False
        self._results: list[Result] = []

    def __call__(self, *inputs: Tensor) -> Result:
        """The function of tensors that are the same in shape and type at each call."""
        if self._inputs is None:
            self._inputs = tuple(torch.empty_like(each) for each in inputs)
        write_over(self._inputs, inputs)
        if not self._is_warm:
            result = self._graph.warm_up(self._run)
            self._is_warm = True
            return result
        if not self._results:
            self._results.append(self._recorded())
        self._graph.replay()
        return self._results[0]

    def _recorded(self) -> Result:
        try:
            return self._graph.record(self._run)
        except torch.OutOfMemoryError:
            raise
        except RuntimeError as error:
            # That a recording has failed is told after, and in place of, what made it fail.
            reason = str(error.__context__ or error).strip().partition("\n")[0]
            raise InputError(
                f"the training could not be recorded as CUDA graphs ({reason}); "
                "--no-graphs trains without"
            ) from error

    def _run(self) -> Result:
        assert self._inputs is not None
        return self._function(*self._inputs)
