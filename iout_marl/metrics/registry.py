"""The metrics that there are in this process: the built-in ones and those of users."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from iout_marl.errors import InputError, did_you_mean
from iout_marl.metrics.builtin import ALL
from iout_marl.metrics.metric import Better, Metric
from iout_marl.physics.arrays import Array
from iout_marl.whole import short, whole_argument

#: Letters of a user's name, and of a text of theirs; digits behind the point.
_LONGEST_NAME, _LONGEST_TEXT, _MOST_DIGITS = 60, 1_000, 12

_BUILTIN = {metric.name: metric for metric in ALL}
_OF_USERS: dict[str, Metric] = {}


def registered() -> tuple[Metric, ...]:
    """All metrics there are now: the built-in ones, then those of users as they came."""
    return (*_BUILTIN.values(), *_OF_USERS.values())


def described(name: str) -> Metric:
    """The metric of this name; of one that is not registered here, what its name tells."""
    known = _BUILTIN.get(name) or _OF_USERS.get(name)
    return known or Metric(
        name,
        _no_function,
        definition="",
        unit="",
        heading=name,
        axis_title=name,
        title=name,
        tag=f"metrics/{name}",
        digits=3,
        is_builtin=False,
    )


def _no_function(*_: Any) -> Array:
    raise InputError("the metric is not registered here")


def curve_title(tag: str) -> str:
    """What the curve of a training is called, by the tag of a metric."""
    metric = next(metric for metric in registered() if metric.tag == tag)
    return metric.curve_title or metric.axis_title


def register(
    name: str,
    *,
    unit: str | None = None,
    definition: str | None = None,
    per_slot: bool = False,
    better: Better | None = None,
    symbol: str = "",
    heading: str | None = None,
    axis_title: str | None = None,
    digits: int = 2,
    low: float = -math.inf,
    high: float = math.inf,
) -> Callable[[Callable[..., Array]], Callable[..., Array]]:
    """Registers the function below it as a metric, in this process.

    The function takes the world and its state at the end of an episode, or, `per_slot`, the
    world, the state after a slot and its `Events`; then its values are summed over the slots of
    an episode. It returns (envs,) numbers, by operations that `world.backend.xp` has. Worlds
    that are made from now on compute it.

    Args:
        name: a word, such as `worst_wait`.
        unit: of its values; "" for a pure number.
        definition: a sentence.
        per_slot: whether it is a sum over slots.
        better: "less" or "more"; None where neither is better.
        symbol: as in a formula.
        heading: of its row in a table; by default its name, with spaces.
        axis_title: of an axis or a column; by default its heading, with the unit.
        digits: behind the point.
        low, high: what it cannot be below and above: where intervals end.

    Raises:
        InputError: the name is no word or taken, the unit or the definition is missing, or
            another argument is out of its range.
    """
    if not isinstance(name, str) or not name.isidentifier() or len(name) > _LONGEST_NAME:
        raise InputError(f"metric {short(name)}: its name must be a word, such as worst_wait")
    if unit is None:
        raise InputError(f'metric {name}: needs a unit; unit="" is a pure number')
    if not definition:
        raise InputError(f"metric {name}: needs a definition, a sentence")
    texts = {"unit": unit, "definition": definition, "symbol": symbol}
    heading = name.replace("_", " ") if heading is None else heading
    for key, text in {**texts, "heading": heading, "axis_title": axis_title or ""}.items():
        if not isinstance(text, str) or not text.isprintable() or len(text) > _LONGEST_TEXT:
            raise InputError(f"metric {name}: {key} must be a line of text, not {short(text)}")
    if better not in ("less", "more", None):
        raise InputError(
            f"metric {name}: better must be 'less', 'more' or None, not {short(better)}"
        )
    limits = [one for one in (low, high) if isinstance(one, int | float)]
    if len(limits) < 2 or not low < high:
        raise InputError(
            f"metric {name}: low must be a number below high, not {short(low)} and {short(high)}"
        )
    digits = whole_argument(f"metric {name}: digits", digits, 0, _MOST_DIGITS)
    shown = heading[:1].upper() + heading[1:]

    def decorate(function: Callable[..., Array]) -> Callable[..., Array]:
        if name in _BUILTIN:
            raise InputError(f"metric {name}: is a built-in one; give yours another name")
        if name in _OF_USERS:
            raise InputError(f"metric {name}: is registered already; metrics.unregister frees it")
        if not callable(function):
            raise InputError(f"metric {name}: must be a function, not {short(function)}")
        _OF_USERS[name] = Metric(
            name,
            function,
            definition=definition,
            unit=unit,
            symbol=symbol,
            heading=heading,
            axis_title=axis_title or (f"{shown} in {unit}" if unit else shown),
            title=shown,
            tag=f"metrics/{name}",
            digits=digits,
            better=better,
            low=float(low),
            high=float(high),
            computed_from="slot" if per_slot else "state",
            is_builtin=False,
        )
        return function

    return decorate


def unregister(name: str) -> None:
    """Forget a user's metric; worlds that were made before still compute it.

    Raises:
        InputError: there is none of this name.
    """
    if name not in _OF_USERS:
        raise InputError(
            f"no metric {short(name)} was registered{did_you_mean(str(name), _OF_USERS)}"
        )
    del _OF_USERS[name]
