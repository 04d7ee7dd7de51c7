"""Processes that train one policy together, as `torchrun` starts them."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from torch import Tensor, distributed

from iout_marl.errors import InputError
from trainers.accel.group import TIMEOUT, LostProcessError, ProcessGroup


class DistributedGroup(ProcessGroup):
    """Processes of any machines, which exchange what they have over `torch.distributed`.

    Args:
        device: where their tensors are.
    """

    def __init__(self, device: torch.device) -> None:
        self.rank = distributed.get_rank()
        self.size = distributed.get_world_size()
        self._device = device

    def sum(self, tensor: Tensor) -> Tensor:
        with _translate_connection_errors():
            distributed.all_reduce(tensor)
        return tensor

    def any(self, flag: bool) -> bool:  # noqa: FBT001
        return bool(self.sum(torch.tensor(float(flag), device=self._device)) > 0)

    def largest(self, number: int) -> int:
        tensor = torch.tensor(number, device=self._device)
        with _translate_connection_errors():
            distributed.all_reduce(tensor, distributed.ReduceOp.MAX)
        return int(tensor)

    def join(self, tensor: Tensor) -> Tensor:
        here = tensor.to(self._device).contiguous()
        parts = [torch.empty_like(here) for _ in range(self.size)]
        with _translate_connection_errors():
            distributed.all_gather(parts, here)
        return torch.cat(parts)


#: What errors of a broken connection say, whatever the library below.
_BROKEN = ("onnect", "imed out", "imeout", "reset by peer", "closed by peer", "Socket")


@contextmanager
def _translate_connection_errors() -> Iterator[None]:
    try:
        yield
    except RuntimeError as error:
        if isinstance(error, distributed.DistError) or any(sign in str(error) for sign in _BROKEN):
            raise LostProcessError("another process of the training was lost") from None
        raise


@contextmanager
def started_group(device: torch.device) -> Iterator[tuple[ProcessGroup, torch.device]]:
    """The group that `torchrun` has started this process in, and the device that is its own.

    Without `torchrun` a process is alone.

    Args:
        device: where to train; of several GPUs each process takes one.

    Raises:
        InputError: there are more processes than GPUs on this machine, they do not find
            one another, one is lost before all have, or what `torchrun` says in the environment
            is no number.
    """
    # Without a size, it is only what a `torchrun` of before has left in the environment.
    is_launched = distributed.is_torchelastic_launched() and "WORLD_SIZE" in os.environ
    if not is_launched or _number("WORLD_SIZE") == 1:
        yield ProcessGroup(), device
        return
    on_gpu = device.type == "cuda"
    if on_gpu:
        local_rank = _number("LOCAL_RANK")
        if local_rank >= torch.cuda.device_count():
            raise InputError(
                f"--nproc-per-node: more processes than the {torch.cuda.device_count()} GPUs of "
                "this machine; start as many, or train on --device cpu"
            )
        device = torch.device("cuda", local_rank)
        torch.cuda.set_device(device)
    try:
        distributed.init_process_group("nccl" if on_gpu else "gloo", timeout=TIMEOUT)
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise InputError(f"torchrun: the processes did not find one another: {reason}") from None
    try:
        try:
            with _translate_connection_errors():
                group = _group_by_shared_memory(device) or DistributedGroup(device)
        except LostProcessError as error:
            raise InputError(f"torchrun: {error} before it began") from None
        yield group, device
    finally:
        distributed.destroy_process_group()


def _group_by_shared_memory(device: torch.device) -> ProcessGroup | None:
    if device.type != "cpu" or sys.platform != "linux":
        return None
    from trainers.accel.shared_memory import SharedMemoryGroup

    return SharedMemoryGroup.of_one_machine()


def _number(name: str) -> int:
    """A number that `torchrun` puts into the environment."""
    text = os.environ.get(name, "")
    if not (text.isascii() and text.isdigit()):
        raise InputError(
            f"torchrun: {name} must be a number in the environment, not {text!r}; to train "
            "alone, unset TORCHELASTIC_RUN_ID"
        )
    return int(text)
