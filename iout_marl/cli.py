"""The command line, `iout`."""

from __future__ import annotations

import importlib
import signal
import sys
from collections.abc import Iterator, MutableMapping
from typing import Annotated, Any, NoReturn

import typer
from typer.core import TyperGroup

from iout_marl import __version__, startup
from iout_marl.cli_errors import notes_in_a_line, reason_of
from iout_marl.cli_looks import LOOKS
from iout_marl.files import inputs_noted
from iout_marl.terminal import (
    complain,
    finish_output,
    imports_uninterrupted,
    prepare_streams,
    present,
)

#: Every command: where it is, and how its help begins.
COMMANDS = {
    "scenarios": ("cli_show:scenarios", "List the bundled scenarios."),
    "show": (
        "cli_show:show",
        "Print a whole scenario, after `extends`, preset and overrides, as YAML.",
    ),
    "train": ("cli_train:train", "Train a policy by PPO."),
    "evaluate": (
        "cli_evaluate:evaluate",
        "Run policies over seeded episodes; means with 95 % confidence intervals.",
    ),
    "bound": (
        "cli_bound:bound_command",
        "Print a mean AoI that no policy can beat, checked, and how far policies are from it.",
    ),
    "export": (
        "cli_export:export",
        "Write a trained policy's most probable actions as ONNX, to be run without torch.",
    ),
    "mission": (
        "cli_mission:mission",
        "Write an episode as a plan for vehicles: a file for each AUV, and what to do when.",
    ),
    "replay": (
        "cli_replay:replay",
        "Show an episode: as one page that plays it offline, and as a film.",
    ),
    "new": (
        "cli_new:new",
        "Write a scenario with every section, units, ranges and alternatives beside.",
    ),
    "schema": (
        "cli_json_schema:schema",
        "Print a JSON Schema of scenario files, by which editors complete and check them.",
    ),
    "reproduce": (
        "cli_studies:reproduce",
        "Run a study, by default the paper's, and write its report.",
    ),
    "report": (
        "cli_studies:report",
        "Write the report of a study's results once more: page, Markdown and figures.",
    ),
    "scenario": ("cli_scenario:scenario_app", "Make scenarios of what others have measured."),
}


class _Loaded(MutableMapping[str, Any]):
    """Commands by name, each imported when it is asked for: help of all needs none."""

    def __init__(self) -> None:
        self._known: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._known:
            module, _, item = COMMANDS[name][0].partition(":")
            with imports_uninterrupted():
                found = getattr(importlib.import_module(f"iout_marl.{module}"), item)
            if not isinstance(found, typer.Typer):
                alone = typer.Typer(**LOOKS)
                alone.command(name)(found)
                found = alone
            self._known[name] = typer.main.get_command(found)
            self._known[name].name = name
        return self._known[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._known[name] = command

    def __delitem__(self, name: str) -> None:
        del self._known[name]

    def __iter__(self) -> Iterator[str]:
        return iter(COMMANDS)

    def __len__(self) -> int:
        return len(COMMANDS)


class _Commands(TyperGroup):
    """All commands, none of which is imported before it is called."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _Loaded()

    def format_commands(self, ctx: Any, formatter: Any) -> None:  # noqa: ARG002 (Typer's names)
        """Write every command with the beginning of its help."""
        # As Typer does: three times the usual space beside the names.
        width = formatter.width - 6 - max(map(len, COMMANDS))
        rows = [(name, _shortened(text, width)) for name, (_, text) in COMMANDS.items()]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


def _shortened(text: str, width: int) -> str:
    """As much of a sentence as fits, in whole words."""
    if len(text) <= width:
        return text
    return f"{text[: width - 2].rsplit(' ', 1)[0]}..."


app = typer.Typer(
    cls=_Commands,
    help="AUVs that charge underwater sensor nodes by sound and collect their data.",
    **LOOKS,
)


def _print_version(value: bool) -> None:  # noqa: FBT001 (Typer calls it so)
    if value:
        present(__version__)
        raise typer.Exit


@app.callback()
def _options(
    *,
    version: Annotated[
        bool,
        typer.Option("--version", callback=_print_version, is_eager=True, help="Print it."),
    ] = False,
) -> None:
    """Options of every command."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Entry point: exit status 0, or 2 with one clear line for bad input.

    130 after Ctrl-C, and 141, as by SIGPIPE, where nobody reads standard output any more.
    """
    is_program = arguments is None
    status, line = _run(sys.argv[1:] if arguments is None else arguments)
    lost = finish_output()
    if lost is not None and not status:
        status, line = _status_of(lost)
    if line:
        complain(f"iout: {line}")
    if is_program:
        # All is done: from here on Ctrl-C has nothing to interrupt but Python's own end.
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.exit(status)


def _run(arguments: list[str]) -> tuple[int, str]:
    """Run a command line; its exit status, and the line that says what was wrong, if so."""
    try:
        startup.stop_guarding()
        prepare_streams()
        with inputs_noted(), notes_in_a_line():
            command = typer.main.get_command(app)
            with command.make_context("iout", list(arguments) or ["--help"]) as context:
                with imports_uninterrupted():
                    import numpy as np  # for which help need not wait

                # What is too large to compute with, results say: a warning would say it elsewhere.
                with np.errstate(all="ignore"):
                    command.invoke(context)
    except typer.Exit as ended:
        return ended.exit_code, ""
    except (KeyboardInterrupt, typer.Abort):
        return 130, "interrupted"
    except Exception as error:
        # What is nobody's input is a fault of this program's: for that, a traceback.
        if reason_of(error) is None:
            raise
        return _status_of(error)
    return 0, ""


def _status_of(error: Exception) -> tuple[int, str]:
    # Whoever reads standard output, `head` say, has seen enough.
    return (141, "") if isinstance(error, BrokenPipeError) else (2, reason_of(error) or "")


if __name__ == "__main__":
    main()
