"""The command that writes a scenario to begin with."""

from __future__ import annotations

import os
import shlex
from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import Imports, expanded, file, take
from iout_marl.errors import InputError
from iout_marl.files import path_from, write_text
from iout_marl.outside import import_words
from iout_marl.scenario import bundled_root, find_scenario, load_scenario
from iout_marl.scenario.naming import name_of
from iout_marl.scenario.sources import SUFFIXES
from iout_marl.scenario.starter import starter
from iout_marl.terminal import present


def new(
    path: Annotated[
        Path,
        typer.Argument(metavar="FILE", parser=file, help="The file to write, such as mine.yaml."),
    ],
    source: Annotated[
        str,
        typer.Option(
            "--from",
            metavar="SCENARIO",
            parser=expanded,
            help="What to begin with: a bundled name, or a path.",
        ),
    ] = "paper/k10-fdd",
    imports: Imports = None,
) -> None:
    """Write a scenario with every section, units, ranges and alternatives beside, to be changed.

    It extends another one, and is as that until it is changed.
    """
    take(imports)
    path = new_scenario_file(path)
    found = find_scenario(source)
    write_text(path, starter(load_scenario(source), named_in(path, found)).rstrip("\n"))
    words = ["iout", "train", str(path), *import_words()]
    present(f"{path}: written; change what you like, then: {shlex.join(words)}")


def new_scenario_file(path: Path) -> Path:
    """The file of a scenario that is to be written; `.yaml` may be left out.

    Raises:
        InputError: it is there already.
    """
    whole = path if path.suffix in SUFFIXES else path.with_name(f"{path.name}.yaml")
    if found := next(filter(os.path.lexists, (path, whole)), None):
        path = found
        raise InputError(f"{path}: is there already, and is not written over: name another file")
    return whole


def named_in(path: Path, scenario: Path) -> str:
    """How a file names a scenario that it extends: by its bundled name or from its own folder."""
    if scenario.resolve().is_relative_to(bundled_root().resolve()):
        return name_of(scenario)
    return Path(path_from(scenario, path.parent)).as_posix()
