"""Where scenario files lie: beside the package in a clone, inside it once installed."""

from __future__ import annotations

import functools
import stat
from collections.abc import Iterable
from pathlib import Path

from iout_marl.errors import InputError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent.parent
#: Folder of the training presets, below the bundled scenarios.
PRESETS = "training"
#: Folder of the bundled studies, below the bundled scenarios.
STUDIES = "studies"
#: What the names of YAML files end in.
SUFFIXES = (".yaml", ".yml")
#: The scenario's file in the folder of a run.
RUN_SCENARIO = "scenario.yaml"
#: How much of a name is repeated in a message, and compared with those that are known.
MAX_NAME = 200


@functools.cache
def bundled_root() -> Path:
    """The folder of the bundled scenarios."""
    installed = _PACKAGE / "_scenarios"
    return installed if installed.is_dir() else _PACKAGE.parent / "scenarios"


def find_preset(name: str, beside: Path | None = None) -> Path:
    """The file of a training preset: a bundled one by its name, or a path.

    Args:
        name: a bundled preset, or a path (from the folder of `beside` or from the working
            folder).
        beside: the scenario's file.

    Raises:
        InputError: no such preset, or one that cannot be read.
    """
    folder, path = bundled_root() / PRESETS, expanded(name)
    bases = [beside.parent, Path()] if beside else [Path()]
    own = [base / f"{path}{suffix}" for base in bases for suffix in ("", *SUFFIXES)]
    found = first_file([folder / f"{name}.yaml", *own])
    if isinstance(found, Path):
        return found
    known = [p.stem for p in folder.glob("*.yaml")]
    why = f": {found}" if found else did_you_mean(name[:MAX_NAME], known)
    raise InputError(f"no training preset {quoted(name)}{why}")


def find_study(source: str | Path) -> Path:
    """The file of a study: a path, or the name of a bundled one.

    Raises:
        InputError: no such study, or one that cannot be read.
    """
    folder, path = bundled_root() / STUDIES, expanded(source)
    own = [Path(f"{path}{suffix}") for suffix in ("", *SUFFIXES)]
    found = first_file([*own, folder / f"{source}.yaml"])
    if isinstance(found, Path):
        return found
    known = [p.stem for p in folder.glob("*.yaml")]
    why = f": {found}" if found else did_you_mean(str(source)[:MAX_NAME], known)
    raise InputError(f"no study {quoted(source)}{why}")


def expanded(source: str | Path) -> Path:
    """A path, `~` replaced by the user's folder."""
    try:
        return Path(source).expanduser()
    except RuntimeError:  # `~` of a user who is not there
        return Path(source)


def without_suffix(name: str) -> str:
    """A file's name without what the names of YAML files end in."""
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def quoted(source: str | Path) -> str:
    """A name for a message: in quotes, and cut where it is long."""
    name = str(source)
    return repr(name if len(name) <= MAX_NAME else f"{name[: MAX_NAME - 3]}...")


def first_file(candidates: Iterable[Path]) -> Path | str:
    """The first that is a file; else why one of them is none, or "" if nothing is there.

    A pipe is none: reading it might wait for ever.
    """
    why = ""
    for candidate in candidates:
        try:
            mode = candidate.stat().st_mode
        except PermissionError as error:
            why = why or f"cannot be read: {error.strerror}"
        except (OSError, ValueError):  # nothing there, or a name that no file can have
            continue
        else:
            if stat.S_ISREG(mode):
                return candidate
            why = why or _what_it_is(candidate, mode)
    return why


def _what_it_is(path: Path, mode: int) -> str:
    if not stat.S_ISDIR(mode):
        return "it is a pipe or a device, not a file"
    inside = path / RUN_SCENARIO
    is_run = isinstance(first_file([inside]), Path)
    return "it is a folder" + (f"; did you mean {str(inside)!r}?" if is_run else "")
