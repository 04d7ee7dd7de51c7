"""Scenarios: YAML files that say all that changes a result."""

from iout_marl.scenario.layers import show_file
from iout_marl.scenario.loading import load_scenario, parse_scenario, to_yaml
from iout_marl.scenario.schema import Scenario, Training
from iout_marl.scenario.sections import (
    Fdd,
    FixedNodes,
    MeanAgeReward,
    PaperChannel,
    PaperReward,
    RandomNodes,
    SonarChannel,
    Tdd,
)
from iout_marl.scenario.sources import bundled_names, bundled_root, find_scenario

__all__ = [
    "Fdd",
    "FixedNodes",
    "MeanAgeReward",
    "PaperChannel",
    "PaperReward",
    "RandomNodes",
    "Scenario",
    "SonarChannel",
    "Tdd",
    "Training",
    "bundled_names",
    "bundled_root",
    "find_scenario",
    "load_scenario",
    "parse_scenario",
    "show_file",
    "to_yaml",
]
