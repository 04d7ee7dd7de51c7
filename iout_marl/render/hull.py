"""The outline of an AUV of length 1 around the origin, its nose to the right."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.path import Path

#: The upper half, from tail to nose: whether a point is one of the three of a curve.
_UPPER = (
    (False, -0.5, 0.0),
    (False, -0.5, 0.21),  # tail fin
    (False, -0.43, 0.21),
    (False, -0.36, 0.1),
    *((True, -0.3, 0.16), (True, -0.22, 0.185), (True, -0.12, 0.185)),  # body
    (False, 0.22, 0.185),
    *((True, 0.4, 0.185), (True, 0.5, 0.1), (True, 0.5, 0.0)),  # nose
)


def _outline() -> list[tuple[bool, float, float]]:
    """The whole of it: the lower half is the upper one, backwards."""
    # Whether a segment is a curve is said at its end.
    lower = [
        (curved, x, -y)
        for (curved, *_), (_, x, y) in zip(_UPPER[:0:-1], _UPPER[-2::-1], strict=True)
    ]
    return [*_UPPER, *lower]


def hull_path() -> Path:
    """The outline for matplotlib."""
    from matplotlib.path import Path

    (_, *start), *rest = _outline()
    codes = [Path.MOVETO, *(Path.CURVE4 if c else Path.LINETO for c, _, _ in rest), Path.CLOSEPOLY]
    points = [start, *([x, y] for _, x, y in rest), start]
    return Path(points, codes)


def hull_svg() -> str:
    """The outline as the `d` of an SVG path."""
    (_, x, y), *rest = _outline()
    words = [f"M{x:g} {y:g}"]
    held: list[str] = []
    for curved, x, y in rest:
        if not curved:
            words.append(f"L{x:g} {y:g}")
            continue
        held.append(f"{x:g} {y:g}")
        if len(held) == 3:
            words.append("C" + " ".join(held))
            held = []
    return "".join(words) + "Z"
