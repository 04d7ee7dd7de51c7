"""What docs/extending.md says is so: its code runs, and every role of parts has its row."""

import re
from pathlib import Path

import pytest

from iout_marl import load_scenario, parts
from iout_marl.registry import registries
from iout_marl.scenario.yaml_values import read_yaml

PAGE = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)
#: Each snippet by the heading above it.
HEADINGS = [
    re.findall(r"^## (.*)$", PAGE[: PAGE.index(snippet)], flags=re.MULTILINE)[-1]
    for snippet in SNIPPETS
]
ROW = r"^\| {role} \| `parts\.(\w+)` \| `parts\.(\w+)` \| `([\w.]+)` \|"


@pytest.fixture(autouse=True)
def _as_before(forgotten_metrics):
    """What the page registers is forgotten."""
    known = {registry: registry.kinds for registry in registries()}
    yield
    for registry, kinds in known.items():
        for kind in set(registry.kinds) - set(kinds):
            registry.unregister(kind)


@pytest.mark.slow
@pytest.mark.parametrize("snippet", SNIPPETS, ids=HEADINGS)
def test_its_code_runs(snippet, capsys):
    exec(compile(snippet, "docs/extending.md", "exec"), {"__name__": "extending_page"})
    for line in capsys.readouterr().out.splitlines():
        assert "as stated by part" in line or float(line) > 0


def test_the_scenario_of_the_first_example_can_be_loaded():
    (text,) = re.findall(r"^```yaml\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)
    exec(SNIPPETS[0], {"__name__": "extending_page"})
    reward = load_scenario(read_yaml(text, "example")[0]).reward
    assert (reward.kind, reward.weight, reward.entry.version) == ("peak_age", 2, 1)


@pytest.mark.parametrize(
    "registry", [r for r in registries() if r.in_scenarios], ids=lambda registry: registry.role
)
def test_every_role_has_a_row(registry):
    (row,) = re.findall(ROW.format(role=registry.role), PAGE, flags=re.MULTILINE)
    name, base, key = row
    assert getattr(parts, name) is registry
    assert getattr(parts, base) is registry.base
    overrides = {"observation.entries": ["time"], "duplex": {"kind": "tdd", "beta_rule": "airtime"}}
    settings = load_scenario("sea/bay", overrides)
    for word in key.split("."):
        settings = getattr(settings, word)
    first = settings[0] if isinstance(settings, tuple) else settings
    assert first.entry.role == registry.role


def test_links_within_the_page_lead_somewhere():
    headings = re.findall(r"^## (.*)$", PAGE, flags=re.MULTILINE)
    anchors = {heading.lower().replace(" ", "-").replace(",", "") for heading in headings}
    assert set(re.findall(r"\]\(#([\w-]+)\)", PAGE)) <= anchors
