"""The commands that show scenarios."""

from __future__ import annotations

from typing import Annotated

import typer
from rich.table import Table
from rich.text import Text

from iout_marl.cli_options import Imports, Overrides, ScenarioArgument, take
from iout_marl.outlook import energy_outlook
from iout_marl.scenario import bundled_names, load_scenario, to_yaml
from iout_marl.scenario.explanation import explanation
from iout_marl.terminal import present


def scenarios() -> None:
    """List the bundled scenarios."""
    rows = [("scenario", "nodes", "AUVs", "duplex", "reward", "")]
    for name in bundled_names():
        s = load_scenario(name)
        sizes = str(s.num_nodes), str(s.num_auvs)
        rows.append((name, *sizes, s.duplex.kind, s.reward.kind, s.description))
    table = Table(box=None, pad_edge=False)
    for heading, *cells in zip(*rows, strict=True):
        # Only the description, under no heading, is folded where there is little room.
        width = max(map(len, (heading, *cells))) if heading else 20
        is_number = heading in ("nodes", "AUVs")
        table.add_column(heading, justify="right" if is_number else "left", min_width=width)
    for row in rows[1:]:
        table.add_row(*map(Text, row))
    present(table)


def show(
    scenario: ScenarioArgument,
    *,
    explain: Annotated[
        bool,
        typer.Option("--explain", help="Say of every key what it means, with unit and range."),
    ] = False,
    overrides: Overrides = None,
    imports: Imports = None,
) -> None:
    """Print a whole scenario, after `extends`, preset and overrides, as YAML."""
    take(imports)
    loaded = load_scenario(scenario, overrides or [])
    hashes = f"# hash {loaded.hash}, of the world alone {loaded.world_hash}"
    outlook = energy_outlook(loaded)
    notes = f"{hashes}\n# {outlook}" if outlook else hashes
    body = explanation(loaded) if explain else to_yaml(loaded)
    present(f"{notes}\n{body}".rstrip("\n"))
