"""How large cells are: a number of metres for cubes, three for the edges along x, y and z."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, TypeAlias

from pydantic import Discriminator, Field, Tag

from iout_marl.scenario.fields import Positive

#: Metres along x, y and z.
Edges: TypeAlias = tuple[float, float, float]
#: As it is written: one number where all three are equal.
Spacing: TypeAlias = float | Edges

#: Forms of it; in parentheses, as no key is: messages leave them out of its place.
_ONE, _THREE = "(edge)", "(edges)"


def _form(value: Any) -> str:
    return _THREE if isinstance(value, list | tuple) else _ONE


#: A field of a section that holds it.
SpacingField: TypeAlias = Annotated[
    Annotated[Positive, Tag(_ONE)]
    | Annotated[tuple[Positive, Positive, Positive], Field(strict=False), Tag(_THREE)],
    Discriminator(_form),
]


def edges_m(spacing_m: Spacing | Sequence[float]) -> Edges:
    """The edges of a cell along x, y and z in m."""
    if isinstance(spacing_m, int | float):
        return (spacing_m, spacing_m, spacing_m)
    x, y, z = spacing_m
    return x, y, z


def shortest_form(spacing_m: Spacing) -> Spacing:
    """The spacing as a number, where three edges are equal."""
    edges = edges_m(spacing_m)
    return edges[0] if len(set(edges)) == 1 else edges


def spacing_text(spacing_m: Spacing | Sequence[float]) -> str:
    """The size of a cell in words."""
    edges = edges_m(spacing_m)
    shown = edges[:1] if len(set(edges)) == 1 else edges
    return f"{' × '.join(f'{edge:g}' for edge in shown)} m"
