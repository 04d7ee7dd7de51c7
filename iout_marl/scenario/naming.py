"""Scenarios by name: bundled ones, files, and members of families.

The path of a member is that of its family's file with the member's name behind it, as if the file
were a folder: `mine.yaml/k3-fdd`. The suffix may be left out, `mine/k3-fdd`; a file of that
name is preferred.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario.families import Family, family_of
from iout_marl.scenario.layers import parse_file, read_contents
from iout_marl.scenario.places import show_file
from iout_marl.scenario.sources import (
    MAX_NAME,
    PRESETS,
    STUDIES,
    SUFFIXES,
    bundled_root,
    expanded,
    first_file,
    quoted,
    without_suffix,
)


def bundled_names() -> list[str]:
    """Names of the bundled scenarios; files that only serve others (`_base`) are left out."""
    root = bundled_root()
    names: list[str] = []
    for path in root.rglob("*.yaml"):
        name = path.relative_to(root).with_suffix("")
        if name.parts[0] in (PRESETS, STUDIES) or any(p.startswith("_") for p in name.parts):
            continue
        family = _family_in(path)
        names += [f"{name.as_posix()}/{m}" for m in family.members] if family else [name.as_posix()]
    return sorted(names, key=_natural)


def _natural(name: str) -> list[tuple[int, str]]:
    """Sort key that puts k10 behind k3."""
    digits = "".join(c if c.isdigit() else " " for c in name).split()
    text = "".join(" " if c.isdigit() else c for c in name).split()
    return [(0, name.partition("/")[0]), *((int(d), "") for d in digits), *((0, t) for t in text)]


def member_names(source: str | Path) -> list[str]:
    """Names by which `load_scenario` takes the members of a family, in the order of its axes.

    Args:
        source: a bundled family (`paper`), or a path to a YAML file.

    Raises:
        InputError: no such file, or one that is no family.
    """
    path = _find(source, None)
    family = _family_in(path)
    if family is None:
        raise InputError(_no_family(path))
    above = without_suffix(str(source))
    return [f"{above}/{member}" for member in family.members]


def find_scenario(source: str | Path, beside: Path | None = None) -> Path:
    """The file that `source` means, or that of a family with the member's name behind it.

    Args:
        source: a path (from the folder of `beside`, else from the working folder) or a
            bundled name such as `paper/k10-fdd`; `.yaml` and `.yml` may be left out, and `~`
            is the user's folder.
        beside: the file that names `source`, for `extends`.

    Raises:
        InputError: no such file or member, one that cannot be read, or a family without a member.
    """
    path = _find(source, beside)
    file, member = split_member(path)
    try:
        family = _family_in(file)
    except InputError:
        return path  # whoever reads it is told what is wrong
    if family:
        family.member(member)
    return path


def split_member(path: Path) -> tuple[Path, str]:
    """A scenario's file, and its name in the family there; "" where it is in none."""
    is_member = isinstance(first_file([path.parent]), Path)
    return (path.parent, path.name) if is_member else (path, "")


def name_of(path: Path) -> str:
    """What a scenario is called by where it was found."""
    file, member = split_member(path)
    file, root = file.resolve(), bundled_root().resolve()
    is_bundled = file.is_relative_to(root)
    name = file.relative_to(root).with_suffix("").as_posix() if is_bundled else file.stem
    return f"{name}/{member}" if member else name


def _find(source: str | Path, beside: Path | None) -> Path:
    """`find_scenario`, but for a family without a member, which it finds."""
    if not str(source):
        raise InputError("no scenario '': the name is empty (see: iout scenarios)")
    path = expanded(source)
    base = beside.parent if beside else Path()
    candidates = [base / path, *(base / f"{path}{suffix}" for suffix in SUFFIXES)]
    if not path.is_absolute():
        candidates.append(bundled_root() / f"{without_suffix(str(source))}.yaml")
    found = first_file(candidates)
    if isinstance(found, Path):
        return found
    member, why, why_else = _find_member(path, base)
    if member:
        return member
    name = quoted(source)
    if found or why:
        raise InputError(f"no scenario {name}: {found or why}")
    near = did_you_mean(str(source)[:MAX_NAME], bundled_names(), most=3, or_list=False)
    if why_else and not near:
        raise InputError(f"no scenario {name}: {why_else}")
    raise InputError(
        f"no scenario {name}: neither a file nor a bundled name{near} (see: iout scenarios)"
    )


def _find_member(path: Path, base: Path) -> tuple[Path | None, str, str]:
    """The member of a family in the folder `base`, or else of a bundled one.

    Returns:
        its path; why the user's family has none; the same of files that were hardly meant.
    """
    why = why_else = ""
    for file in _files_above(path, base):
        try:
            family = _family_in(file)
        except InputError as error:
            why = why or str(error)
            continue
        if family is None:
            why_else = why_else or _no_family(file)
            continue
        for name in (path.name, without_suffix(path.name)):
            if name in family.members:
                return file / name, "", ""
        if file.is_relative_to(bundled_root()):
            why_else = family.no_member(path.name)
        else:
            why = why or family.no_member(path.name)
    return None, why, why_else


def _files_above(path: Path, base: Path) -> Iterator[Path]:
    """Files that a path may name a member of: in the folder `base`, and bundled ones."""
    above = path.parent
    if not above.name or above.name == "..":
        return
    for folder in [base] if path.is_absolute() else [base, bundled_root()]:
        for name in (f"{above}{suffix}" for suffix in ("", *SUFFIXES)):
            file = first_file([folder / name])
            if isinstance(file, Path):
                yield file


def _family_in(file: Path) -> Family | None:
    """The family that a file describes, if it does.

    Raises:
        InputError: it cannot be read, or describes none.
    """
    return family_in(file, read_contents(file))


def family_in(file: Path, contents: bytes) -> Family | None:
    """The family that the contents of a file describe, if they do.

    Raises:
        InputError: they are broken.
    """
    return _family(file, show_file(file), contents) if b"matrix" in contents else None


@lru_cache(maxsize=16)
def _family(file: Path, shown: str, contents: bytes) -> Family | None:  # noqa: ARG001
    """The family that contents describe; messages call its file as it is shown from here."""
    return family_of(parse_file(file, contents), file)


def _no_family(file: Path) -> str:
    return f"{show_file(file)}: is no family: it has no `matrix`"
