"""The files of a mission: all of them are written, or none."""

from __future__ import annotations

import os
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.files import reason, write_together
from iout_marl.mission.formats import Format
from iout_marl.mission.mission import Mission
from iout_marl.mission.tables import actions_csv, actions_json
from iout_marl.scenario import Scenario

#: The actions of all AUVs, for which no format has a word.
ACTIONS = ("actions.csv", "actions.json")


def check_formats(scenario: Scenario, formats: Sequence[Format]) -> None:
    """Refuse formats that a scenario has no origin for, or this installation no library.

    Raises:
        InputError: so it is.
    """
    for each in formats:
        if each.needs_origin:
            if scenario.grid.origin is None:
                raise InputError(
                    f"--format {each.name}: needs grid.origin, where cell (1, 1, 1) lies on Earth, "
                    f"which {scenario.name} does not say: --set 'grid.origin={{latitude_deg: …, "
                    "longitude_deg: …, depth_m: …, bearing_deg: …}'"
                )
            require(f"--format {each.name}", "mission")
    if scenario.grid.origin is not None:
        require("grid.origin", "mission")


def file_names(num_auvs: int, formats: Sequence[Format]) -> list[str]:
    """The files of a mission of so many AUVs."""
    return [*(f"auv-{i + 1}{f.suffix}" for f in formats for i in range(num_auvs)), *ACTIONS]


def check_new(folder: Path, names: Sequence[str]) -> None:
    """Refuse to write over files.

    Raises:
        InputError: one of them is there.
    """
    for name in names:
        if os.path.lexists(folder / name):
            raise InputError(
                f"{folder / name}: is there already, and is not written over: name another folder"
            )


def mission_files(mission: Mission, formats: Sequence[Format]) -> dict[str, str]:
    """What stands in each file, by its name.

    Raises:
        InputError: an arrival would miss its time, in a format that has none.
        ValueError: a format needs an origin, and there is none.
    """
    texts = [each.text(mission, route) for each in formats for route in mission.routes]
    texts += [actions_csv(mission), actions_json(mission)]
    return dict(zip(file_names(len(mission.routes), formats), texts, strict=True))


def write_mission(mission: Mission, formats: Sequence[Format], folder: Path) -> list[Path]:
    """Write a mission's files into a folder, which may be new; nothing if anything fails.

    Returns:
        the files.

    Raises:
        InputError: one is there already, or cannot be written; or as for `mission_files`.
    """
    texts = mission_files(mission, formats)
    check_new(folder, list(texts))
    new = [each for each in (folder, *folder.parents) if not each.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        write_together({folder / name: f"{text}\n".encode() for name, text in texts.items()})
    except BaseException as error:
        for each in new:
            with suppress(OSError):
                each.rmdir()
        if not isinstance(error, OSError):
            raise
        raise InputError(f"{folder}: cannot be written: {reason(error)}") from None
    return [folder / name for name in texts]
