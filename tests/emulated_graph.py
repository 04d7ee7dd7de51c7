"""What a CUDA graph does, on the CPU: operations are kept once and repeated without Python.

As on the device, recording has no effect; a replay works on the memory that was there when it
was recorded, wherever Python's names may lead now; memory from outside is not kept alive by the
graph; and what the host would wait for, or would have to bring to the device, is refused.
"""

from dataclasses import dataclass
from operator import attrgetter

import torch
from torch.multiprocessing.reductions import StorageWeakRef
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten

#: Operations that hold numbers of Python or NumPy, or that the host asks for one; they have no tag.
OF_THE_HOST = {"aten::lift_fresh", "aten::is_nonzero"}
#: Those whose result has a size that depends on numbers only where an index is a mask.
INDEXED = {"aten::index", "aten::index_put", "aten::index_put_", "aten::_index_put_impl_"}
WAITING = {torch.Tag.data_dependent_output, torch.Tag.dynamic_output_shape}


class RecordingError(RuntimeError):
    """An operation that a CUDA graph cannot hold."""


class MemoryGoneError(Exception):
    """A graph reads or writes memory that was given back."""


@dataclass
class Outside:
    """A tensor in memory that the graph was not recorded with."""

    storage: StorageWeakRef
    dtype: torch.dtype
    place: tuple
    now: torch.Tensor | None = None  # while the graph is replayed

    def found(self):
        storage = torch.UntypedStorage._new_with_weak_ptr(self.storage.cdata)
        if storage is None:
            raise MemoryGoneError
        return torch.empty(0, dtype=self.dtype).set_(storage, *self.place)


def waits(func, args):
    """Whether the host would wait for an operation."""
    if func._schema.name in INDEXED:
        return any(i is not None and i.dtype == torch.bool for i in args[1])
    return not WAITING.isdisjoint(func.tags)


def mapped(kind, function, value):
    """What an operation is given, with `function` of all in it that is of a kind.

    PyTorch's own `tree_map_only` is for nests of any kind, and takes ten times as long.
    """
    if isinstance(value, kind):
        return function(value)
    if isinstance(value, list | tuple):
        return type(value)([mapped(kind, function, each) for each in value])
    if isinstance(value, dict):
        return {name: mapped(kind, function, each) for name, each in value.items()}
    return value


def holds(kind, value):
    """Whether there is one of a kind in what an operation is given."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return any(holds(kind, each) for each in value)
    return isinstance(value, kind)


def key(tensor):
    return tensor.untyped_storage()._cdata


class EmulatedGraph(TorchDispatchMode):
    """Stands in for `trainers.accel.graphs.CudaGraph`."""

    def __init__(self, device):
        super().__init__()
        # Function, arguments, whether some are from outside, tensors in new memory by their place
        # in the results.
        self.calls = []
        self.made = set()  # memory that belongs to the graph, which keeps all of it
        self.outside = {}  # by memory, type and place there
        self.before = {}  # what memory from outside held
        self.replays = 0

    def warm_up(self, function):
        return function()

    def capture(self, function):
        with self:
            result = function()
        for storage, content in self.before.values():
            if not storage.expired():
                torch.UntypedStorage._new_with_weak_ptr(storage.cdata).copy_(content)
        self.before.clear()
        return result

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        kwargs = kwargs or {}
        is_noise = torch.Tag.nondeterministic_seeded in func.tags
        if waits(func, args) or is_noise or func._schema.name in OF_THE_HOST:
            raise RecordingError(func._schema.name)
        kept = mapped(torch.Tensor, self._kept, (args, kwargs))
        results = func(*args, **kwargs)
        given = {key(t) for t in tree_flatten((args, kwargs))[0] if isinstance(t, torch.Tensor)}
        new = {
            place: tensor.detach()
            for place, tensor in enumerate(tree_flatten(results)[0])
            if isinstance(tensor, torch.Tensor) and key(tensor) not in given
        }
        self.made |= {key(tensor) for tensor in new.values()}
        # What only looks at memory in another way does nothing on the device.
        if new or func._schema.is_mutable:
            self.calls.append((func, kept, holds(Outside, kept), new))
        return results

    def _kept(self, tensor):
        if key(tensor) in self.made:
            return tensor.detach()
        storage = tensor.untyped_storage()
        seen = self.before.get(key(tensor))
        if seen is None or seen[0].expired():
            seen = self.before[key(tensor)] = StorageWeakRef(storage), storage.clone()
        place = (tensor.storage_offset(), tensor.shape, tensor.stride())
        known = (seen[0], tensor.dtype, place)
        return self.outside.setdefault(known, Outside(*known))

    @torch.no_grad()
    def replay(self):
        self.replays += 1
        for each in self.outside.values():
            each.now = each.found()
        for func, kept, is_outside, new in self.calls:
            args, kwargs = mapped(Outside, attrgetter("now"), kept) if is_outside else kept
            results = func(*args, **kwargs)
            if isinstance(results, torch.Tensor):
                results = [results]
            for place, tensor in new.items():
                tensor.copy_(results[place])
        for each in self.outside.values():
            each.now = None
