"""Work that is captured once and replayed: CUDA graphs, where there is a CUDA device.

A replay hands the device all captured operations at once and runs no Python: numbers of Python
are those of the capture, and tensors are the memory that they were then. What changes from one
replay to the next lies in tensors that stay where they are and are written in place.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, Generic, Protocol, TypeVar

import torch
from torch import Tensor

from iout_marl.errors import InputError

Result = TypeVar("Result")


class Graph(Protocol):
    """Captures the operations of a function, once."""

    def warm_up(self, function: Callable[[], Result]) -> Result:
        """Run the function as it is, before it is captured."""
        ...

    def capture(self, function: Callable[[], Result]) -> Result:
        """Keep the operations of the function, without running them."""
        ...

    def replay(self) -> None:
        """Run the captured operations."""
        ...


class CudaGraph:
    """A CUDA graph, in memory of its own.

    Warm-up and capture share a stream, so that what libraries set up for a stream when
    they are first called is there before the capture, where it is not allowed.
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

    def capture(self, function: Callable[[], Result]) -> Result:
        with torch.cuda.graph(self._graph, stream=self._stream):
            return function()

    def replay(self) -> None:
        self._graph.replay()


#: What captures, by type of device; on others everything runs as it is.
GRAPHS: dict[str, Callable[[torch.device], Graph]] = {"cuda": CudaGraph}


def write_over(kept: Iterable[Tensor], new: Iterable[Tensor]) -> None:
    """Write each of the new tensors into the memory of the one that is kept."""
    for old, tensor in zip(kept, new, strict=True):
        if tensor is not old:
            old.copy_(tensor)


class CapturedFunction(Generic[Result]):
    """A function that runs as it is when first called, then is captured and replayed.

    The first call also brings what the function keeps to the form in which it stays. From
    the second on, what is returned are the same tensors, written anew.

    Tensors may differ from call to call in their numbers. So may floats and iterators of tensors,
    which the function gets as float64 tensors and as one tensor with one axis more. Whatever else
    it takes must be the same object: with another one it is captured anew.

    Args:
        function: what to capture. It never asks the device for a number.
        new_graph: makes what it is captured in.
        device: where the tensors are.

    Raises:
        InputError: when called, the graph cannot hold what the function does.
    """

    def __init__(
        self,
        function: Callable[..., Result],
        new_graph: Callable[[torch.device], Graph],
        device: torch.device,
    ) -> None:
        self._function = function
        self._new_graph = new_graph
        self._device = device
        self._arguments: list[Any] | None = None

    def __call__(self, *arguments: Any) -> Result:
        """Run the function."""
        given = [self._as_tensor(each) for each in arguments]
        if self._arguments is None or not _differ_in_numbers_alone(self._arguments, given):
            self._arguments = [
                torch.empty_like(each) if isinstance(each, Tensor) else each for each in given
            ]
            self._graph = self._new_graph(self._device)
            self._results: list[Result] = []
            self._is_warm = False
        self._write(given)
        if not self._is_warm:
            result = self._graph.warm_up(self._run)
            self._is_warm = True
            return result
        if not self._results:
            self._results.append(self._captured())
        self._graph.replay()
        return self._results[0]

    def _as_tensor(self, argument: Any) -> Any:
        if isinstance(argument, float):
            # Filled in by the device, which the host would wait for to be given a number.
            return torch.full((), argument, dtype=torch.float64, device=self._device)
        return torch.stack(list(argument)) if isinstance(argument, Iterator) else argument

    def _write(self, given: list[Any]) -> None:
        assert self._arguments is not None
        for kept, new in zip(self._arguments, given, strict=True):
            if isinstance(new, Tensor):
                kept.copy_(new)

    def _captured(self) -> Result:
        try:
            return self._graph.capture(self._run)
        except torch.OutOfMemoryError:
            raise
        except RuntimeError as error:
            # That a capture has failed is raised after, and in place of, what made it fail.
            reason = str(error.__context__ or error).strip().partition("\n")[0]
            raise InputError(
                f"the training could not be captured as CUDA graphs ({reason}); "
                "--no-graphs trains without"
            ) from error

    def _run(self) -> Result:
        assert self._arguments is not None
        return self._function(*self._arguments)


def _differ_in_numbers_alone(kept: list[Any], given: list[Any]) -> bool:
    return all(
        old.shape == new.shape if isinstance(new, Tensor) else old is new
        for old, new in zip(kept, given, strict=True)
    )
