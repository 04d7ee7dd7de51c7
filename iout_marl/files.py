"""Files that are written whole or not at all, and those that a user names."""

from __future__ import annotations

import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from iout_marl.errors import InputError


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that at every moment either the old or the new one is there, whole.

    Raises:
        InputError: it can not be written (a full disk, say); what was there stands.
    """
    write_together({path: data})


def write_together(files: Mapping[Path, bytes]) -> None:
    """Write files that belong together: none takes its place before all of them are on the disk.

    Raises:
        InputError: one can not be written; what was there stands.
    """
    parts = {path: path.with_name(path.name + ".part") for path in files}
    path = next(iter(files))
    try:
        for path, data in files.items():
            with parts[path].open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        for path, part in parts.items():
            part.replace(path)
    except OSError as error:
        for part in parts.values():
            with suppress(OSError):
                part.unlink(missing_ok=True)
        kept = "; the one before stands" if path.exists() else ""
        raise InputError(f"{path}: can not be written: {error.strerror}{kept}") from None


def write_text(path: Path, text: str) -> None:
    """Write a text where a user wants it, with a line break at its end; a pipe will do.

    Raises:
        InputError: it can not be written.
    """
    try:
        path.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: can not be written: {error.strerror}") from None
