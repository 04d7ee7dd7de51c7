"""Tables of transmission loss in files: a number in dB for every combination of some axes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from iout_marl.core.grid import Floats
from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import Arrays, listed_on_axes, read_arrays
from iout_marl.scenario.places import shorten

FREQUENCY, LOSS = "frequency_khz", "loss_db"
#: Losses that are believed: beyond, a file holds gains, pressures, or sound that never arrives.
LEAST_DB, MOST_DB = -20.0, 300.0
#: Frequencies that differ by less are the same.
_ROUNDING = 1e-6


class LossTable(NamedTuple):
    """Transmission loss at one frequency.

    Attributes:
        file: where it was.
        axes: the values along each axis, the lowest first.
        loss_db: an axis for each of them.
    """

    file: DataFile
    axes: tuple[Floats, ...]
    loss_db: Floats


def table_at(
    files: Sequence[DataFile], names: tuple[str, ...], frequency_khz: float, *, counted: bool
) -> LossTable:
    """The table at a frequency, whichever file it is in.

    Args:
        files: the files.
        names: of the axes beside the frequency.
        frequency_khz: the frequency.
        counted: whether axes that an npz file leaves out count from 1.

    Raises:
        InputError: there is none, or two, or a file is none of such tables.
    """
    found, known = [], []
    for file in files:
        axes, loss_db = _read(file, (FREQUENCY, *names), counted)
        known += axes[0].tolist()
        places = np.flatnonzero(np.isclose(axes[0], frequency_khz, rtol=_ROUNDING, atol=0))
        found += [LossTable(file, axes[1:], loss_db[i]) for i in places]
    if not found:
        are = ", ".join(f"{khz:g}" for khz in sorted(set(known))[:10])
        raise InputError(f"no table at {frequency_khz:g} kHz: there are those at {are} kHz")
    if len(found) > 1:
        names_of_files = " and ".join(dict.fromkeys(table.file.name for table in found))
        raise InputError(f"{names_of_files}: two tables at {frequency_khz:g} kHz")
    return found[0]


@lru_cache(maxsize=16)
def _read(
    file: DataFile,
    names: tuple[str, ...],
    counted: bool,  # noqa: FBT001
) -> tuple[tuple[Floats, ...], Floats]:
    """Values along all axes, and the losses."""
    arrays = read_arrays(file)
    for name in arrays:
        if name not in (*names, LOSS):
            known = did_you_mean(shorten(name), (*names, LOSS))
            raise file.fault(f"unknown array or column {shorten(name)!r}{known}")
    is_list = file.name.lower().endswith(".csv")
    needed = (FREQUENCY, LOSS) if counted and not is_list else (*names, LOSS)
    if missing := [name for name in needed if name not in arrays]:
        raise file.fault(f"lacks {', '.join(missing)}")
    axes, loss_db = (_from_list if is_list else _from_arrays)(file, names, arrays)
    if not ((loss_db >= LEAST_DB) & (loss_db <= MOST_DB)).all():
        wrong = loss_db[(loss_db < LEAST_DB) | (loss_db > MOST_DB)][0]
        is_gain = " (losses are positive; are these gains?)" if loss_db.max() <= 0 else ""
        raise file.fault(
            f"loss_db: must lie between {LEAST_DB:g} and {MOST_DB:g} dB, not {wrong:g}{is_gain}"
        )
    return axes, loss_db


def _from_list(
    file: DataFile, names: tuple[str, ...], columns: Arrays
) -> tuple[tuple[Floats, ...], Floats]:
    """A list, one line for every combination, in any order."""
    axes, lines = listed_on_axes(file, names, columns)
    return axes, columns[LOSS][lines]


def _from_arrays(
    file: DataFile, names: tuple[str, ...], arrays: Arrays
) -> tuple[tuple[Floats, ...], Floats]:
    """Arrays of the axes, and one that has them all."""
    loss_db = arrays[LOSS]
    if loss_db.ndim != len(names):
        raise file.fault(
            f"loss_db: must have {len(names)} axes, {', '.join(names)}, not shape {loss_db.shape}"
        )
    counted = (np.arange(1.0, size + 1) for size in loss_db.shape)
    axes = tuple(
        np.atleast_1d(arrays.get(name, count)) for name, count in zip(names, counted, strict=True)
    )
    for name, values in zip(names, axes, strict=True):
        if values.ndim != 1 or not (np.diff(values) > 0).all():
            raise file.fault(f"{name}: must be a list of numbers, each above the one before")
    if loss_db.shape != tuple(map(len, axes)):
        raise file.fault(
            f"loss_db: must be of shape {tuple(map(len, axes))}, by its axes {', '.join(names)}, "
            f"not {loss_db.shape}"
        )
    return axes, loss_db
