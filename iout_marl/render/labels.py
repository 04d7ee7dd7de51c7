"""What text and picture call things, and the units that they give energies in."""

from __future__ import annotations

import math
import re

from rich.cells import cell_len, set_cell_size

_PREFIXES = {-12: "p", -9: "n", -6: "µ", -3: "m", 0: "", 3: "k", 6: "M", 9: "G", 12: "T"}


def auv_name(index: int) -> str:
    """A, B, … Z, AA, AB, … for AUVs counted from 0."""
    name = ""
    index += 1
    while index > 0:
        index, letter = divmod(index - 1, 26)
        name = chr(ord("A") + letter) + name
    return name


def energy_unit(energy_j: float) -> tuple[float, str]:
    """The unit in which `energy_j` is easy to read.

    Returns:
        the unit in J, and its symbol: (1000.0, "kJ") for 2500 J.
    """
    exponent = 3 * math.floor(math.log10(energy_j) / 3) if energy_j > 0 else 0
    exponent = min(max(exponent, min(_PREFIXES)), max(_PREFIXES))
    return 10.0**exponent, f"{_PREFIXES[exponent]}J"


def energy_text(energy_j: float) -> str:
    """`energy_j` with three digits and a unit; what a rounding left behind is 0 J."""
    energy_j = float(f"{energy_j:.3g}")
    if energy_j < 1e-12:
        return "0 J"
    unit_j, unit = energy_unit(energy_j)
    return f"{energy_j / unit_j:.3g} {unit}"


def total_energy_text(energy_j: float) -> str:
    """A total that grows, in kJ of two digits; one that would be 0.00 kJ, as `energy_text`."""
    if 0 < energy_j < 10:
        return energy_text(energy_j)
    return f"{number_text(energy_j / 1000, 2)} kJ"


def number_text(value: float, digits: int = 0) -> str:
    """A number that is not negative; a very large one by its first digits."""
    return f"{value:.{digits}f}" if value < 1e5 else f"{value:.3g}"


def age_text(age_slots: float) -> str:
    """An age in slots, with a digit where it is short and not whole."""
    return number_text(age_slots, int(age_slots < 10 and age_slots % 1 != 0))


_BREAKS = re.compile("[\t-\r\x1c-\x1f\x85\u2028\u2029]+")
#: Control characters, halves of characters, and what Unicode keeps free for programs.
_NO_TEXT = re.compile(
    "[\0-\x08\x0e-\x1b\x7f-\x9f\ud800-\udfff\ufdd0-\ufdef"
    + "".join(chr(plane + end) for plane in range(0, 0x110000, 0x10000) for end in (0xFFFE, 0xFFFF))
    + "]"
)
#: Marks that change the direction of writing, by the mark that ends each.
_DIRECTIONS = {
    **dict.fromkeys("\u202a\u202b\u202d\u202e", "\u202c"),
    **dict.fromkeys("\u2066\u2067\u2068", "\u2069"),
}


def displayable(text: str) -> str:
    """`text` on one line, of characters that every display takes, for any text of a user's.

    What turns the direction of writing is ended, lest it turn what comes after the text.
    """
    if text.isprintable():
        return text
    text = _NO_TEXT.sub("\N{REPLACEMENT CHARACTER}", _BREAKS.sub(" ", text))
    ends: list[str] = []
    for character in text:
        if character in _DIRECTIONS:
            ends.append(_DIRECTIONS[character])
        elif ends and character == ends[-1]:
            ends.pop()
    return text + "".join(reversed(ends))


def shortened(text: str, length: int) -> str:
    """`text` on one line of at most `length` columns of a terminal."""
    text = displayable(" ".join(text.split()))
    if cell_len(text) > length:
        text = displayable(set_cell_size(text, length - 1).rstrip() + "…")
    return text


#: To +x and then, a turn of 45° each, by +y.
_ARROWS = "→↗↑↖←↙↓↘"


def current_text(x_m_per_s: float, y_m_per_s: float) -> str:
    """A current: its speed, and an arrow on a map on which x runs to the right and y up."""
    eighth = round(math.degrees(math.atan2(y_m_per_s, x_m_per_s)) / 45) % 8
    return f"{math.hypot(x_m_per_s, y_m_per_s):.2f} m/s {_ARROWS[eighth]}"
