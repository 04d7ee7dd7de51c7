"""How a run begins in a folder: nobody's files but those of a run are cleared away for it.

Before its first save a run has written no more than its logs and `NAME.part` of what it saves. If
it is killed then, the next one in that folder may clear them away: `run.json.begun`, made first
and gone with that save, says that they are leftovers. Whatever else lies under a name that a run
writes is somebody's: a scenario, another program's curves. Of several policies, each has a mark in
its folder, and `group.json.begun` says the same of `group.json.part` in the folder above theirs.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from fnmatch import fnmatchcase
from pathlib import Path

from iout_marl.errors import InputError
from iout_marl.files import fsync_folder, part_path, reason
from trainers.runs.saving import MANIFEST, NAMES, begun


def refuse_what_is_no_runs(manifest: Path, logs: Iterable[str] = ()) -> None:
    """Refuse to begin where something is in the way that no run is known to have left.

    Args:
        manifest: the new run's, or that of several, in the folder above theirs.
        logs: patterns of the files that it writes beside its saves.

    Raises:
        InputError: there is such a file, or the folder cannot be read.
    """
    # The first save puts it in its place once the manifest is in its own.
    in_the_way = [manifest.with_name(NAMES[0])] if manifest.name == MANIFEST else []
    with _usable(manifest.parent, "read"):
        if not os.path.lexists(begun(manifest)):
            in_the_way += _leftovers(manifest, logs)
    for path in in_the_way:
        if os.path.lexists(path):
            raise InputError(
                f"{path.parent}: cannot be used: it holds {path.name}, which is not known to be a "
                "leftover of a run; name another folder by --out"
            )


def begin(manifest: Path, logs: Iterable[str] = ()) -> None:
    """Make and mark the folder of a new run, without what one that never saved has left there.

    Args:
        manifest, logs: as for `refuse_what_is_no_runs`, which has refused nothing.

    Raises:
        InputError: it cannot be made.
    """
    mark = begun(manifest)
    with _usable(manifest.parent, "made"):
        mark.parent.mkdir(parents=True, exist_ok=True)
        if os.path.lexists(mark):
            for path in _leftovers(manifest, logs):
                path.unlink(missing_ok=True)
        else:
            mark.touch(exist_ok=False)
            fsync_folder(mark.parent)


def _leftovers(manifest: Path, logs: Iterable[str]) -> list[Path]:
    """Where a run that never saved leaves something, whether there or not."""
    folder = manifest.parent
    names = (*NAMES, MANIFEST) if manifest.name == MANIFEST else (manifest.name,)
    parts = [part_path(folder / name) for name in names]
    found = folder.iterdir() if folder.is_dir() else ()
    return [*parts, *(p for p in found if any(fnmatchcase(p.name, pattern) for pattern in logs))]


@contextmanager
def _usable(folder: Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(f"{folder}: cannot be {what}: {reason(error)}") from None
