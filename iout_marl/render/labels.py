"""What text and picture call things, and the units that they give energies in."""

from __future__ import annotations

import math

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


def shortened(text: str, length: int) -> str:
    """`text` on one line of at most `length` characters."""
    text = " ".join(text.split())
    return text if len(text) <= length else text[: length - 1] + "…"
