"""Bundled scenarios are published: their hashes, texts, episodes and metrics do not change."""

import json
import re

import numpy as np
import pytest
from recording import RECORDED, machine, record_scenario

from iout_marl import bundled_names

RECORDING = json.loads(RECORDED.read_text(encoding="utf-8"))
#: Digests of floating-point numbers: the same on the same kind of machine alone.
IS_SAME_MACHINE = RECORDING["machine"] == machine()
#: Those of the paper and the smallest are compared in `make quick`, too.
NAMES = [
    pytest.param(name, marks=() if re.match("paper/|.*k3", name) else pytest.mark.slow, id=name)
    for name in sorted(RECORDING["scenarios"])
]


def test_every_bundled_scenario_is_recorded():
    assert sorted(RECORDING["scenarios"]) == sorted(bundled_names())


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_scenario_is_as_recorded(name):
    recorded, found = RECORDING["scenarios"][name], record_scenario(name)
    for what in ("hash", "world_hash", "yaml"):
        assert found[what] == recorded[what]
    for played in ("random actions", "greedy"):
        then, now = recorded[played], found[played]
        assert now["whole"] == then["whole"]
        if IS_SAME_MACHINE:
            assert now["real"] == then["real"]
        for what in ("sums", "energy_j"):
            # Stores that are spent hold what rounding leaves: that of 500 J, in fact.
            rounding = 1e-12 * np.abs(then[what]).max()
            np.testing.assert_allclose(now[what], then[what], rtol=1e-12, atol=rounding)
        assert now["metrics"].keys() >= then["metrics"].keys()
        for metric, values in then["metrics"].items():
            np.testing.assert_allclose(now["metrics"][metric], values, rtol=1e-12)
