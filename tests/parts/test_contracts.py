"""Every registered part keeps the contracts of its role."""

import pytest

from iout_marl.parts import Part
from iout_marl.registry import registries
from iout_marl.testing import check_part

pytestmark = pytest.mark.slow

CELLS = [[1, 1, 1], [4, 3, 2], [2, 3, 1], [4, 1, 1]]
#: Settings of kinds that need some, and more of kinds that do more by them.
SETTINGS = {
    ("placement", "fixed"): [{"cells": CELLS}, {"cells": CELLS, "weights": [1, 2, 0, 1.5]}],
    ("placement", "random"): [{"count": 4}, {"count": 4, "redraw": "run"}],
    ("reward", "paper"): [
        {},
        {"credit": "difference"},
        {"unserved_penalty": 1.5, "no_able_node_penalty": 2.0, "only_transmitting_penalty": -1.0},
    ],
    ("reward", "mean_age"): [{"fairness_weight": 3.0}, {"credit": "difference"}],
    ("duplex", "tdd"): [{}, {"synchronised": True, "beta_rule": "stored"}],
    ("optimizer", "torch"): [
        {"name": "AdamW", "options": {"weight_decay": 0.01}},
        {"name": "SGD", "options": {"momentum": 0.9}},
    ],
    ("channel", "sonar"): [{"absorption": {"kind": "francois_garrison"}, "wind_m_per_s": 5.0}],
}
#: What else a scenario needs for a kind to have something to do.
OVERRIDES = {("observation entry", "unseen_for"): {"observation.view_range_m": 150}}
CASES = [
    pytest.param(registry.role, entry.kind, settings, id=f"{registry.role}-{entry.kind}-{i}")
    for registry in registries()
    if registry.base is not None and issubclass(registry.base, Part)
    for entry in registry
    if not entry.is_outside
    for i, settings in enumerate(SETTINGS.get((registry.role, entry.kind), [{}]))
]


@pytest.mark.parametrize(("role", "kind", "settings"), CASES)
def test_contracts(role, kind, settings):
    check_part(role, kind, settings, overrides=OVERRIDES.get((role, kind), ()))
