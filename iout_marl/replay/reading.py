"""Reads a recording out of JSON of unknown origin."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from iout_marl.core.reasons import Reason
from iout_marl.errors import InputError
from iout_marl.scenario.spacing import Spacing, shortest_form
from iout_marl.whole import MAX_SEED, is_number, short

#: What a file says that it is, and how it is laid out: readers of one version read no other.
FORMAT, VERSION = "iout_marl recording", 1
#: Above it no number is read.
_LARGEST = 1e300


class _Array(NamedTuple):
    """An array of a recording: its axes, what it holds, and its least and largest value."""

    axes: tuple[str, ...]
    kind: type
    least: float = 0.0
    most: str | float = _LARGEST  # of a size of the episode, its name


_SLOTS, _PLACES = ("slots", "auvs"), ("slots + 1", "auvs", "axes")
ARRAYS = {
    "nodes": _Array(("nodes", "axes"), int, 1, "grid"),
    "path": _Array(_PLACES, int, 1, "grid"),
    "left_grid": _Array(_SLOTS, bool),
    "blocked": _Array(_SLOTS, bool),
    "charged": _Array(_SLOTS, int, 0, "nodes"),
    "heard": _Array(_SLOTS, int, 0, "nodes"),
    "beta": _Array(_SLOTS, float, 0, 1),
    "outcome": _Array(_SLOTS, int, 0, "reasons"),
    "harvested_j": _Array(_SLOTS, float),
    "spent_j": _Array(_SLOTS, float),
    "rewards": _Array(_SLOTS, float, -_LARGEST),
    "ages": _Array(("slots + 1", "nodes"), float),
    "energy_j": _Array(("slots + 1", "nodes"), float),
}
#: Arrays of some episodes: where they are not written, nothing of their kind can be.
OPTIONAL_ARRAYS = {
    "battery": _Array(("slots + 1", "auvs"), float, 0, 1),
    "heading": _Array(_PLACES, int, 1, "grid"),
    "transit_slots": _Array(("slots + 1", "auvs"), int),
    "docks": _Array(("docks", "axes"), int, 1, "grid"),
    "asleep": _Array(("slots", "nodes"), bool),
    "current_m_per_s": _Array(("slots + 1", "auvs", "x and y"), float, -_LARGEST),
}
_ROUNDS = ("slots", "auvs", "rounds")
#: Of nodes polled beside the chosen ones; left out where there are none.
POLLED = {
    "polled": _Array(_ROUNDS, int, 0, "nodes"),
    "polled_outcome": _Array(_ROUNDS, int, 0, "reasons"),
    "polled_j": _Array(_ROUNDS, float),
}
TEXTS = ("scenario", "scenario_hash", "scenario_yaml", "policy", "duplex")
#: Numbers, with the least that each may be; some of them must be more.
NUMBERS = {
    **dict.fromkeys(("slot_s", "maximum_age", "reference_energy_j"), 0.0),
    "num_slots": 1,
}
_MORE_THAN_LEAST = ("slot_s",)
_WHOLE = ("num_slots",)
_WORDS = {"i": "whole numbers", "b": "true and false", "fi": "numbers"}
_KEYS = {"format", "version", "seed", "grid", "spacing_m", "splits_slot", "reasons"}
_KEYS |= {*TEXTS, *NUMBERS, *ARRAYS}


class Reader:
    """Reads values out of JSON of unknown origin."""

    def __init__(self, data: Any, where: str) -> None:
        self._where = where
        if not isinstance(data, Mapping) or data.get("format") != FORMAT:
            raise InputError(f"{where}: is no recording, as `Recording.save` writes it")
        if data.get("version") != VERSION:
            raise InputError(
                f"{where}: version must be {VERSION}, not {short(data.get('version'))}: "
                "record the episode anew"
            )
        if lacking := sorted(_KEYS - data.keys()):
            raise self.fault(lacking[0], "is missing")
        self._data = data

    def fault(self, name: str, message: str) -> InputError:
        """An error that says where."""
        return InputError(f"{self._where}: {name} {message}")

    def text(self, name: str) -> str:
        value = self._data[name]
        if not isinstance(value, str):
            raise self.fault(name, f"must be a text, not {short(value)}")
        return value

    def flag(self, name: str, *, missing: bool | None = None) -> bool:
        value = self._data.get(name, missing)
        if not isinstance(value, bool):
            raise self.fault(name, f"must be true or false, not {short(value)}")
        return value

    def number(self, name: str, least: float) -> float:
        value = self._data[name]
        is_open, is_whole = name in _MORE_THAN_LEAST, name in _WHOLE
        is_right = is_number(value, least, _LARGEST) and not (is_open and value == least)
        if not is_right or (is_whole and value != int(value)):
            kind = "whole number" if is_whole else "number"
            limit = f"{'above' if is_open else 'from'} {least:g}"
            raise self.fault(name, f"must be a {kind} {limit}, not {short(value)}")
        return int(value) if is_whole else float(value)

    def capacity(self) -> float | None:
        """The most that a node stores; None where stores have no limit, and nothing is written."""
        value = self._data.get("capacity_j")
        if value is not None and not (is_number(value, 0.0, _LARGEST) and value > 0):
            raise self.fault("capacity_j", f"must be a number above 0, not {short(value)}")
        return None if value is None else float(value)

    def optional_arrays(self, sizes: Mapping[str, int], grid: tuple[int, int, int]) -> Any:
        """Those of `OPTIONAL_ARRAYS` that are written, by name."""
        there = [name for name in OPTIONAL_ARRAYS if self._data.get(name) is not None]
        if ("heading" in there) != ("transit_slots" in there):
            found, lacking = ("heading", "transit_slots")[:: 1 if "heading" in there else -1]
            raise self.fault(lacking, f"is missing, but {found} is there")
        own = {"docks": self.length("docks")} if "docks" in there else {}
        return {name: self.array(name, {**sizes, **own}, grid) for name in there}

    def spacing(self) -> Spacing:
        """The edge of a cell, or three."""
        value = self._data["spacing_m"]
        edges = value if isinstance(value, list) and len(value) == 3 else [value]
        if not all(is_number(edge, 0.0, _LARGEST) and edge > 0 for edge in edges):
            raise self.fault("spacing_m", f"must be a number above 0 or three, not {short(value)}")
        x, y, z = map(float, edges if len(edges) == 3 else edges * 3)
        return shortest_form((x, y, z))

    def seed(self) -> int | None:
        value = self._data["seed"]
        is_whole = isinstance(value, int) and not isinstance(value, bool)
        if value is not None and not (is_whole and 0 <= value <= MAX_SEED):
            raise self.fault("seed", f"must be a whole number or null, not {short(value)}")
        return value

    def grid(self) -> tuple[int, int, int]:
        value = self._data["grid"]
        is_shape = isinstance(value, list) and len(value) == 3
        if not is_shape or not all(type(n) is int and 1 <= n < 2**31 for n in value):
            raise self.fault("grid", f"must be three numbers of cells, not {short(value)}")
        x, y, z = value
        return x, y, z

    def reasons(self) -> tuple[Reason, ...]:
        value = self._data["reasons"]
        if not isinstance(value, list) or not all(
            isinstance(each, list) and len(each) == 2 for each in value
        ):
            raise self.fault("reasons", f"must be pairs of code and text, not {short(value)}")
        try:
            return tuple(Reason(*each) for each in value)
        except InputError as error:
            raise self.fault("reasons", str(error)) from None

    def length(self, name: str) -> int:
        value = self._data[name]
        if not isinstance(value, list) or not value:
            raise self.fault(name, f"must be a list that is not empty, not {short(value)}")
        return len(value)

    def width(self, name: str) -> int:
        first = self._data[name][0]
        if not isinstance(first, list) or not first:
            raise self.fault(name, f"must hold lists that are not empty, not {short(first)}")
        return len(first)

    def rounds(self) -> int:
        """Nodes that an AUV polls in a slot at most; 0 where nothing of it is written."""
        if not (there := [name for name in POLLED if name in self._data]):
            return 0
        if lacking := [name for name in POLLED if name not in self._data]:
            raise self.fault(lacking[0], f"is missing, but {there[0]} is there")
        try:
            first = self._data["polled"][0][0]
            if isinstance(first, list) and first:
                return len(first)
        except (TypeError, LookupError):
            pass
        raise self.fault("polled", "must hold a list that is not empty for each slot and AUV")

    def array(self, name: str, sizes: Mapping[str, int], grid: tuple[int, int, int]) -> Any:
        """An array of the shape, the type and the range that its table says."""
        expected = (ARRAYS | OPTIONAL_ARRAYS | POLLED)[name]
        shape = tuple(sizes[axis] for axis in expected.axes)
        if 0 in shape:
            return np.zeros(shape, dtype=expected.kind)
        try:
            array = np.array(self._data[name])
        except ValueError:  # lists of unlike lengths
            array = np.array(None)
        kinds = {int: "i", bool: "b", float: "fi"}[expected.kind]
        if array.shape != shape or array.dtype.kind not in kinds:
            axes = " × ".join(map(str, shape))
            raise self.fault(
                name, f"must be {axes} ({', '.join(expected.axes)}) of {_WORDS[kinds]}"
            )
        most: Any = expected.most
        most = np.array(grid) if most == "grid" else sizes.get(most, most)
        outside = ~((array >= expected.least) & (array <= most))
        if expected.kind is not bool and outside.any():
            place = ", ".join(str(i + 1) for i in np.argwhere(outside)[0])
            raise self.fault(f"{name}[{place}]", f"is out of range: {array[outside][0]}")
        return array.astype(expected.kind)
