"""Files that are written whole or not at all, and those that a user names."""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from pathlib import Path
from typing import Any, NoReturn

from filelock import FileLock, Timeout

from iout_marl.errors import InputError

#: Device and inode of the files that were read; None where nobody asks.
_READ: ContextVar[set[tuple[int, int]] | None] = ContextVar("_READ", default=None)
#: The file by which a process keeps others out of a folder; it stays when the process ends.
LOCK_NAME = ".lock"


def reason(error: OSError) -> str:
    """Why a file could not be read or written, in the system's words or the library's own."""
    return error.strerror or (str(error).strip() or type(error).__name__).splitlines()[0]


def user_path(given: object, what: str) -> Path:
    """A path that a user gave, with `~` for the home folder.

    Args:
        given: text or a path; whatever else it is, is refused.
        what: the option or argument, for the message.

    Raises:
        InputError: it is empty, or no path.
    """
    if not isinstance(given, str | os.PathLike):
        raise InputError(f"{what}: must be a path, not {type(given).__name__}")
    text = os.fspath(given)
    if not isinstance(text, str) or "\0" in text or not text.strip():
        raise InputError(f"{what}: must be a path, not {text!r}")
    try:
        return Path(text).expanduser()
    except RuntimeError:  # a user of that name is not known
        return Path(text)


def path_from(path: Path, folder: Path | None = None) -> str:
    """How a path is written from a folder, by default the working folder.

    Where no way leads there, as to another drive of Windows, or nobody knows where "here" is, it is
    the path itself: an absolute one, as long as a folder is named.
    """
    try:
        return os.path.relpath(path, folder)
    except (OSError, ValueError):
        return str(path) if folder is None else os.path.abspath(path)  # noqa: PTH100


@contextmanager
def inputs_noted() -> Iterator[None]:
    """While inside, what is read is noted, and `refuse_input` knows it."""
    token = _READ.set(set())
    try:
        yield
    finally:
        _READ.reset(token)


def note_input(file: int | Path) -> None:
    """Note that a file, open or by its path, is read."""
    if (noted := _READ.get()) is not None:
        found = os.stat(file)  # noqa: PTH116 (of descriptors, too)
        noted.add((found.st_dev, found.st_ino))


def refuse_input(path: Path) -> None:
    """Refuse to write where something was read.

    Raises:
        InputError: that file was read since `inputs_noted`.
    """
    with suppress(OSError):  # not there, for one
        found = path.stat()
        if stat.S_ISREG(found.st_mode) and (found.st_dev, found.st_ino) in (_READ.get() or ()):
            raise InputError(f"{path}: cannot be written: it is read by the same command")


def _size_if_there(path: Path) -> int | None:
    """How many bytes a file has; None where there is no such file.

    Raises:
        InputError: it cannot be looked at, or is a folder, a pipe or a device.
    """
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    if not stat.S_ISREG(found.st_mode):
        raise InputError(f"{path}: cannot be read: it is no regular file")
    return found.st_size


def read_if_there(path: Path) -> bytes | None:
    """What a file holds; None where there is no such file. Never waits, as a pipe would let it.

    Raises:
        InputError: it cannot be read, or is a folder, a pipe or a device.
    """
    if _size_if_there(path) is None:
        return None
    try:
        note_input(path)
        return path.read_bytes()
    except (FileNotFoundError, NotADirectoryError):
        return None
    except (OSError, MemoryError) as error:
        why = reason(error) if isinstance(error, OSError) else "not enough memory"
        raise InputError(f"{path}: cannot be read: {why}") from None


def write_atomically(path: Path, data: bytes) -> None:
    """Write a file so that at every moment either the old or the new one is there, whole.

    Raises:
        InputError: it cannot be written (a full disk, say); what was there stands.
    """
    write_together({path: data})


def part_path(path: Path) -> Path:
    """Where a file's next contents are written, before they take its place."""
    return path.with_name(path.name + ".part")


def write_together(files: Mapping[Path, bytes], *, moment: Path | None = None) -> None:
    """Write files that belong together: none takes its place before all of them are on the disk.

    They take their places one after the other. If one of them cannot, or the program is interrupted
    meanwhile, those that were not there before are removed again; of those that were, the first may
    be new and the others old. Where that must not be, one file decides which belong together.

    Args:
        files: contents by path, one or more.
        moment: the file that decides: it alone takes its place, all others wait as `part_path`
            for whoever reads by it.

    Raises:
        InputError: one cannot be written.
    """
    path, new, are_written = next(iter(files)), [], False
    try:
        for path, data in files.items():
            with part_path(path).open("wb") as file:
                file.write(data)
                file.flush()
                os.fsync(file.fileno())
        folders = {path.parent for path in files}
        for folder in folders:
            fsync_folder(folder)
        are_written = True
        for path in files if moment is None else [moment]:
            if not os.path.lexists(path):
                new.append(path)
            part_path(path).replace(path)
        for folder in folders:
            fsync_folder(folder)
    except BaseException as error:
        # Once the file that decides is in its place, the parts of the others are meant.
        has_passed = moment and are_written and not os.path.lexists(part_path(moment))
        if not has_passed:
            for each in (*map(part_path, files), *new):
                with suppress(OSError):
                    each.unlink(missing_ok=True)
        if not isinstance(error, OSError):
            raise
        kept = "; the one before is kept" if path.exists() else ""
        raise InputError(f"{path}: cannot be written: {reason(error)}{kept}") from None


def fsync_folder(folder: Path) -> None:
    """Bring the names in a folder to the disk, where the system can."""
    with suppress(OSError):
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def write_text(path: Path, text: str) -> None:
    """Write a text where a user wants it, with a line break at its end.

    A file is written whole or not at all; a pipe or a device will do, too.

    Raises:
        InputError: it cannot be written, or was read since `inputs_noted`.
    """
    refuse_input(path)
    data = f"{text}\n".encode()
    try:
        if path.exists() and not path.is_file():
            path.write_bytes(data)
            return
        target = path.resolve() if path.is_symlink() else path
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {reason(error)}") from None
    write_atomically(target, data)


def to_json(data: Any, *, indent: int | None = None) -> str:
    """Data as JSON that every reader understands, without a line break at its end.

    Raises:
        ValueError: a number in it is NaN or infinite, for which JSON has no word.
    """
    separators = (",", ":") if indent is None else None
    return json.dumps(data, indent=indent, separators=separators, allow_nan=False)


def parse_json(text: str) -> Any:
    """What a JSON text of unknown origin says.

    Raises:
        ValueError: it is no JSON, holds NaN or an infinity, or is nested too deeply.
    """

    def refuse(constant: str) -> NoReturn:
        raise ValueError(f"{constant} is no number of JSON")

    try:
        return json.loads(text, parse_constant=refuse)
    except RecursionError:
        raise ValueError("nested too deeply") from None


def read_json(path: Path) -> Any:
    """What a JSON file says.

    Raises:
        InputError: it cannot be read, or is no JSON.
    """
    try:
        note_input(path)
        return parse_json(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except ValueError as error:
        raise InputError(f"{path}: cannot be read: damaged, it is no JSON ({error})") from None


@contextmanager
def locked(folder: Path, refusal: str, patience_s: float = 0.0) -> Iterator[None]:
    """Keep other processes out of a folder; the system lets go when this one ends, however it does.

    Args:
        folder: the folder, which must be there.
        refusal: what to say if another process has it, such as "another study is running in it".
        patience_s: how long to wait for it.

    Raises:
        InputError: another process has it, the lock cannot be written, or is none of ours.
    """
    path = folder / LOCK_NAME
    # Ours are empty. Whoever takes it empties it. Of one that is held Windows lets nothing be read.
    if _size_if_there(path):
        raise InputError(f"{path}: is of another program: it is not empty")
    lock = FileLock(path, timeout=patience_s)
    try:
        lock.acquire()
    except Timeout:
        raise InputError(f"{folder}: {refusal}") from None
    except OSError as error:
        raise InputError(f"{folder}: cannot be written: {reason(error)}") from None
    with lock:
        yield
