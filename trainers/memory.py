"""What libraries raise where there is too little memory, or a number too large, in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import torch

from iout_marl.errors import InputError, is_lack_of_memory

#: Parts of what libraries say of numbers that the arithmetic cannot hold.
_TOO_LARGE = ("without overflow", "too large to convert", "Overflow when unpacking")


@contextmanager
def enough_memory(where: str = "") -> Iterator[None]:
    """Refuse a training that does not fit into memory, or numbers that the arithmetic cannot hold.

    Args:
        where: what the message begins with.

    Raises:
        InputError: instead of what libraries raise; other errors go through.
    """
    try:
        yield
    except (MemoryError, torch.OutOfMemoryError, RuntimeError, ValueError, OverflowError) as error:
        if isinstance(error, InputError):
            raise
        text = str(error)
        if isinstance(error, torch.OutOfMemoryError) or is_lack_of_memory(error):
            raise InputError(
                f"{where}not enough memory: smaller training.hidden_units, fewer "
                "training.environments, training.rollout_slots or --replicas take less"
            ) from None
        if isinstance(error, OverflowError) or any(sign in text for sign in _TOO_LARGE):
            reason = text.strip().partition("\n")[0]
            raise InputError(
                f"{where}a setting of training is too large to compute with: {reason}"
            ) from None
        raise
