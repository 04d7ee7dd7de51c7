"""Options and arguments that several commands have, and how they are read."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Mapping
from decimal import Decimal, InvalidOperation
from pathlib import Path
from typing import Annotated, Any

import typer

from iout_marl.errors import InputError
from iout_marl.files import to_json, write_text
from iout_marl.outside import bring_in
from iout_marl.terminal import present
from iout_marl.whole import short, whole_number


def whole(least: int, most: int) -> Callable[[str], int]:
    """Reads a whole number: 100, 1_000, 1e6."""

    def number(text: str) -> int:
        try:
            given = Decimal(text)
            return whole_number(given if given.is_finite() else text, least, most)
        except InvalidOperation:
            raise typer.BadParameter(f"must be a whole number, not {short(text)}") from None
        except ValueError as error:
            raise typer.BadParameter(str(error)) from None

    return number


def time_s(text: str) -> float:
    """Reads a time in seconds: 0.5, 60."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if math.isnan(number):
        raise typer.BadParameter(f"must be a number, not {short(text)}")
    if number < 0:
        raise typer.BadParameter(f"must be at least 0, not {number:g}")
    return number


def expanded(text: str) -> str:
    """Reads a name or a path: a ~ in front is the home folder, also after `=`."""
    if not text.startswith("~"):
        return text
    try:
        return str(Path(text).expanduser())
    except RuntimeError:
        raise typer.BadParameter(f"{text}: there is no such home folder") from None


def folder(text: str) -> Path:
    """Reads the path of a folder, which may be new."""
    path = _path(text, "a folder")
    if os.path.exists(path) and not os.path.isdir(path):  # noqa: PTH110, PTH112 (never raise)
        raise typer.BadParameter(f"{path}: is a file, not a folder")
    return path


def file(text: str) -> Path:
    """Reads the path of a file to write."""
    path = _path(text, "a file")
    if os.path.isdir(path):  # noqa: PTH112 (never raises)
        raise typer.BadParameter(f"{path}: cannot be written: is a folder, not a file")
    if not os.path.isdir(path.parent):  # noqa: PTH112
        raise typer.BadParameter(f"{path}: cannot be written: {path.parent} is no folder")
    return path


def file_ending(*endings: str) -> Callable[[str], Path]:
    """Reads the path of a file to write, whose name says what it is: so nothing else is lost.

    What is no ordinary file, such as a pipe, may be called anything.
    """

    def parse(text: str) -> Path:
        path = file(text)
        is_other = os.path.exists(path) and not os.path.isfile(path)  # noqa: PTH110, PTH113
        if not is_other and path.suffix.lower() not in endings:
            raise typer.BadParameter(f"{path}: must end in {' or '.join(endings)}")
        return path

    return parse


def json_target(text: str) -> Path:
    """Reads the path of a JSON file to write: a file of anything else is not written over.

    An empty file holds nothing that could be lost. `-` is standard output.
    """
    if text == "-":
        return Path(text)
    path = file_ending(".json")(text)
    try:
        contents = path.read_bytes() if path.is_file() else b""
    except OSError:  # which the one who writes will tell of
        return path
    if contents.strip():
        try:
            json.loads(contents)
        except (ValueError, RecursionError):
            raise typer.BadParameter(f"{path}: holds something else than JSON") from None
    return path


def _path(text: str, what: str) -> Path:
    if not text.strip():
        raise typer.BadParameter(f"must name {what}, not be empty")
    return Path(expanded(text))


#: How help calls what names a policy: whatever `load_policy` takes.
POLICY = "NAME|RUN|MODULE:NAME"
ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        parser=expanded,
        help="A bundled name, or a path to a YAML file; of a family, FILE.yaml/MEMBER.",
    ),
]
JsonFile = Annotated[
    Path | None,
    typer.Option(
        "--json",
        metavar="FILE",
        parser=json_target,
        help="Also write the figures as JSON; - prints it.",
    ),
]
Overrides = Annotated[
    list[str] | None,
    typer.Option(
        "--set", metavar="KEY=VALUE", help="Change a key of the scenario; may be repeated."
    ),
]


Imports = Annotated[
    list[str] | None,
    typer.Option(
        "--import",
        metavar="MODULE|FILE.py",
        parser=expanded,
        help="Import parts and metrics of your own; may be repeated.",
    ),
]


def take(imports: list[str] | None) -> None:
    """Import what `--import` names.

    Raises:
        InputError: it cannot be imported.
    """
    for source in imports or []:
        try:
            bring_in(source)
        except InputError as error:
            raise InputError(f"--import: {error}") from None


def refuse_same_file(targets: Mapping[str, Path | None]) -> None:
    """Refuse to write several things into one file, however its path is spelled.

    Args:
        targets: what each option names, if anything.

    Raises:
        InputError: two of them lead to the same place, through links too.
    """
    options: dict[str, str] = {}
    for option, target in targets.items():
        if target is not None:
            place = os.path.normcase(os.path.realpath(target))  # never raises
            if (other := options.setdefault(place, option)) != option:
                raise InputError(f"{other} and {option} must name different files")


def give_out(record: Any, json_file: Path | None, show_tables: Callable[[], None]) -> None:
    """Write a record where `--json` says, and show the tables; for `-` only print the record.

    Raises:
        InputError: it cannot be written; the tables are shown all the same.
    """
    text = to_json(record, indent=2)
    if json_file is not None and str(json_file) == "-":
        present(text)
        return
    try:
        # First what is to be kept: nothing that happens to the terminal may cost it.
        if json_file is not None:
            write_text(json_file, text)
    finally:
        show_tables()
