"""Every registered part keeps the contracts of its role."""

import pytest
from batteries import BATTERY
from current_files import ORIGIN, WIDE
from loss_tables import by_cells, by_range_and_depth
from seas import ERRORS, GUSTS, SHADOWING, WIND

from iout_marl.parts import Part, currents
from iout_marl.registry import registries
from iout_marl.testing import check_part

pytestmark = pytest.mark.slow

#: Two: as many environments as no world has AUVs or nodes.
SEEDS = (0, 12345)
CELLS = [[1, 1, 1], [4, 3, 2], [2, 3, 1], [4, 1, 1]]
#: Levels of pressures, and energies that bind in them.
SEA = {"channel": {"kind": "sonar", "spreading_factor": 2.0}, "charging.power_w": 2000}
APERTURE = {"area_m2": 0.05, "efficiency": 0.6}
MODEM = {
    "bit_rate_bps": 3000.0,
    "packet_bits": 2048.0,
    "bandwidth_hz": 4500.0,
    "electronics_w": 0.8,
    "maximum_source_level_db": 118.0,
}


def without_kind(settings):
    return {key: value for key, value in settings.items() if key != "kind"}


HULL = without_kind(BATTERY)
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
    ("vehicle", "battery"): [
        {**HULL, "docks": [[1, 1, 1], [2, 2, 1]], "dock_power_w": 2000.0},
        {**HULL, "initial_share": 0.5, "hotel_w": 0.0},
    ],
    ("current", "uniform"): [
        {"speed_m_per_s": 1.5, "toward_deg": 30.0},
        {"speed_m_per_s": 3.0, "toward_deg": 200.0},
    ],
    ("current", "shear"): [{"speed_m_per_s": 4.0, "toward_deg": 90.0, "depth_scale_m": 80.0}],
    ("current", "tide"): [{"speed_m_per_s": 4.9, "toward_deg": 120.0, "period_h": 0.1}],
    ("current", "gauss_markov"): [
        {
            "speed_m_per_s": 2.0,
            "toward_deg": 10.0,
            "sigma_m_per_s": 0.9,
            "time_constant_h": 0.02,
        },
    ],
    ("current", "file"): [{"file": WIDE, "start_h": 0.5}, {"file": WIDE, "repeats": True}],
    ("current", "vortex"): [
        {"circulation_m2_per_s": 2000.0, "core_radius_m": 60.0, "center_m": [100.0, 100.0]}
    ],
    ("current", "double_gyre"): [
        {"amplitude_m_per_s": 3.0, "period_h": 0.1},
        {"amplitude_m_per_s": 3.0, "epsilon": 0.0},
    ],
    ("storage", "capacitor"): [
        {"capacity_j": 900.0},
        {"capacity_j": 300.0, "initial_j": 200.0, "leakage_w": 0.5, "idle_w": 2.0},
    ],
    ("optimizer", "torch"): [
        {"name": "AdamW", "options": {"weight_decay": 0.01}},
        {"name": "SGD", "options": {"momentum": 0.9}},
    ],
    ("channel", "sonar"): [{"absorption": {"kind": "francois_garrison"}, "wind_m_per_s": 5.0}],
    ("transmission", "range_depth"): [
        {"tables": [by_range_and_depth([40.0, 30.0])], "top_depth_m": 12.0}
    ],
    ("transmission", "cells"): [{"tables": [by_cells([40.0, 30.0], (4, 3, 2))]}],
    ("harvester", "hydrophone"): [
        {
            "sensitivity_db": -150,
            "efficiency": 0.7,
            "hydrophones": 2,
            "load_resistance_ohm": 125,
            "area_m2": 0.02,
        }
    ],
    ("harvester", "aperture"): [{**APERTURE, "threshold_w": 1e-3}],
    ("hearing", "polling"): [{"max_nodes_per_slot": 1}, {"max_nodes_per_slot": 3}],
    ("fading", "shadowing"): [without_kind(SHADOWING), {"sigma_db": 9.0, "coherence_s": 5.0}],
    ("wind", "gauss_markov"): [without_kind(GUSTS)],
    ("wind", "series"): [{"file": WIND}],
    ("loss", "table"): [{"file": ERRORS}],
    ("uplink", "shannon"): [{"packet_bits": 30000, "bandwidth_hz": 3000}],
    ("uplink", "modem"): [MODEM, {**MODEM, "power_control": False}],
}
#: Of a battery that lasts for a while, and of a vehicle that some currents are too strong for.
MOTOR = {**BATTERY, "max_speed_m_per_s": 4.5}
#: What else a scenario needs for a kind to have something to do.
OVERRIDES = {
    ("observation entry", "transit"): {"episode.slot_s": 10},
    ("observation entry", "battery"): {"vehicle": BATTERY},
    ("observation entry", "batteries"): {
        "vehicle": BATTERY,
        "auvs.count": 3,
    },
    ("observation entry", "current"): {
        "vehicle": MOTOR,
        "current": {"kind": "tide", "speed_m_per_s": 1.0, "toward_deg": 30.0},
    },
    **{("current", kind): {"vehicle": MOTOR, "grid.origin": ORIGIN} for kind in currents.kinds},
    ("network", "set"): {"observation": "table"},
    ("observation entry", "unseen_for"): {"observation.view_range_m": 150},
    ("transmission", "formula"): SEA,
    ("transmission", "range_depth"): SEA,
    ("transmission", "cells"): SEA,
    ("harvester", "hydrophone"): SEA,
    ("harvester", "aperture"): SEA,
    ("hearing", "polling"): {
        **SEA,
        "harvester": {"kind": "aperture", **APERTURE},
        "uplink": {"kind": "modem", **MODEM},
    },
    **{("wind", kind): {"channel.wind_m_per_s": 8.0} for kind in ("series", "gauss_markov")},
    ("uplink", "modem"): {**SEA, "harvester": {"kind": "aperture", **APERTURE}},
    ("beta rule", "airtime"): {
        **SEA,
        "harvester": {"kind": "aperture", **APERTURE},
        "uplink": {"kind": "modem", **MODEM},
        "duplex.beta_rule": "airtime",
    },
}
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
    check_part(role, kind, settings, overrides=OVERRIDES.get((role, kind), ()), seeds=SEEDS)
