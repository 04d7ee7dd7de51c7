"""Of what every section of a scenario is made: types of fields, strictness, errors."""

from __future__ import annotations

from typing import Annotated, Any, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import PydanticCustomError

from iout_marl.errors import did_you_mean

Positive: TypeAlias = Annotated[float, Field(gt=0)]
NonNegative: TypeAlias = Annotated[float, Field(ge=0)]
Fraction: TypeAlias = Annotated[float, Field(ge=0, le=1)]
Count: TypeAlias = Annotated[int, Field(ge=1, le=10**12)]
Cell: TypeAlias = Annotated[tuple[Count, Count, Count], Field(strict=False)]


def invalid(path: tuple[str | int, ...], message: str) -> PydanticCustomError:
    """An error at `path` below the model that raises it."""
    # The message is data, not a template: braces in it must not be filled in.
    return PydanticCustomError("invalid", "{message}", {"message": message, "path": path})


class Section(BaseModel):
    """A section of a scenario: immutable, strictly typed, without unknown keys."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True, allow_inf_nan=False)

    @model_validator(mode="before")
    @classmethod
    def _refuse_unknown_keys(cls, data: Any) -> Any:
        if isinstance(data, dict):
            for key in data:
                if key not in cls.model_fields:
                    hint = did_you_mean(str(key), cls.model_fields)
                    raise invalid((key,), f"unknown key{hint}")
        return data
