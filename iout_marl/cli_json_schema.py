"""The command that prints the JSON Schema of scenario files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from iout_marl.cli_options import Imports, json_target, take
from iout_marl.files import to_json, write_text
from iout_marl.scenario.json_schema import json_schema
from iout_marl.terminal import present


def schema(
    output: Annotated[
        Path | None,
        typer.Option(metavar="FILE", parser=json_target, help="Write it there; - prints it [-]."),
    ] = None,
    imports: Imports = None,
) -> None:
    """Print a JSON Schema of scenario files, by which editors complete and check them.

    YAML editors take it from a first line `# yaml-language-server: $schema=FILE`.
    """
    take(imports)
    text = to_json(json_schema(), indent=2)
    if output is None or str(output) == "-":
        present(text)
    else:
        write_text(output, text)
