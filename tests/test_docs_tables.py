"""Tables that pages have from the software are as it is now, and tell of all that there is."""

import importlib.util
import re
import sys
from pathlib import Path

import pytest
import typer

from iout_marl import load_scenario, metrics
from iout_marl.cli import app
from iout_marl.envs.episodes import INFO_KEYS
from iout_marl.registry import registries
from iout_marl.scenario import member_names
from iout_marl.scenario.yaml_values import read_yaml

ROOT = Path(__file__).parents[1]
SPEC = importlib.util.spec_from_file_location("tables", ROOT / "docs" / "tables.py")
TABLES = importlib.util.module_from_spec(SPEC)
sys.path.insert(0, str(ROOT / "docs"))  # what the script imports lies beside it
SPEC.loader.exec_module(TABLES)
sys.path.remove(str(ROOT / "docs"))
PAGE = (ROOT / "docs" / "scenario.md").read_text(encoding="utf-8")
EXAMPLES = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES.TABLES)
def test_is_fresh(name):
    page, _ = TABLES.TABLES[name]
    assert TABLES.written(name) == page.read_text(encoding="utf-8"), "run make docs"


def test_is_made_by_make_docs():
    assert "docs/tables.py" in (ROOT / "Makefile").read_text()


def test_every_metric_has_a_row():
    assert TABLES.metrics_table().count("\n") == 2 + len(metrics.ALL)


@pytest.mark.parametrize(
    "registry", [r for r in registries() if r.in_scenarios], ids=lambda registry: registry.role
)
def test_every_kind_has_a_row(registry):
    _, _, kinds = PAGE.partition(f"## Kinds of {registry.role}\n")
    rows = re.findall(r"^\| `(\w+)` \|", kinds.partition("\n#")[0], flags=re.MULTILINE)
    assert rows == list(registry.kinds)


def test_every_command_is_explained():
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    commands = typer.main.get_command(app).commands
    for name, command in commands.items():
        for each in [f"{name} {inner}" for inner in getattr(command, "commands", {})] or [name]:
            assert f"\n## `iout {each}`\n" in page


def test_every_info_has_a_row():
    page = (ROOT / "docs" / "environment.md").read_text(encoding="utf-8")
    _, _, infos = page.partition("\n### Infos\n")
    assert re.findall(r"^\| `(\w+)` \|", infos, flags=re.MULTILINE) == list(INFO_KEYS)


def test_the_example_can_be_loaded():
    text, _ = EXAMPLES
    scenario = load_scenario(read_yaml(text, "example")[0])
    assert (scenario.num_nodes, scenario.auvs.motion.kind) == (12, "hover")


def test_the_family_can_be_loaded(tmp_path):
    (tmp_path / "teams.yaml").write_text(EXAMPLES[1], encoding="utf-8")
    names = member_names(tmp_path / "teams.yaml")
    scenarios = [load_scenario(name) for name in names]
    assert [scenario.num_auvs for scenario in scenarios] == [1] * 4 + [2] * 4 + [3] * 2
    assert "teams/m2-fdd-loud" in {scenario.name for scenario in scenarios}
    assert scenarios[1].description == "1 AUVs, fdd, loud sea"
    assert scenarios[0].training.steps == 1_000_000 < scenarios[1].training.steps


def test_links_within_the_page_lead_somewhere():
    headings = re.findall(r"^## (.*)$", PAGE, flags=re.MULTILINE)
    anchors = {heading.lower().replace(" ", "-").replace("`", "") for heading in headings}
    assert set(re.findall(r"\(#([\w-]+)\)", PAGE)) <= anchors
