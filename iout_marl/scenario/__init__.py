"""Scenarios: YAML files with every setting that affects results."""

from iout_marl.scenario.layers import Overrides
from iout_marl.scenario.loading import AnyScenario, load_scenario, parse_scenario, to_yaml
from iout_marl.scenario.naming import bundled_names, find_scenario, member_names
from iout_marl.scenario.places import show_file
from iout_marl.scenario.schema import Scenario
from iout_marl.scenario.sources import bundled_root
from iout_marl.scenario.training import Training

__all__ = [
    "AnyScenario",
    "Overrides",
    "Scenario",
    "Training",
    "bundled_names",
    "bundled_root",
    "find_scenario",
    "load_scenario",
    "member_names",
    "parse_scenario",
    "show_file",
    "to_yaml",
]
