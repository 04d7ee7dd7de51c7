"""The commands that make scenarios of what others have measured."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from iout_marl.cli_looks import LOOKS
from iout_marl.cli_new import named_in, new_scenario_file
from iout_marl.cli_options import Imports, Overrides, expanded, file, take
from iout_marl.errors import InputError
from iout_marl.files import write_text
from iout_marl.mission.from_nodes import Extended, described, scenario_data, snap
from iout_marl.mission.node_files import read_nodes
from iout_marl.outside import import_words
from iout_marl.scenario import find_scenario, load_scenario
from iout_marl.scenario.layers import overrides_layer
from iout_marl.scenario.loading import dump_yaml
from iout_marl.terminal import present
from iout_marl.words import listed

scenario_app = typer.Typer(**LOOKS)


@scenario_app.callback()
def _group() -> None:
    """Make scenarios of what others have measured."""


@scenario_app.command("from-nodes")
def from_nodes(
    nodes: Annotated[
        str,
        typer.Argument(
            metavar="FILE",
            parser=expanded,
            help="CSV or GeoJSON: latitude, longitude and depth, or x, y and z in m.",
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", parser=file, help="The scenario to write.")],
    source: Annotated[
        str,
        typer.Option(
            "--from", metavar="SCENARIO", parser=expanded, help="What it extends: a name or a path."
        ),
    ] = "paper/k10-fdd",
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Make a scenario of nodes that are somewhere, each in the cell that it lies in.

    The grid is that of the scenario with its grid.origin; where it has none, it is laid around
    nodes that have latitudes and longitudes. --set grid.spacing_m=50 makes its cells smaller.
    """
    take(imports)
    out = new_scenario_file(out)
    found, layer = find_scenario(source), overrides_layer(overrides or [])
    extended = Extended.from_source(source, layer)
    path = Path(nodes)
    read = read_nodes(path)
    keeps_cells = "cells" in layer.data.get("grid", {})
    snapped = snap(read, extended.bare, keeps_cells=keeps_cells)
    # What is wrong with it shows before it is written.
    try:
        load_scenario(scenario_data(snapped, extended, str(found.absolute()), path.name))
    except InputError as error:
        raise InputError(f"{path}: {str(error).removeprefix('mapping: ')}") from None
    data = scenario_data(snapped, extended, named_in(out, found), path.name)
    summary = described(path, snapped, extended.moved_start(snapped.grid))
    write_text(out, f"# {summary}.\n{dump_yaml(data)}".rstrip("\n"))
    table = Table()
    for heading in ("node", "from", "cell", "moved by m"):
        table.add_column(heading, justify="left" if heading == "from" else "right")
    for number, (place, cell, moved_m) in enumerate(
        zip(read.places, snapped.cells.tolist(), snapped.moved_m, strict=True), start=1
    ):
        table.add_row(str(number), place, ", ".join(map(str, cell)), f"{moved_m:.1f}")
    present(table)
    for cell, numbers in snapped.shared.items():
        present(f"note: nodes {listed(list(map(str, numbers)))} are in one cell, {list(cell)}")
    words = ["iout", "train", str(out), *import_words()]
    present(f"{out}: written: {summary}; then: {shlex.join(words)}")
