"""Changes to data as JSON has them, that leave nothing sacred: for campaigns of bad input."""

from __future__ import annotations

from typing import Any

import numpy as np

#: What stands where a number stood.
ODD_VALUES = (
    None,
    True,
    False,
    "",
    "12",
    "nan",
    [],
    [[]],
    {},
    {"a": 1},
    float("nan"),
    float("inf"),
    -float("inf"),
    -0.0,
    0,
    -1,
    1,
    2.5,
    5e-324,
    1e-300,
    1.7e308,
    -1.7e308,
    2**31 - 1,
    2**53 + 1,
    2**62,
    2**63,
    -(2**63) - 1,
    10**400,
    -(10**400),
    10**5000,
    np.float64("nan"),
    np.float32(1e30),
    np.float16(2),
    np.int64(2**62),
    np.uint64(2**64 - 1),
    np.bool_(True),
    np.array(3),
    np.zeros((2, 2)),
    np.str_("x"),
    1j,
    b"x",
    "long" * 10_000,
    "two\nlines\x1b[31m",
)


def changed(rng: np.random.Generator, data: Any) -> Any:
    """The data with one change somewhere; lists and mappings are changed in place."""
    if isinstance(data, dict) and data:
        return _changed_mapping(rng, data)
    if isinstance(data, list) and data:
        return _changed_list(rng, data)
    if isinstance(data, (int, float)) and not isinstance(data, bool) and rng.random() < 0.6:
        return _changed_number(rng, data)
    return odd_value(rng)


def odd_value(rng: np.random.Generator) -> Any:
    """Anything; now and then a list in a list, very deep."""
    if rng.random() < 0.03:
        deep: list[Any] = []
        for _ in range(int(rng.choice([100, 900, 100_000]))):
            deep = [deep]
        return deep
    return ODD_VALUES[rng.integers(len(ODD_VALUES))]


def _changed_mapping(rng: np.random.Generator, data: dict[Any, Any]) -> dict[Any, Any]:
    keys = list(data)
    key, other = (keys[i] for i in rng.integers(len(keys), size=2))
    choice = rng.random()
    if choice < 0.06:
        del data[key]
    elif choice < 0.1:
        data[key], data[other] = data[other], data[key]
    elif choice < 0.14:
        names = ("", "x", f"{key}s", 3, None, "k" * 100_000, "two\nlines")
        data[names[rng.integers(len(names))]] = data[other]
    else:
        data[key] = changed(rng, data[key])
    return data


def _changed_list(rng: np.random.Generator, data: list[Any]) -> Any:
    first, second = (int(i) for i in rng.integers(len(data), size=2))
    match int(rng.integers(14)):
        case 0:
            del data[first]
        case 1:
            data.insert(second, data[first])
        case 2:
            data[first], data[second] = data[second], data[first]
        case 3:
            data.reverse()
        case 4:
            data.clear()
        case 5:
            data.append(odd_value(rng))
        case 6:
            return data * int(rng.choice([2, 10, 200]))
        case 7:
            return data[:first]
        case 8:
            return data[first]
        case 9:
            return [data]
        case _:
            data[first] = changed(rng, data[first])
    return data


def _changed_number(rng: np.random.Generator, number: float) -> Any:
    try:
        near = float(number)
    except OverflowError:
        return -number
    with np.errstate(all="ignore"):
        choices = (
            number + 1,
            number - 1,
            -number,
            number * 2,
            near / 2,
            near * (1 + 1e-9),
            float(np.nextafter(near, np.inf)),
            float(np.nextafter(near, -np.inf)),
            near * 1e300,
            near * 1e-300,
            near - 1e6,
            float(number),
            str(number)[:50],
            np.float64(near),
            np.float32(near),
        )
    return choices[rng.integers(len(choices))]
