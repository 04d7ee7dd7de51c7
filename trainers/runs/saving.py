"""How a save is made: one file, written last, says which files belong together.

A save is several files in a folder, or in the folders of several policies trained side by
side, but a process can end between any two of them. So each save has a manifest with the
SHA-256 of every file, `run.json` in the run's folder:

1. every file that changes is written beside its name, as `NAME.part`;
2. the manifest takes its place, by one atomic renaming: this is the moment of the save;
3. every `NAME.part` takes the place of `NAME`.

Whoever reads goes by the manifest and takes of `NAME` and `NAME.part` the one whose SHA-256 it
gives. Before 2 this is the save before, after 2 the new one, whole in both cases, whatever of 1
and 3 was done. If the manifest changes meanwhile, the reader begins again. It never writes.
Whoever writes has the folder for itself (`locked`) and first does what is left of 3, or clears
away what is left of 1. A file whose SHA-256 is none of the manifest's is damaged, and refused; a
file that is gone is missed only by those who need it.

Of several policies, `group.json` in the folder above gives the SHA-256 of each policy's
`run.json`; its renaming is then the moment of the save, for all of them, and `run.json` is one
more file of 1 and 3. A policy that is later trained alone has a `run.json` that `group.json` does
not know, and that says of itself that it belongs to no group.

What a run leaves that ends before its first save, `trainers.runs.beginning` tells.

Runs of versions before the manifest have none, and are read as they are.
"""

from __future__ import annotations

import functools
import hashlib
import re
from collections.abc import Callable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from iout_marl.errors import InputError
from iout_marl.files import parse_json, part_path, read_if_there, reason, to_json, write_together

#: Changes whenever older manifests can no longer be read.
FORMAT = 1
#: The manifest of a run, and that of several policies, in the folder above theirs.
MANIFEST, GROUP = "run.json", "group.json"
#: What a save consists of; a result only once the training is finished.
NAMES = ("scenario.yaml", "policy.safetensors", "policy.json", "checkpoint.pt", "result.json")
#: How often a reader begins again while a training saves.
ATTEMPTS = 100

Result = TypeVar("Result")


@dataclass(frozen=True)
class Manifest:
    """Which contents belong together.

    Attributes:
        files: SHA-256 in hexadecimal by name.
        in_group: of a run's manifest, whether `group.json` decides on it.
    """

    files: Mapping[str, str]
    in_group: bool = False

    def to_bytes(self) -> bytes:
        """The file's contents."""
        data = {"format": FORMAT, "in_group": self.in_group, "files": dict(self.files)}
        return (to_json(data, indent=2) + "\n").encode()

    @classmethod
    @functools.lru_cache(maxsize=4)  # that of a group is read for each of its policies
    def parse(cls, path: Path, data: bytes, names: str) -> Manifest:
        """The manifest that a file holds.

        Args:
            path: the file.
            data: its contents.
            names: a regular expression of the names that may be in it.

        Raises:
            InputError: it is damaged, or of another version.
        """
        try:
            read = parse_json(data.decode())
        except ValueError as error:
            raise InputError(f"{path}: cannot be read: damaged, it is no JSON ({error})") from None
        version = read.get("format") if isinstance(read, dict) else None
        # Of another version nothing else is known.
        if type(version) is int and version != FORMAT:
            raise InputError(
                f"{path}: is of another version of this software: format {version}, not {FORMAT}"
            )
        if type(version) is not int or not _is_manifest(read, names):
            raise InputError(f"{path}: cannot be read: damaged, it is no manifest of a run")
        return cls(read["files"], read["in_group"])


def _is_manifest(read: dict[str, Any], names: str) -> bool:
    return (
        set(read) == {"format", "in_group", "files"}
        and isinstance(read["in_group"], bool)
        and isinstance(read["files"], dict)
        and all(re.fullmatch(names, name) for name in read["files"])
        and all(
            isinstance(digest, str) and re.fullmatch("[0-9a-f]{64}", digest)
            for digest in read["files"].values()
        )
    )


_OF_RUN = "|".join(map(re.escape, NAMES))
_OF_GROUP = rf"seed-\d+/{re.escape(MANIFEST)}"


def digest(data: bytes) -> str:
    """SHA-256 in hexadecimal."""
    return hashlib.sha256(data).hexdigest()


def read_save(folder: Path) -> dict[str, bytes]:
    """The files of the last save in a run's folder, by name; none where nothing was saved.

    Raises:
        InputError: one cannot be read, or is damaged.
    """
    return _settled(folder, lambda: _read_files(folder, manifest_of(folder)))


def manifest_of(folder: Path) -> Manifest | None:
    """The manifest of the last save in a run's folder; None where there is none.

    Raises:
        InputError: it cannot be read, or is damaged.
    """
    path = folder / MANIFEST
    own = read_if_there(path)
    wanted = _wanted_by_group(folder)
    for data in (own, read_if_there(part_path(path)), read_if_there(path)) if wanted else ():
        if data is not None and digest(data) == wanted:
            return Manifest.parse(path, data, _OF_RUN)
    if own is None:
        if wanted:
            raise InputError(f"{path}: is missing, but named by {GROUP} above it")
        return None
    manifest = Manifest.parse(path, own, _OF_RUN)
    if wanted and manifest.in_group:
        raise InputError(
            f"{path}: cannot be read: damaged, or not the one that {GROUP} above it belongs to"
        )
    return manifest


def _wanted_by_group(folder: Path) -> str | None:
    """The SHA-256 of a run's manifest by that of its group, if it is in one."""
    group, name = _above(folder) / GROUP, _name(folder)
    if re.fullmatch(r"seed-\d+", name) is None or (data := read_if_there(group)) is None:
        return None
    return Manifest.parse(group, data, _OF_GROUP).files.get(f"{name}/{MANIFEST}")


def _above(folder: Path) -> Path:
    # Of `.` the name, and what is above it, are those of the folder that it stands for.
    return folder.parent if folder.name else folder.resolve().parent


def _name(folder: Path) -> str:
    return folder.name or folder.resolve().name


def _read_files(folder: Path, manifest: Manifest | None) -> dict[str, bytes]:
    if manifest is None:
        found = {name: read_if_there(folder / name) for name in NAMES}
        return {name: data for name, data in found.items() if data is not None}
    files = {}
    for name, wanted in manifest.files.items():
        path, is_there = folder / name, False
        # A training may put the part in its place after the first look and before the second.
        for place in (path, part_path(path), path):
            data = read_if_there(place)
            is_there |= data is not None and place is path
            if data is not None and digest(data) == wanted:
                files[name] = data
                break
        else:
            if is_there:
                raise InputError(
                    f"{path}: cannot be read: damaged, its SHA-256 is not that of {MANIFEST}"
                )
    return files


def _settled(folder: Path, read: Callable[[], Result]) -> Result:
    """What is read, once no save has come in between."""
    for _ in range(ATTEMPTS):
        before = _signs(folder)
        try:
            result, error = read(), None
        except InputError as fault:
            error = fault
        if _signs(folder) == before:
            if error is not None:
                raise error
            return result
    raise InputError(f"{folder}: cannot be read: it changes all the time")


def _signs(folder: Path) -> tuple[bytes | None, ...]:
    """What changes with every save."""
    return read_if_there(folder / MANIFEST), read_if_there(_above(folder) / GROUP)


def is_used(folder: Path) -> bool:
    """Whether a folder holds a save, whole or damaged, or those of several policies.

    Raises:
        InputError: it cannot be read.
    """
    # A scenario alone may be anybody's: of that, `trainers.runs.beginning` tells.
    names = (MANIFEST, GROUP, *NAMES[1:])
    try:
        if any((folder / name).exists() for name in names):
            return True
        return _wanted_by_group(folder) is not None
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {reason(error)}") from None


def members_of_group(folder: Path) -> list[Path]:
    """The folders of policies that were saved together in one, by seed; none where none were.

    Raises:
        InputError: what says so cannot be read, or is damaged.
    """
    data = read_if_there(folder / GROUP)
    names = () if data is None else Manifest.parse(folder / GROUP, data, _OF_GROUP).files
    return sorted(((folder / name).parent for name in names), key=lambda path: int(path.name[5:]))


def members(folder: Path) -> list[Path]:
    """The folders in one that hold saves of policies trained side by side, by seed.

    Raises:
        InputError: the folder cannot be read.
    """
    try:
        names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    except OSError as error:
        raise InputError(f"{folder}: cannot be read: {reason(error)}") from None
    matches = (re.fullmatch(r"seed-(0|[1-9]\d*)", name) for name in names)
    found = (folder / f"seed-{n}" for n in sorted(int(m[1]) for m in matches if m))
    return [path for path in found if is_used(path)]


def save(
    states: Mapping[Path, Mapping[str, bytes]], group: Path | None = None, *, adds: bool = False
) -> None:
    """Save runs, all or none. The caller has the folders for itself.

    Args:
        states: the files of each run by name, by folder.
        group: the folder above those of several policies.
        adds: whether the files come to those of the last save, rather than in their place.

    Raises:
        InputError: a file cannot be written; the save before is as it was.
    """
    manifests: dict[Path, Manifest] = {}
    parts: dict[Path, bytes] = {}
    for folder, files in states.items():
        settle(folder)
        last = manifest_of(folder)
        before = {} if last is None else last.files
        digests = {name: digest(data) for name, data in files.items()}
        manifest = Manifest({**before, **digests} if adds else digests, group is not None)
        manifests[folder] = manifest
        for name, data in files.items():
            if before.get(name) != digests[name] or not (folder / name).exists():
                parts[folder / name] = data
        if group is not None:
            parts[folder / MANIFEST] = manifest.to_bytes()
    if group is None:
        (folder,) = states
        moment, last_written = folder / MANIFEST, manifests[folder]
    else:
        moment = group / GROUP
        last_written = Manifest(
            {f"{f.name}/{MANIFEST}": digest(parts[f / MANIFEST]) for f in states}
        )
    write_together({**parts, moment: last_written.to_bytes()}, moment=moment)
    for folder in states:
        settle(folder)
    with suppress(OSError):
        begun(moment).unlink(missing_ok=True)


def settle(folder: Path) -> None:
    """Finish what a process that ended within a save has left; the caller has the folder.

    Raises:
        InputError: a file cannot take its place, or the manifest is damaged.
    """
    manifest = manifest_of(folder)
    wanted = {} if manifest is None else {**manifest.files}
    if manifest is not None:
        wanted[MANIFEST] = _wanted_by_group(folder) or ""
    try:
        for name in (*NAMES, MANIFEST):
            path = folder / name
            data = read_if_there(part_path(path))
            if data is not None and digest(data) == wanted.get(name):
                part_path(path).replace(path)
            elif data is not None:
                part_path(path).unlink(missing_ok=True)
            if manifest is not None and name not in wanted:
                path.unlink(missing_ok=True)  # a result of a shorter training
        if manifest is not None:
            begun(folder / MANIFEST).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"{path}: cannot be put in its place: {reason(error)}") from None


def begun(manifest: Path) -> Path:
    """The mark that a run, or several, have begun in a folder and saved nothing yet."""
    return manifest.with_name(f"{manifest.name}.begun")
