"""What key was meant by one that there is not."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from difflib import SequenceMatcher

from pydantic import BaseModel

from iout_marl.scenario.keys import all_keys
from iout_marl.scenario.places import shorten

#: Keys that a message suggests at most.
_MOST = 4
#: How alike names must be, 0 to 1: one that is surely meant, even from another section, and one
#: that may be. Words of equal length that differ in a letter of four or in two of seven still may.
_SURELY, _MAYBE = 0.85, 0.7


def hint_to_key(
    model: type[BaseModel], section: str, own: Collection[str], key: str, *, or_list: bool = True
) -> str:
    """'; did you mean …?' for a key that a section has not, or what keys it has, or nothing.

    Keys of the section come first; those of other sections are meant where they are called so, and
    where the section was left out also where they are called almost so.

    Args:
        model: the whole file.
        section: the dotted path of the section; "" for the whole.
        own: the section's keys.
        key: what was written.
        or_list: whether to list the section's keys where none is near.
    """
    key = shorten(key)
    names: dict[str, list[str]] = {}
    for dotted in all_keys(model):
        above, _, name = dotted.rpartition(".")
        if above != section:
            names.setdefault(name, []).append(dotted)
    nearest = [] if section and own else _nearest(key, names, _SURELY)
    found = (
        sorted(name for name in own if len(key) > 2 and _begins(key, name))
        or _nearest(key, own, _SURELY)
        or names.get(key, [])
        or _nearest(key, own, _MAYBE)
        or (names[nearest[0]] if nearest else [])
    )
    if found and len(found) <= _MOST:
        return f"; did you mean {' or '.join(map(repr, found))}?"
    return f" (known: {', '.join(sorted(own))})" if or_list and own else ""


def hint_to_dotted_key(model: type[BaseModel], dotted: str) -> str:
    """The same for a dotted key that a file has not: the dotted keys that may have been meant."""
    known = all_keys(model)
    section, _, key = dotted.rpartition(".")
    if near := _nearest(shorten(dotted), known, _SURELY):
        return f"; did you mean {near[0]!r}?"
    own = [
        name for above, _, name in (other.rpartition(".") for other in known) if above == section
    ]
    if not own:
        return hint_to_key(model, section, (), key)
    hint = hint_to_key(model, section, own, key)
    for name in own if section else ():
        hint = hint.replace(f"{name!r}", f"'{section}.{name}'")
    return hint


def _stems(key: str, name: str) -> tuple[str, str]:
    """Both without the words that they end in alike: most often these are their unit."""
    one, other = key.split("_"), name.split("_")
    while len(one) > 1 and len(other) > 1 and one[-1] == other[-1]:
        one.pop()
        other.pop()
    return "_".join(one), "_".join(other)


def _begins(key: str, name: str) -> bool:
    one, other = _stems(key, name)
    return other.startswith(one)


def _nearest(key: str, names: Iterable[str], least: float) -> list[str]:
    """The name that is most like a key, if one is so much like it."""
    likeness = {name: SequenceMatcher(None, *_stems(key, name)).ratio() for name in names}
    best = max(sorted(likeness), key=lambda name: likeness[name], default="")
    return [best] if likeness.get(best, 0) >= least else []
