"""What every section of a scenario is made of: types of fields, strictness, errors.

Numbers have two kinds of limits. Hard ones hold always: what lies beyond cannot be computed
with. `Plausible` ranges are those of any sea and any hardware: what lies beyond is most often a
slip (a frequency in Hz, a sign forgotten), and allowed only to a scenario that lists its key in
`allow_implausible`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, ClassVar, TypeAlias

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, field_validator
from pydantic_core import PydanticCustomError

#: Sizes of numbers, other than 0, with which equations neither overflow nor vanish.
SMALLEST, LARGEST = 1e-15, 1e15


def invalid(
    path: tuple[str | int, ...], message: str, *, beside: tuple[str | int, ...] = ()
) -> PydanticCustomError:
    """An error at `path` below the model that raises it.

    Args:
        path: what is wrong.
        message: why.
        beside: the other key of the whole that it does not go with, whose place is named too.
    """
    # The message is data, not a template: braces in it must not be filled in.
    context = {"message": message, "path": path, "beside": beside}
    return PydanticCustomError("invalid", "{message}", context)


@dataclass(frozen=True)
class Plausible:
    """The range in which a number is believed, of a field or of the items of a list.

    Attributes:
        low, high: the range.
        unit: of what.
        slips: factors by which such a number is easily off.
    """

    low: float
    high: float
    unit: str = ""
    slips: tuple[float, ...] = ()

    def holds(self, value: float) -> bool:
        """Whether the number is believed."""
        return self.low <= value <= self.high

    def doubt(self, value: float) -> str:
        """What is said of a number that is not."""
        meant = [value * slip for slip in self.slips if self.holds(value * slip)]
        unit = f" {self.unit}" if self.unit else ""
        text = f"{value:g}{unit} is implausible: usual are {self.low:g} to {self.high:g}{unit}"
        return f"{text} (was {meant[0]:g} meant?)" if meant else text

    def __get_pydantic_json_schema__(self, core_schema: Any, handler: Any) -> dict[str, Any]:
        """The range in a generated schema, where it binds nothing."""
        schema: dict[str, Any] = handler(core_schema)
        return {**schema, "plausible": {"low": self.low, "high": self.high, "unit": self.unit}}


def _whole(value: object) -> object:
    """1e6 is a whole number, if written as one of the others."""
    return int(value) if isinstance(value, float) and value.is_integer() else value


def _computable(value: float) -> float:
    if value and not SMALLEST <= abs(value) <= LARGEST:
        raise invalid((), f"must be 0 or of a size from {SMALLEST:g} to {LARGEST:g}, not {value:g}")
    return value


def _writable(text: str) -> str:
    if any("\ud800" <= c <= "\udfff" for c in text):
        raise invalid((), "holds half a character, such as \\ud800")
    return text


Real: TypeAlias = Annotated[float, AfterValidator(_computable)]
Positive: TypeAlias = Annotated[float, Field(gt=0), AfterValidator(_computable)]
NonNegative: TypeAlias = Annotated[float, Field(ge=0), AfterValidator(_computable)]
Fraction: TypeAlias = Annotated[float, Field(ge=0, le=1)]
#: A share that is not 0.
Efficiency: TypeAlias = Annotated[float, Field(gt=0, le=1), AfterValidator(_computable)]
#: A level or a gain in dB; beyond, powers would overflow.
Decibels: TypeAlias = Annotated[float, Field(ge=-300, le=300)]
Count: TypeAlias = Annotated[int, BeforeValidator(_whole), Field(ge=1, le=10**12)]
Cell: TypeAlias = Annotated[tuple[Count, Count, Count], Field(strict=False)]
Text: TypeAlias = Annotated[str, Field(max_length=10_000), AfterValidator(_writable)]


#: More than the arrays of a world have room for.
MAX_NODES, MAX_AUVS = 4_000, 1_000

Frequency: TypeAlias = Annotated[Positive, Plausible(0.1, 1000, "kHz", slips=(1e-3,))]
Directivity: TypeAlias = Annotated[Decibels, Plausible(-30, 60, "dB")]
Depth: TypeAlias = Annotated[NonNegative, Plausible(0, 11_000, "m")]
Spreading: TypeAlias = Annotated[float, Field(ge=0, le=4)]
Weights: TypeAlias = Annotated[
    tuple[Annotated[NonNegative, Plausible(0, 1e6)], ...],
    Field(strict=False, max_length=MAX_NODES),
]
NumNodes: TypeAlias = Annotated[Count, Field(le=MAX_NODES), Plausible(1, 1000, "nodes")]
Area: TypeAlias = Annotated[Positive, Plausible(1e-6, 10, "m²")]
PacketBits: TypeAlias = Annotated[Positive, Plausible(1, 1e9, "bit")]
Bandwidth: TypeAlias = Annotated[Positive, Plausible(10, 1e6, "Hz", slips=(1e3,))]
#: What is added to a reward or multiplies an age in it.
Term: TypeAlias = Annotated[Real, Plausible(-1e6, 1e6)]
Slots: TypeAlias = Annotated[Count, Plausible(1, 1_000_000, "slots")]


def _hashable(value: Any) -> Any:
    """What is hashed for a value of a setting: equal ones have equal hashes."""
    if isinstance(value, dict):
        return frozenset((key, _hashable(each)) for key, each in value.items())
    if isinstance(value, list | tuple):
        return tuple(map(_hashable, value))
    return value


class Section(BaseModel):
    """A section of a scenario: immutable, strictly typed, without unknown keys."""

    # Validators are built when they are needed first: by then all parts are registered.
    model_config = ConfigDict(
        frozen=True, extra="forbid", strict=True, allow_inf_nan=False, defer_build=True
    )

    #: Keys that came after hashes had been published, with the values that mean as before:
    #: those leave the hash as it was.
    hash_defaults: ClassVar[dict[str, Any]] = {}
    #: Keys that no result depends on: they are never in the hash.
    not_hashed: ClassVar[frozenset[str]] = frozenset()

    def __hash__(self) -> int:
        # Parts from outside may have lists and mappings among their settings.
        return hash((type(self), *map(_hashable, self.__dict__.values())))

    @field_validator("*")
    @classmethod
    def _no_negative_zero(cls, value: Any) -> Any:
        return value + 0.0 if isinstance(value, float) else value
