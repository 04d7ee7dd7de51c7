"""Values that Python programs pass, as the plain ones that a file holds."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from pydantic import BaseModel

from iout_marl.errors import InputError
from iout_marl.scenario.places import show_value
from iout_marl.scenario.yaml_values import MAX_DEPTH, MAX_VALUES


def plain_value(value: Any, where: str) -> Any:
    """NumPy's numbers as Python's, arrays and tuples as lists, sections and mappings as dicts.

    What has no plain form is left as it is: the schema refuses it.

    Args:
        value: what was passed.
        where: what to call it.

    Raises:
        InputError: it holds too much, is nested too deeply or within itself, or a key in it is
            no word.
    """
    return _Converter(where).convert(value, 0)


def plain_mapping(value: Mapping[Any, Any], where: str) -> dict[str, Any]:
    """`plain_value` of a mapping: a dict of its own."""
    converted: dict[str, Any] = plain_value(value, where)
    return converted


class _Converter:
    def __init__(self, where: str) -> None:
        self._where = where
        self._count = 0

    def convert(self, value: Any, depth: int) -> Any:
        self._count += 1
        if self._count > MAX_VALUES:
            raise InputError(f"{self._where}: more than {MAX_VALUES:,} values")
        if depth > MAX_DEPTH:
            raise InputError(f"{self._where}: nested too deeply, or within itself")
        if isinstance(value, BaseModel):
            value = value.model_dump()
        elif isinstance(value, np.ndarray):
            value = value.tolist() if value.size <= MAX_VALUES else [None] * (MAX_VALUES + 1)
        elif isinstance(value, np.generic):
            return value.item()
        elif isinstance(value, os.PathLike):
            return os.fspath(value)
        if isinstance(value, Mapping):
            return {self._key(key): self.convert(v, depth + 1) for key, v in value.items()}
        if isinstance(value, list | tuple):
            return [self.convert(item, depth + 1) for item in value]
        return value

    def _key(self, key: Any) -> str:
        if not isinstance(key, str):
            raise InputError(f"{self._where}: {show_value(key)} is no key: keys are words")
        return str(key)
