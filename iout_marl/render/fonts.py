"""Which fonts have the characters of a text, and what to draw for those that none has."""

from __future__ import annotations

import unicodedata
from collections.abc import Iterable, Mapping
from functools import lru_cache

#: Comes with matplotlib, so that it is there everywhere.
DEFAULT_FONT = "DejaVu Sans"
#: Fonts whose letters are something else, or pictures that matplotlib cannot draw.
_UNFIT = ("Last Resort", "cmb10", "cmex10", "cmmi10", "cmr10", "cmss10", "cmsy10", "cmtt10")
_MISSING = "\N{REPLACEMENT CHARACTER}"


def fonts_for(text: str) -> tuple[tuple[str, ...], Mapping[int, str]]:
    """Families that together have the characters of a text.

    Returns:
        the families, the usual one first; and for `str.translate`, what to draw instead of
        characters that no installed font has: nothing for signs without a shape of their own.
    """
    from matplotlib import font_manager

    # A user may have added some meanwhile.
    return _fonts_for(text, len(font_manager.fontManager.ttflist))


@lru_cache(maxsize=64)
def _fonts_for(text: str, known: int) -> tuple[tuple[str, ...], Mapping[int, str]]:
    lacking = set(map(ord, text)) - _characters(DEFAULT_FONT)
    families = [DEFAULT_FONT]
    for family in _families(known) if lacking else ():
        found = lacking & _characters(family)
        if found:
            families.append(family)
            lacking -= found
        if not lacking:
            break
    return tuple(families), {code: _instead_of(code) for code in lacking}


def _instead_of(code: int) -> str:
    shapeless = unicodedata.category(chr(code)) == "Cf" or 0xFE00 <= code <= 0xFE0F
    return "" if shapeless else _MISSING


@lru_cache(maxsize=1)
def _families(known: int) -> tuple[str, ...]:  # noqa: ARG001  (what is kept is of so many fonts)
    """Installed families, those that are made to go with others first."""
    from matplotlib import font_manager

    names = {font.name for font in font_manager.fontManager.ttflist if font.style == "normal"}
    fit = (n for n in names if n not in (DEFAULT_FONT, *_UNFIT) and not n.startswith(_UNFIT[0]))
    # A colour font has bitmaps, or outlines that say nothing without their colours.
    flat = (n for n in fit if "color" not in n.lower())
    return tuple(sorted(flat, key=lambda name: (not name.startswith("Noto Sans"), name)))


@lru_cache(maxsize=4096)
def _characters(family: str) -> frozenset[int]:
    """What a family has, be it drawn regular or bold."""
    from matplotlib import font_manager

    found: list[Iterable[int]] = []
    for weight in ("normal", "bold"):
        wanted = font_manager.FontProperties(family=[family], weight=weight)
        try:
            path = font_manager.findfont(wanted, fallback_to_default=False)
            font = font_manager.get_font(path)
        except (OSError, RuntimeError, ValueError):
            return frozenset()  # uninstalled meanwhile, damaged, or of bitmaps
        found.append(font.get_charmap())
    return frozenset(found[0]).intersection(found[1])
