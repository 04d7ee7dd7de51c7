"""Where scenario files lie: beside the package in a clone, inside it once installed."""

from __future__ import annotations

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


def bundled_root() -> Path:
    """The folder of the bundled scenarios."""
    installed = _PACKAGE / "_scenarios"
    return installed if installed.is_dir() else _PACKAGE.parent / "scenarios"


def bundled_names() -> list[str]:
    """Names of the bundled scenarios; files that only serve others (`_base`) are left out."""
    root = bundled_root()
    names = (p.relative_to(root).with_suffix("") for p in root.rglob("*.yaml"))
    return sorted(
        (
            n.as_posix()
            for n in names
            if n.parts[0] not in (PRESETS, STUDIES)
            and not any(part.startswith("_") for part in n.parts)
        ),
        key=_natural,
    )


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts k10 behind k3."""
    digits = "".join(c if c.isdigit() else " " for c in name).split()
    text = "".join(" " if c.isdigit() else c for c in name).split()
    return [(0, name.partition("/")[0]), *((int(d), "") for d in digits), *((0, t) for t in text)]


def find_scenario(source: str | Path, beside: Path | None = None) -> Path:
    """The file that `source` means: a path, or the name of a bundled scenario.

    Args:
        source: a path (from the folder of `beside`, else from the working folder) or a
            bundled name such as `paper/k10-fdd`; `.yaml` and `.yml` may be left out, and `~`
            is the user's folder.
        beside: the file that names `source`, for `extends`.

    Raises:
        InputError: no such file, or one that cannot be read.
    """
    if not str(source):
        raise InputError("no scenario '': the name is empty (see: iout scenarios)")
    path = _expanded(source)
    base = beside.parent if beside else Path()
    candidates = [base / path, *(base / f"{path}{suffix}" for suffix in SUFFIXES)]
    if not path.is_absolute():
        candidates.append(bundled_root() / f"{_without_suffix(str(source))}.yaml")
    found = _first_file(candidates)
    if isinstance(found, Path):
        return found
    name = _quoted(source)
    if found:
        raise InputError(f"no scenario {name}: {found}")
    near = did_you_mean(str(source)[:MAX_NAME], bundled_names(), most=3, or_list=False)
    raise InputError(
        f"no scenario {name}: neither a file nor a bundled name{near} (see: iout scenarios)"
    )


def find_preset(name: str, beside: Path | None = None) -> Path:
    """The file of a training preset: a bundled one by its name, or a path.

    Args:
        name: a bundled preset, or a path (from the folder of `beside` or from the working
            folder).
        beside: the scenario's file.

    Raises:
        InputError: no such preset, or one that cannot be read.
    """
    folder, path = bundled_root() / PRESETS, _expanded(name)
    bases = [beside.parent, Path()] if beside else [Path()]
    own = [base / f"{path}{suffix}" for base in bases for suffix in ("", *SUFFIXES)]
    found = _first_file([folder / f"{name}.yaml", *own])
    if isinstance(found, Path):
        return found
    known = [p.stem for p in folder.glob("*.yaml")]
    why = f": {found}" if found else did_you_mean(name[:MAX_NAME], known)
    raise InputError(f"no training preset {_quoted(name)}{why}")


def find_study(source: str | Path) -> Path:
    """The file of a study: a path, or the name of a bundled one.

    Raises:
        InputError: no such study, or one that cannot be read.
    """
    folder, path = bundled_root() / STUDIES, _expanded(source)
    own = [Path(f"{path}{suffix}") for suffix in ("", *SUFFIXES)]
    found = _first_file([*own, folder / f"{source}.yaml"])
    if isinstance(found, Path):
        return found
    known = [p.stem for p in folder.glob("*.yaml")]
    why = f": {found}" if found else did_you_mean(str(source)[:MAX_NAME], known)
    raise InputError(f"no study {_quoted(source)}{why}")


def _expanded(source: str | Path) -> Path:
    try:
        return Path(source).expanduser()
    except RuntimeError:  # `~` of a user who is not there
        return Path(source)


def _without_suffix(name: str) -> str:
    for suffix in SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def _quoted(source: str | Path) -> str:
    name = str(source)
    return repr(name if len(name) <= MAX_NAME else f"{name[: MAX_NAME - 3]}...")


def _first_file(candidates: Iterable[Path]) -> Path | str:
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
    is_run = isinstance(_first_file([inside]), Path)
    return "it is a folder" + (f"; did you mean {str(inside)!r}?" if is_run else "")
