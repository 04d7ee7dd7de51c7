"""What every public function of the physics does first: read its arguments, and check them.

A formula is written for arrays of one library. `@formula(…)` makes of it a function that also
takes numbers, lists and tuples, and that refuses what lies outside the domain of an argument, by
name. What it wraps is kept as its `unchecked`: for callers that know their arguments, and for
compilers of arrays, which cannot look at numbers.
"""

from __future__ import annotations

import functools
import inspect
import math
import numbers
from collections.abc import Callable, Mapping
from typing import NamedTuple, ParamSpec, Protocol, cast

import array_api_compat
import numpy as np

from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array, ArrayLike, as_arrays, namespace
from iout_marl.whole import short

P = ParamSpec("P")
#: The arguments of a call, by name.
Given = Mapping[str, Array]


class Domain(NamedTuple):
    """The finite numbers that an argument may be."""

    #: What it must be, as 'must …' continues.
    words: str
    #: Where a value is such; may look at the other arguments.
    holds: Callable[[Array, Given], Array]


def within(low: float, high: float, note: str = "") -> Domain:
    """The numbers from `low` to `high`, both included."""
    return Domain(f"lie between {low:g} and {high:g}{note}", lambda x, _: (x >= low) & (x <= high))


REAL = Domain("be a number", lambda x, _: x == x)
POSITIVE = Domain("be above 0", lambda x, _: x > 0)
NOT_NEGATIVE = Domain("not be negative", lambda x, _: x >= 0)
EFFICIENCY = Domain("be above 0 and at most 1", lambda x, _: (x > 0) & (x <= 1))
FRACTION = within(0, 1)
COUNT = Domain("be a whole number from 1 on", lambda x, _: (x >= 1) & (x % 1 == 0))
#: The formulas for absorption and noise were fitted up to 1000; beyond 10 MHz none is used.
FREQUENCY_KHZ = Domain(
    "be above 0 and at most 10000 (kHz, not Hz)", lambda x, _: (x > 0) & (x <= 10_000)
)
TEMPERATURE_C = within(-2, 40, " (°C)")
DEPTH_M = within(0, 11_000, " (m)")


class Formula(Protocol[P]):
    """A function of arrays that checks its arguments."""

    __name__: str
    #: The same without any check, and for arrays of one library and Python numbers alone.
    unchecked: Callable[P, Array]

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> Array: ...


def formula(nan_says: str = "", /, **domains: Domain) -> Callable[[Callable[P, Array]], Formula[P]]:
    """Make a formula of a function of arrays.

    Args:
        nan_says: what NaN in the result means; "" where it could only come of numbers that
            are too large or too small to compute with, such as 0·∞, and is refused.
        domains: of each argument, by its name.
    """

    def decorate(function: Callable[P, Array]) -> Formula[P]:
        signature = inspect.signature(function)
        assert domains.keys() == signature.parameters.keys(), function

        @functools.wraps(function)
        def checked(*args: P.args, **kwargs: P.kwargs) -> Array:
            call = signature.bind(*args, **kwargs)
            call.apply_defaults()
            given = _read(call.arguments)
            # A number too large for its type is infinite, without a word.
            with np.errstate(all="ignore"):
                for name, domain in domains.items():
                    _check(name, domain, given)
                result = function(*given.values())  # type: ignore[call-arg]
            if not nan_says:
                _refuse_nan(function.__name__, result, given)
            return result

        checked.unchecked = function  # type: ignore[attr-defined]
        return cast(Formula[P], checked)

    return decorate


def _read(arguments: Mapping[str, ArrayLike]) -> dict[str, Array]:
    """Every argument as a floating array of one library."""
    read = {name: _numbers(name, value) for name, value in arguments.items()}
    try:
        _, *arrays = as_arrays(*read.values())
    except TypeError:
        names = ", ".join(k for k, v in read.items() if array_api_compat.is_array_api_obj(v))
        raise InputError(f"{names} must be arrays of one library on one device") from None
    return dict(zip(read, arrays, strict=True))


def _numbers(name: str, value: ArrayLike) -> ArrayLike:
    """An array, a Python number or lists of them.

    Raises:
        InputError: it is, or holds, something else.
    """
    if _is_odd(value):
        pass
    elif array_api_compat.is_array_api_obj(value):
        xp = namespace(value)
        if xp.isdtype(value.dtype, ("real floating", "integral")):
            return value
    else:
        try:
            # A list's own numbers decide its type: words would be read as numbers otherwise.
            array = np.asarray(value)
            if array.dtype.kind in "iuf" or all(
                isinstance(each, numbers.Real) and not isinstance(each, bool)
                for each in array.ravel().tolist()
            ):
                return array.astype(np.float64).tolist()
        except (ValueError, TypeError, OverflowError, RuntimeError):
            pass  # ragged, or numbers beyond every type: the message is the same
    raise InputError(f"{name} must be a number or an array of numbers, not {short(value)}")


def _is_odd(value: ArrayLike) -> bool:
    """Whether it is, or lists, what NumPy would take for numbers: truth values, masked arrays."""
    if isinstance(value, list | tuple):
        return any(map(_is_odd, value))
    if isinstance(value, bool | np.ma.MaskedArray):
        return True
    if isinstance(value, int | float) or not array_api_compat.is_array_api_obj(value):
        return False
    return bool(namespace(value).isdtype(value.dtype, "bool"))


def _check(name: str, domain: Domain, given: Given) -> None:
    x = given[name]
    xp = namespace(x)
    good = xp.isfinite(x) & domain.holds(x, given)
    if bool(xp.all(good)):
        return
    bad = _at_first(~good, x)
    words = domain.words if math.isfinite(bad) else f"be finite and {domain.words}"
    raise InputError(f"{name} must {words}: it is {bad:g}")


def _refuse_nan(function: str, result: Array, given: Given) -> None:
    xp = namespace(result)
    is_nan = xp.isnan(result)
    if bool(xp.any(is_nan)):
        numbers = ", ".join(f"{name} {_at_first(is_nan, x):g}" for name, x in given.items())
        raise InputError(f"{function}: too large or too small to compute with: {numbers}")


def _at_first(flags: Array, x: Array) -> float:
    """The number in an array, broadcast, where the first flag is set."""
    xp = namespace(x)
    values = xp.reshape(xp.broadcast_to(x, flags.shape), (-1,))
    first = int(xp.argmax(xp.astype(xp.reshape(flags, (-1,)), xp.int8)))
    # A number that has a gradient would come with a warning.
    return float(values.detach()[first] if hasattr(values, "detach") else values[first])
