"""`metrics.jsonl`, the log of a run: a JSON object for every iteration."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from iout_marl.files import parse_json, read_if_there, to_json

#: What whole numbers stay below, of which floats and arrays can take no larger ones.
_LARGE = 2**63


def row(env_steps: int, log: Mapping[str, float]) -> str:
    """The line of an iteration; what is not finite, for which JSON has no word, is null."""
    finite = {tag: value if math.isfinite(value) else None for tag, value in log.items()}
    return to_json({"env_steps": env_steps, **finite}) + "\n"


def read_rows(path: Path) -> tuple[list[dict[str, Any]], int]:
    """The rows of a log, and how many lines were skipped since they are damaged.

    Every row has a whole number of `env_steps`, 0 or more; all that is in it is a finite number
    or null. A log that is not there has none.

    Raises:
        InputError: the log cannot be read.
    """
    lines = (read_if_there(path) or b"").split(b"\n")
    rows = [_row(line) for line in lines if line.strip()]
    kept = [each for each in rows if each is not None]
    return kept, len(rows) - len(kept)


def _row(line: bytes) -> dict[str, Any] | None:
    try:
        read = parse_json(line.decode())
    except ValueError:
        return None
    if not isinstance(read, dict) or type(read.get("env_steps")) is not int:
        return None
    is_right = read["env_steps"] >= 0 and all(map(_is_figure, read.values()))
    return read if is_right else None


def _is_figure(value: object) -> bool:
    if isinstance(value, float):
        return math.isfinite(value)
    return value is None or (type(value) is int and abs(value) < _LARGE)


def damaged_lines(path: Path, skipped: int) -> str:
    """What to say of lines that were skipped."""
    lines = "1 damaged line was" if skipped == 1 else f"{skipped:,} damaged lines were"
    return f"{path}: {lines} skipped"
