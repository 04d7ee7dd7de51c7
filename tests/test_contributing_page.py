"""The six changes of CONTRIBUTING.md are complete: each is made, and passes what it must."""

import re
import sys
import types
from pathlib import Path

import pytest

from iout_marl import evaluate, metrics
from iout_marl.bounds import delivery_bound
from iout_marl.metrics import builtin
from iout_marl.policies import baselines
from iout_marl.registry import registry_of
from iout_marl.testing import check_part

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
BLOCK = re.compile(r"^```python\n# (\S+?\.py)[^\n]*\n(.*?)^```", re.MULTILINE | re.DOTALL)
#: The code of each change, by the file that it is written to.
CHANGES = dict(BLOCK.findall(PAGE))
PARTS = {
    "iout_marl/parts/reward/peak_age.py": ("reward", "peak_age", {"weight": 2.0}),
    "iout_marl/parts/motion/level.py": ("motion", "level", {}),
    "iout_marl/parts/entry/oldest_age.py": ("observation entry", "oldest_age", {}),
    "iout_marl/parts/access/two_at_once.py": ("access", "two_at_once", {}),
}
METRIC, BASELINE = "iout_marl/metrics/builtin.py", "iout_marl/policies/baselines.py"


def test_there_are_six_changes_to_files_in_their_places():
    assert set(CHANGES) == {*PARTS, METRIC, BASELINE}
    assert all((ROOT / path).parent.is_dir() for path in CHANGES)


@pytest.mark.slow
@pytest.mark.parametrize("path", PARTS)
def test_a_part_keeps_the_contracts_of_its_role(path, forgotten_parts, monkeypatch):
    role, kind, settings = PARTS[path]
    module = types.ModuleType(path.removesuffix(".py").replace("/", "."))
    monkeypatch.setitem(sys.modules, module.__name__, module)
    exec(compile(CHANGES[path], path, "exec"), vars(module))
    entry = registry_of(role)[kind]
    assert not entry.is_outside
    assert (entry.item.__doc__ or "").endswith(".")
    check_part(role, kind, settings, seeds=(0,))


def test_a_metric_is_computed_and_described(forgotten_metrics):
    found = eval(compile(CHANGES[METRIC], METRIC, "eval"), vars(builtin))
    assert found.name not in {metric.name for metric in metrics.registered()}
    register = metrics.register(found.name, unit=found.unit, definition=found.definition)
    register(found.function)
    values = evaluate("paper/k3-fdd", "greedy", 4).metrics
    assert values["mean_aoi"].mean < values[found.name].mean


def test_a_baseline_plays(monkeypatch):
    scope = dict(vars(baselines))
    exec(compile(CHANGES[BASELINE], BASELINE, "exec"), scope)
    policy = scope["OldestFirst"]()
    assert policy.name == "oldest-first"
    for name in ("paper/k3-fdd", "multi/m3-k10-tdd"):
        oldest, others = (
            evaluate(name, each, 5).metrics["mean_aoi"].mean for each in (policy, "round-robin")
        )
        assert oldest >= delivery_bound(name)
        assert oldest != others
