"""Where scenario files lie: beside the package in a clone, inside it once installed."""

from __future__ import annotations

from pathlib import Path

from iout_marl.errors import InputError, did_you_mean

_PACKAGE = Path(__file__).resolve().parent.parent
#: Folder of the training presets, below the bundled scenarios.
PRESETS = "training"
#: Folder of the bundled studies, below the bundled scenarios.
STUDIES = "studies"


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
            bundled name such as `paper/k10-fdd`; `.yaml` may be left out.
        beside: the file that names `source`, for `extends`.

    Raises:
        InputError: no such file.
    """
    base = beside.parent if beside else Path()
    candidates = [base / source, base / f"{source}.yaml"]
    if not Path(source).is_absolute():
        candidates.append(bundled_root() / f"{str(source).removesuffix('.yaml')}.yaml")
    for candidate in candidates:
        if _is_file(candidate):
            return candidate
    raise InputError(
        f"no scenario {str(source)!r}: neither a file nor a bundled name"
        + did_you_mean(str(source), bundled_names())
    )


def _is_file(path: Path) -> bool:
    try:
        return path.is_file()
    except OSError:  # a name that is too long, a folder that is closed to the user
        return False


def find_preset(name: str, beside: Path | None = None) -> Path:
    """The file of a training preset: a bundled one by its name, or a path.

    Args:
        name: a bundled preset, or a path (from the folder of `beside` or from the working
            folder).
        beside: the scenario's file.

    Raises:
        InputError: no such preset.
    """
    folder = bundled_root() / PRESETS
    own = [beside.parent / name] if beside else []
    for candidate in (folder / f"{name}.yaml", *own, Path(name)):
        if _is_file(candidate):
            return candidate
    known = [p.stem for p in folder.glob("*.yaml")]
    raise InputError(f"no training preset {name!r}" + did_you_mean(name, known))


def find_study(source: str | Path) -> Path:
    """The file of a study: a path, or the name of a bundled one.

    Raises:
        InputError: no such study.
    """
    folder = bundled_root() / STUDIES
    for candidate in (Path(source), Path(f"{source}.yaml"), folder / f"{source}.yaml"):
        if _is_file(candidate):
            return candidate
    known = [p.stem for p in folder.glob("*.yaml")]
    raise InputError(f"no study {str(source)!r}" + did_you_mean(str(source), known))
