"""Contents of files of data as arrays: CSV and npz, read strictly, never unpickled."""

from __future__ import annotations

import csv
import io
import math
import zipfile
import zlib
from functools import lru_cache
from types import MappingProxyType
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.places import shorten, show_value

Floats: TypeAlias = npt.NDArray[np.float64]
Arrays: TypeAlias = MappingProxyType[str, Floats]

#: Numbers that all arrays of a file may have together, and how many arrays, or columns.
MAX_NUMBERS, MAX_ARRAYS = 10**7, 1000


def read_arrays(file: DataFile, *, allow_nan: bool = False) -> Arrays:
    """The arrays of a file: of `.npz` by their names, of `.csv` its columns.

    Args:
        file: the file.
        allow_nan: whether numbers may be missing.

    Returns:
        arrays of float64 that cannot be written to.

    Raises:
        InputError: it is of another format, damaged, empty or too large, or holds anything but
            finite numbers.
    """
    if file.name.lower().endswith(".npz"):
        return read_npz(file, allow_nan)
    if file.name.lower().endswith(".csv"):
        return read_csv(file, allow_nan)
    raise file.fault("must be a .npz or a .csv file, by its name")


@lru_cache(maxsize=16)
def read_csv(file: DataFile, allow_nan: bool = False) -> Arrays:  # noqa: FBT001, FBT002
    """The columns of a CSV file: a line of names, then numbers; lines with `#` say nothing.

    Raises:
        InputError: as by `read_arrays`.
    """
    try:
        text = file.contents.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise file.fault("is no CSV: not UTF-8 text") from None
    rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    names: list[str] = []
    numbers: list[float] = []
    try:
        for row in rows:
            if not row or row[0].lstrip().startswith("#"):
                continue
            if not names:
                names = _names(file, row)
                continue
            if len(row) != len(names):
                raise _at(file, rows.line_num, f"has {len(row)} values for {len(names)} columns")
            if len(numbers) + len(row) > MAX_NUMBERS:
                raise file.fault(f"holds more than {MAX_NUMBERS:,} numbers")
            numbers += [
                _number(file, rows.line_num, name, cell, allow_nan=allow_nan)
                for name, cell in zip(names, row, strict=True)
            ]
    except csv.Error as error:
        raise _at(file, rows.line_num, f"is no CSV: {error}") from None
    if not numbers:
        raise file.fault("is empty: a line of names and at least one of numbers are needed")
    table = np.array(numbers).reshape(-1, len(names))
    return _frozen(dict(zip(names, table.T.copy(), strict=True)))


def read_curve(
    file: DataFile, names: tuple[str, str], low: float, high: float
) -> tuple[Floats, Floats]:
    """Two arrays of a file that make a curve, the first of which rises.

    Args:
        file: the file.
        names: of both.
        low, high: what the second must lie between.

    Raises:
        InputError: as by `read_arrays`, or they make none.
    """
    arrays = read_arrays(file)
    if missing := [name for name in names if name not in arrays]:
        raise file.fault(f"has no {missing[0]}: it has {', '.join(arrays)}")
    along, values = (arrays[name] for name in names)
    if along.ndim != 1 or along.shape != values.shape or len(along) < 2:
        raise file.fault(f"{names[0]} and {names[1]} must be as many, two or more")
    if not (np.diff(along) > 0).all():
        raise file.fault(f"{names[0]}: must rise from line to line")
    if values.min() < low or values.max() > high:
        wrong = values[(values < low) | (values > high)][0]
        raise file.fault(f"{names[1]}: must lie between {low:g} and {high:g}, not {wrong:g}")
    return along, values


def listed_on_axes(
    file: DataFile, names: tuple[str, ...], columns: Arrays
) -> tuple[tuple[Floats, ...], npt.NDArray[np.int64]]:
    """The axes of a list that has one line for every combination, in any order.

    Args:
        file: where it is.
        names: of the columns that are axes.
        columns: all of them.

    Returns:
        the values along each axis, the lowest first; and the line of each combination, with an axis
        for each of them.

    Raises:
        InputError: a combination is missing, or comes twice.
    """
    found = [np.unique(columns[name], return_inverse=True) for name in names]
    axes = tuple(values for values, _ in found)
    shape = tuple(map(len, axes))
    places = np.ravel_multi_index([place for _, place in found], shape)
    lines, combinations = len(places), math.prod(shape)
    different = len(np.unique(places))
    if lines != combinations or different != lines:
        raise file.fault(
            f"must have one line for each of {' × '.join(map(str, shape))} = {combinations:,} "
            f"combinations of {', '.join(names)}; it has {lines:,}, {different:,} of them different"
        )
    return axes, places.argsort().reshape(shape)


def _names(file: DataFile, row: list[str]) -> list[str]:
    names = [cell.strip() for cell in row]
    if len(names) > MAX_ARRAYS:
        raise file.fault(f"has more than {MAX_ARRAYS:,} columns")
    for i, name in enumerate(names):
        if not name or _is_number(name):
            raise file.fault(f"the first line must name the columns, not {show_value(name)}")
        if name in names[:i]:
            raise file.fault(f"two columns are called {show_value(name)}")
    return names


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _number(file: DataFile, line: int, name: str, text: str, *, allow_nan: bool) -> float:
    if not _is_number(text) or "_" in text:
        raise _at(file, line, f"{shorten(name)}: must be a number, not {show_value(text)}")
    value = float(text)
    if not (math.isfinite(value) or (allow_nan and math.isnan(value))):
        raise _at(file, line, f"{shorten(name)}: must be a finite number, not {text.strip()}")
    return value


def _at(file: DataFile, line: int, message: str) -> InputError:
    return file.fault(f"line {line}: {message}")


@lru_cache(maxsize=16)
def read_npz(file: DataFile, allow_nan: bool = False) -> Arrays:  # noqa: FBT001, FBT002
    """The arrays of a file that `numpy.savez` has written, none of them of Python objects.

    Raises:
        InputError: as by `read_arrays`.
    """
    arrays: dict[str, Floats] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(file.contents)) as archive:
            members = archive.infolist()
            if not members:
                raise file.fault("is empty: it holds no array")
            # Before anything is unpacked: a small archive may hold a great deal.
            size = sum(member.file_size for member in members)
            if len(members) > MAX_ARRAYS or size > 8 * MAX_NUMBERS + 10_000 * len(members):
                raise file.fault(
                    f"is too large: at most {MAX_ARRAYS:,} arrays of {MAX_NUMBERS:,} numbers in all"
                )
            for member in members:
                name = member.filename.removesuffix(".npy")
                with archive.open(member) as data:
                    arrays[name] = _array(file, name, data, member.file_size)
    except InputError:
        raise
    except (zipfile.BadZipFile, zlib.error, EOFError, NotImplementedError, RuntimeError) as error:
        raise file.fault(f"is no npz file, or a damaged one: {error}") from None
    for name, array in arrays.items():
        finite = np.isfinite(array) | (np.isnan(array) if allow_nan else False)
        if not finite.all():
            place = np.argwhere(~finite)[0].tolist()
            value = array[tuple(place)]
            raise file.fault(f"{name}{place}: must be a finite number, not {value}")
    return _frozen(arrays)


def _array(file: DataFile, name: str, data: Any, size: int) -> Floats:
    """One array; its header is believed only as far as there are bytes for it."""
    shown = shorten(name)
    try:
        version = np.lib.format.read_magic(data)
        read = {(1, 0): np.lib.format.read_array_header_1_0}.get(
            version, np.lib.format.read_array_header_2_0
        )
        shape, is_fortran, dtype = read(data)
    except (zipfile.BadZipFile, zlib.error, EOFError):
        raise
    except Exception as error:  # what is raised on a damaged header depends on the damage
        raise file.fault(f"{shown}: is no array of NumPy ({shorten(str(error))})") from None
    if dtype.hasobject:
        raise file.fault(f"{shown}: holds Python objects, which could run any code: refused")
    if dtype.kind not in "fiu":
        raise file.fault(f"{shown}: must hold numbers, not {dtype}")
    if math.prod(shape) * dtype.itemsize != size - data.tell():
        raise file.fault(f"{shown}: is damaged: its size is not that of {shape}")
    if math.prod(shape) == 0:
        raise file.fault(f"{shown}: is empty, of shape {shape}")
    array = np.frombuffer(data.read(), dtype)
    return array.reshape(shape, order="F" if is_fortran else "C").astype(np.float64)


def _frozen(arrays: dict[str, Floats]) -> Arrays:
    for array in arrays.values():
        array.setflags(write=False)
    return MappingProxyType(arrays)
