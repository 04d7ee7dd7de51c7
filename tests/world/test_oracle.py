"""The world against the oracle, slot by slot over whole episodes of biased random actions.

Whatever an episode is meant to exercise must have happened in it: its case names it.
"""

import functools

import numpy as np
import pytest
import torch
from batteries import BATTERY, DOCKS
from current_files import ORIGIN, WIDE
from loss_tables import by_cells, by_range_and_depth
from oracle_episodes import ENVS, Case, codes, play

from iout_marl.scenario import bundled_names
from iout_marl.scenario.data_files import DataFile
from iout_marl.world import World

ALWAYS = {"delivery", "no delivery", "left grid", "capped age", "overserved node"}
FDD = ALWAYS | {"no able node", "wrong node"}
TDD = ALWAYS | {"only charging", "only transmitting", "both"}
SHARED = {"kept apart", "shared charging", "contested uplink", "contest at equal distance"}
DISTURBED = {"disturbed uplink", "silenced uplink"}
#: In TDD nobody is the one choice.
IDLE_FDD, IDLE_TDD = {"nobody charged", "nobody heard", "idle"}, {"idle"}
NOBODY = {"auvs.idle_choices": True}

TWO_AUVS = {"auvs.start_cells": [[5, 5, 2], [1, 2, 1]]}
THREE_AUVS = {"auvs.start_cells": [[5, 5, 2], [1, 2, 1], [3, 1, 2]]}
THREE_WEIGHTS = {"nodes.weights": [0.5, 2.0, 0.0]}
#: Cells of 2 m in slots of 25 s: what 10 k_s log₁₀ d leaves within reach.
EQUATION = {"channel.kind": "equation", "grid.spacing_m": 2, "auvs.speed_m_per_s": 0.08}
#: Cells of 0.3 m: neighbours are too near for any spreading.
TINY_CELLS = {"grid.spacing_m": 0.3, "auvs.speed_m_per_s": 0.012, "age.maximum": 15}
SMALL_GRID = {
    "grid.cells": [3, 2, 2],
    "nodes.cells": [[1, 1, 1], [3, 2, 2], [2, 1, 2]],
    "auvs.start_cells": [[2, 2, 1]],
    "age.maximum": 12,
}
#: Flat cells in which three layers are as far apart as two neighbours, and none is a cube's.
FLAT_CELLS = {"grid.spacing_m": [90, 120, 30], "auvs.speed_m_per_s": 4.8}
#: Tall ones, whose own cells are wide.
TALL_CELLS = {"grid.spacing_m": [60, 70, 150], "grid.own_cell_distance": "mean"}
RANDOM_NODES = {"nodes": {"kind": "random", "count": 4}, "observation.node_positions": True}
#: Packets whose price rises steeply as the time for them shrinks.
LARGE_PACKETS = {"uplink.packet_bits": 30000, "charging.power_w": 60000}
#: So steeply that even near nodes, for which β_min is ample, cannot pay at β_max.
STEEP_PACKETS = {"uplink.packet_bits": 60000, "channel.noise_level_db": 12.0}
#: Packets that need an SNR of about 1: uplinks side by side hardly bear one another.
LOUD = {"uplink.packet_bits": 60000, "charging.power_w": 900000}
COLD = {"channel.absorption": {"kind": "francois_garrison", "temperature_c": 4.0}}
WARM = {
    "channel.absorption": {
        "kind": "francois_garrison",
        "temperature_c": 27.0,
        "salinity_psu": 33.0,
        "depth_m": 10.0,
        "ph": 8.1,
    }
}
#: Sonar with a poor projector in rough water, which leaves energy to be short of.
SONAR = {
    "channel": {
        "kind": "sonar",
        "shipping": 0.8,
        "wind_m_per_s": 12.0,
        "uplink_efficiency": 0.01,
        "uplink_directivity_index_db": -20.0,
    },
    "uplink.packet_bits": 7500,
    "harvester.sensitivity_db": -177,
}
TWO_SMALL = {"auvs.start_cells": [[2, 2, 1], [3, 1, 2]]}


def by_depth(frequencies_khz, **channel):
    """Losses of a table by range and depths."""
    tables = [by_range_and_depth(frequencies_khz)]
    transmission = {"kind": "range_depth", "tables": tables, "top_depth_m": 7.0}
    own = {**SONAR["channel"], **channel, "transmission": transmission}
    return {**SONAR, "harvester.sensitivity_db": -140, "channel": own}


def by_cell(*frequencies_khz):
    """Losses of a table for each pair of cells, one file after the other."""
    tables = [by_cells(each, SMALL_GRID["grid.cells"]) for each in frequencies_khz]
    own = {**SONAR["channel"], "transmission": {"kind": "cells", "tables": tables}}
    return {**SONAR, "harvester.sensitivity_db": -165, "channel": own, **SMALL_GRID}


#: Stores that are soon full and soon empty again.
CAPACITOR = {
    "storage": {
        "kind": "capacitor",
        "capacity_j": 400.0,
        "initial_j": 70.0,
        "leakage_w": 0.1,
        "idle_w": 0.3,
    }
}
PENALTIES = {"reward.vehicle_energy_penalty_per_kj": 0.02, "reward.stranded_penalty": 3.0}
ON_BATTERY = {"vehicle": BATTERY, **PENALTIES}
DOCKED = {"vehicle": {**BATTERY, **DOCKS}, **PENALTIES}
#: Enough for an episode.
AMPLE = {**BATTERY, "capacity_j": 1e8, "initial_share": 1.0}
#: Powers in currents are interpolated in a table.
TABULATED = 1e-6
HELD, ADRIFT = {"water: holding"}, {"water: drifting", "water: aground"}


def in_current(current, max_speed_m_per_s):
    """A current that an AUV sees, and a vehicle with a battery in it."""
    return {
        "current": current,
        "vehicle": {**AMPLE, "max_speed_m_per_s": max_speed_m_per_s},
        "observation.entries": ["current"],
    }


TIRED = {"vehicle stranded", "vehicle refused"}
STORES = {"spilled", "starved"}
SLEEPERS = STORES | {"asleep when heard"}
#: So small that they cannot hold what a slot's charging is meant to pay for.
TINY_STORES = {"storage": {**CAPACITOR["storage"], "capacity_j": 90.0}}
#: Cells of 10 m in rough water, in which a loud modem spends as much on sound as on electronics.
MODEM = {
    "grid.spacing_m": 10,
    "auvs.speed_m_per_s": 0.2,
    "episode.duration_s": 5000,
    "charging.power_w": 100,
    "channel": {
        "kind": "sonar",
        "spreading_factor": 2.0,
        "shipping": 0.8,
        "wind_m_per_s": 12.0,
        "uplink_efficiency": 0.1,
        "uplink_directivity_index_db": -10.0,
    },
    "harvester": {"kind": "aperture", "area_m2": 0.03, "efficiency": 0.6},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 3000.0,
        "packet_bits": 8000.0,
        "bandwidth_hz": 4500.0,
        "electronics_w": 0.8,
        "maximum_source_level_db": 151.0,
        "required_snr_db": 30.0,
    },
}
#: A sea that changes, and modems that need so little that bit errors show, too.
SHADOWING = {"kind": "shadowing", "sigma_db": 3.0, "coherence_s": 400.0}
GUSTS = {"kind": "gauss_markov", "sigma_m_per_s": 5.0, "coherence_s": 900.0}
WIND = DataFile("wind.csv", b"time_s,wind_m_per_s\n0,12\n1500,2\n3000,18\n6000,9\n")
ERRORS = DataFile("errors.csv", b"snr_db,packet_error_rate\n20,1\n25,0.6\n28,0.2\n40,0.05\n")
ROUGH_MODEM = {
    **MODEM,
    "channel.fading": SHADOWING,
    "uplink": {
        **MODEM["uplink"],
        "required_snr_db": 7.0,
        "maximum_source_level_db": 128.0,
        "margin_db": 1.0,
        "loss": "bpsk",
    },
}
MODEM_TDD = {**MODEM, "duplex.beta_rule": "airtime"}
#: The same for modems: a few packets' worth, and a draw of milliwatts.
MODEM_STORES = {
    "kind": "capacitor",
    "capacity_j": 9.0,
    "initial_j": 4.0,
    "leakage_w": 2e-3,
    "idle_w": 6e-3,
}
#: Modems that leave time for several packets a slot, and others that hardly do.
QUICK_MODEM = {**MODEM, "charging.power_w": 400}
SLOW_MODEM = {
    **MODEM,
    "charging.power_w": 1500,
    "uplink": {**MODEM["uplink"], "bit_rate_bps": 800.0, "electronics_w": 0.1},
}
POLL = {"kind": "polling"}
POLLS = {"polled", "polled in the place of the chosen", "polled after the chosen"}
#: No number as in the bundled scenarios, none equal to another one that it could be.
OTHER_HARDWARE = {
    "grid.spacing_m": 130,
    "auvs.speed_m_per_s": 1.7,
    "episode.duration_s": 7000,
    "channel.spreading_factor": 1.2,
    "channel.noise_level_db": 27.0,
    "charging": {"power_w": 60, "efficiency": 0.4, "directivity_index_db": 23.0},
    "harvester": {
        "sensitivity_db": -151.0,
        "efficiency": 0.6,
        "hydrophones": 3,
        "load_resistance_ohm": 90,
    },
    "uplink": {"packet_bits": 170, "bandwidth_hz": 3600},
    "age.maximum": 20,
    "fairness.minimum_jain": 0.4,
    "reward.location_penalty": 7.0,
    "reward.occurrence_penalty": 6.0,
}

CASES = {
    **{f"paper/k{k}-fdd": Case(f"paper/k{k}-fdd", FDD) for k in (3, 5, 7, 10)},
    **{f"paper/k{k}-tdd": Case(f"paper/k{k}-tdd", TDD) for k in (3, 5, 7, 10)},
    "best/k3-tdd": Case("best/k3-tdd", TDD | {"least charging"}),
    "best/k10-tdd": Case("best/k10-tdd", TDD | {"least charging"}),
    "mean-age-with-weights": Case(
        "paper/k3-fdd", FDD, {"reward": {"kind": "mean_age"}, **THREE_WEIGHTS}
    ),
    "mean-age-and-fairness": Case(
        "best/k5-tdd", TDD | {"least charging"}, {"reward.fairness_weight": 7.5}
    ),
    "paper-reward-with-weights": Case(
        "paper/k3-tdd", TDD, {"reward.age_weight": 1.5, **THREE_WEIGHTS}
    ),
    "unserved-penalty": Case("paper/k5-fdd", FDD, {"reward.unserved_penalty": 2.0}),
    "two-penalties-for-a-failed-uplink": Case(
        "paper/k5-fdd", FDD, {"reward.no_able_node_penalty": 1.0, "reward.wrong_node_penalty": 8.0}
    ),
    "bonus-for-only-transmitting": Case(
        "paper/k5-tdd",
        TDD,
        {"reward.only_transmitting_penalty": -2.0, "reward.only_charging_penalty": 3.0},
    ),
    "two-auvs-fdd": Case(
        "paper/k3-fdd",
        FDD | SHARED,
        {"reward.no_able_node_penalty": 1.0, "reward.wrong_node_penalty": 8.0, **TWO_AUVS},
    ),
    "two-auvs-tdd": Case("paper/k3-tdd", TDD | SHARED, TWO_AUVS),
    "table": Case("paper/k5-fdd", FDD, {"observation": "table"}),
    "table-of-a-team": Case(
        "best/k5-tdd",
        TDD | SHARED | {"least charging"},
        {"observation": {"kind": "table", "view_range_m": 300}, **THREE_AUVS},
    ),
    "two-of-three-starts": Case("paper/k5-fdd", FDD | SHARED, {**THREE_AUVS, "auvs.count": 2}),
    "spread-starts-and-hover": Case(
        "paper/k5-fdd", FDD | SHARED, {"auvs.count": 4, "auvs.motion": "hover"}
    ),
    "auvs-without-separation": Case(
        "paper/k5-fdd",
        FDD | SHARED - {"kept apart"},
        {"auvs.separation_cells": 0, "reward.location_penalty": 3.0, **THREE_AUVS},
    ),
    "auvs-far-apart": Case(
        "paper/k5-tdd",
        TDD | {"kept apart"},
        {"auvs.separation_cells": 2.2, "auvs.count": 5, "reward.separation_penalty": 3.0},
    ),
    "three-auvs-fdd": Case(
        "paper/k10-fdd",
        FDD | SHARED,
        {"reward.unserved_penalty": 1.0, "reward.no_able_node_penalty": 1.0, **THREE_AUVS},
    ),
    "three-auvs-tdd": Case(
        "paper/k7-tdd", TDD | SHARED, {"reward.only_transmitting_penalty": 1.0, **THREE_AUVS}
    ),
    "three-auvs-stored": Case("best/k5-tdd", TDD | SHARED, THREE_AUVS),
    "exclusive-fdd": Case(
        "paper/k5-fdd", FDD | SHARED | {"collision"}, {"channel.access": "exclusive", **THREE_AUVS}
    ),
    "exclusive-tdd": Case(
        "paper/k5-tdd", TDD | SHARED | {"collision"}, {"channel.access": "exclusive", **THREE_AUVS}
    ),
    "interference-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | {"disturbed uplink"},
        {"channel.access": "interference", **THREE_AUVS},
    ),
    "strong-interference-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | DISTURBED,
        {"channel.access": "interference", **LOUD, **THREE_AUVS},
    ),
    "interference-tdd": Case(
        "best/k5-tdd",
        TDD | SHARED | DISTURBED,
        {"channel.access": "interference", **THREE_AUVS},
    ),
    "interference-tdd-synchronised": Case(
        "best/k5-tdd",
        TDD | SHARED | {"disturbed uplink"},
        {"channel.access": "interference", "duplex.synchronised": True, **THREE_AUVS},
    ),
    "interference-sonar": Case(
        "paper/k3-tdd",
        TDD | SHARED | DISTURBED,
        {**SONAR, "channel": {**SONAR["channel"], "access": "interference"}, **TWO_AUVS},
    ),
    "all-that-can-be-seen": Case(
        "paper/k5-fdd",
        FDD | SHARED,
        {
            "observation.node_positions": True,
            "observation.time": True,
            "observation.agent_index": True,
            **THREE_AUVS,
        },
    ),
    "all-that-can-be-seen-scaled": Case(
        "paper/k5-fdd",
        FDD | SHARED,
        {
            "observation.kind": "scaled",
            "observation.node_positions": True,
            "observation.view_range_m": 300,
            **THREE_AUVS,
        },
    ),
    "others-out-of-mind": Case(
        "paper/k3-tdd", TDD | SHARED, {"observation.other_auvs": False, **TWO_AUVS}
    ),
    "limited-view-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | {"lost sight", "news from afar"},
        {"observation.view_range_m": 300, "channel.access": "interference", **THREE_AUVS},
    ),
    "limited-view-tdd": Case(
        "best/k7-tdd", TDD | {"lost sight", "news from afar"}, {"observation.view_range_m": 110}
    ),
    "difference-reward-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | {"helped by another"},
        {"reward.credit": "difference", "reward.age_weight": 1.5, **THREE_AUVS},
    ),
    "difference-reward-tdd": Case(
        "best/k3-tdd",
        TDD | SHARED | {"helped by another"},
        {"reward.credit": "difference", "auvs.count": 4, **THREE_WEIGHTS},
    ),
    "difference-reward-of-one": Case("best/k3-fdd", FDD, {"reward.credit": "difference"}),
    "difference-of-mean-age-and-fairness": Case(
        "best/k5-fdd",
        FDD | SHARED,
        {"reward.credit": "difference", "reward.fairness_weight": 7.5, "auvs.count": 3},
    ),
    "equation-fdd": Case("paper/k3-fdd", FDD, {**EQUATION, **COLD}),
    "equation-tdd": Case("paper/k3-tdd", TDD, {**EQUATION, **WARM}),
    "tiny-cells-table": Case("paper/k3-fdd", FDD, {"charging.power_w": 30, **TINY_CELLS}),
    "tiny-cells-equation": Case(
        "paper/k3-tdd",
        TDD,
        {"charging.power_w": 70, "channel.kind": "equation", **TINY_CELLS},
    ),
    "table-fdd-warm": Case("paper/k3-fdd", FDD, {"charging.power_w": 300, **WARM}),
    "table-tdd-cold": Case("paper/k3-tdd", TDD, COLD),
    "sonar-fdd": Case("paper/k3-fdd", FDD, {**SONAR, **WARM}),
    "sonar-tdd": Case("paper/k3-tdd", TDD, {**SONAR, **COLD}),
    "sonar-stored-thorp": Case("best/k3-tdd", TDD, SONAR),
    "losses-by-depth-fdd": Case("paper/k3-fdd", FDD, by_depth([40.0, 30.0])),
    "losses-by-depth-tdd-interference": Case(
        "best/k3-tdd",
        TDD | SHARED - {"contest at equal distance"},
        {**by_depth([40.0], access="interference"), **FLAT_CELLS, **TWO_AUVS},
    ),
    "losses-by-cells-fdd": Case("paper/k3-fdd", FDD - {"no able node"}, by_cell([40.0], [30.0])),
    "losses-by-cells-tdd": Case(
        "paper/k3-tdd",
        TDD | SHARED,
        {**by_cell([40.0]), "observation.entries": ["harvests"], **TWO_SMALL},
    ),
    "hydrophone-of-an-area-fdd": Case(
        "paper/k3-fdd", FDD, {**SONAR, "harvester.area_m2": 1e-6, "harvester.sensitivity_db": -150}
    ),
    "modem-fdd": Case("paper/k3-fdd", FDD | {"out of range"}, MODEM),
    "modem-without-power-control-fdd": Case(
        "paper/k3-fdd",
        FDD | {"out of range", "below threshold"},
        {
            **MODEM,
            "uplink": {**MODEM["uplink"], "power_control": False},
            "harvester": {**MODEM["harvester"], "threshold_w": 1e-3},
            "observation.entries": ["harvests"],
        },
    ),
    "modem-tdd": Case(
        "paper/k3-tdd", ALWAYS | {"only charging", "both", "out of range"}, MODEM_TDD
    ),
    "modem-at-leisure-tdd": Case(
        "paper/k3-tdd",
        ALWAYS | {"only charging", "both", "out of range"},
        {
            **MODEM_TDD,
            "duplex.beta_max": 0.6,
            "uplink": {**MODEM["uplink"], "power_control": False},
        },
    ),
    "modem-hardly-in-time-tdd": Case(
        "paper/k3-tdd",
        ALWAYS | {"only charging", "both"},
        {
            **MODEM_TDD,
            "uplink": {**MODEM["uplink"], "packet_bits": 134_850},
            "charging.power_w": 20_000,
        },
    ),
    "modem-two-auvs-fdd": Case(
        "paper/k3-fdd", FDD | SHARED | {"out of range"}, {**MODEM, **TWO_AUVS}
    ),
    "modem-two-auvs-exclusive-tdd": Case(
        "paper/k3-tdd",
        ALWAYS | SHARED | {"collision", "only charging", "both"},
        {**MODEM_TDD, "channel": {**MODEM["channel"], "access": "exclusive"}, **TWO_AUVS},
    ),
    "random-nodes-fdd": Case("paper/k3-fdd", FDD, RANDOM_NODES, episodes=3),
    "random-nodes-tdd": Case("paper/k3-tdd", TDD, RANDOM_NODES, episodes=3),
    "small-grid-fdd": Case(
        "paper/k3-fdd", FDD | {"same cell"}, {**SMALL_GRID, "charging.power_w": 300}
    ),
    "small-grid-tdd": Case("paper/k3-tdd", TDD | {"same cell"}, SMALL_GRID),
    "small-grid-two-auvs": Case(
        "paper/k3-tdd",
        TDD | SHARED | {"same cell", "nearest AUV silent"},
        {**SMALL_GRID, "auvs.start_cells": [[2, 2, 1], [1, 2, 1]]},
    ),
    "flat-cells-fdd": Case("paper/k5-fdd", FDD | SHARED, {**FLAT_CELLS, **THREE_AUVS}),
    "flat-cells-of-mean-distance": Case(
        "paper/k3-tdd",
        TDD | SHARED | {"same cell"},
        {
            **SMALL_GRID,
            **FLAT_CELLS,
            "grid.own_cell_distance": "mean",
            "observation.kind": "scaled",
            "auvs.start_cells": [[2, 2, 1], [1, 2, 1]],
        },
    ),
    "tall-cells-interference": Case(
        "best/k5-tdd",
        TDD | DISTURBED | SHARED - {"kept apart"},
        {
            **TALL_CELLS,
            "channel.access": "interference",
            "auvs.separation_cells": 0,
            "observation.view_range_m": 200,
            **THREE_AUVS,
        },
    ),
    "sonar-of-mean-distance": Case(
        "paper/k3-fdd", FDD, {**SONAR, "grid.own_cell_distance": "mean"}
    ),
    "capacitors-fdd": Case("paper/k5-fdd", FDD | SLEEPERS, CAPACITOR),
    "capacitors-fdd-three-auvs": Case(
        "paper/k5-fdd",
        FDD | SHARED | SLEEPERS,
        {**CAPACITOR, "observation.view_range_m": 300, **THREE_AUVS},
    ),
    "capacitors-fdd-interference": Case(
        "paper/k5-fdd",
        FDD - {"no able node"} | SLEEPERS,
        {**CAPACITOR, "channel.access": "interference", **THREE_AUVS},
    ),
    "capacitors-tdd": Case("paper/k3-tdd", TDD | STORES | {"store too small"}, TINY_STORES),
    "capacitors-tdd-stored": Case("best/k3-tdd", TDD | STORES | {"store too small"}, TINY_STORES),
    "capacitors-tdd-three-auvs": Case(
        "best/k5-tdd", TDD | SHARED | STORES, {**CAPACITOR, **THREE_AUVS}
    ),
    "capacitors-modem-fdd": Case("paper/k3-fdd", FDD | STORES, {**MODEM, "storage": MODEM_STORES}),
    "capacitors-modem-tdd": Case(
        "paper/k3-tdd",
        TDD - {"only transmitting"} | STORES,
        {**MODEM_TDD, "storage": MODEM_STORES, **TWO_AUVS},
    ),
    "nobody-fdd": Case(
        "paper/k3-fdd",
        FDD | IDLE_FDD,
        {"reward.no_able_node_penalty": 1.0, "reward.wrong_node_penalty": 8.0, **NOBODY},
    ),
    "nobody-tdd": Case(
        "paper/k3-tdd", TDD | IDLE_TDD, {"reward.only_transmitting_penalty": 3.0, **NOBODY}
    ),
    "nobody-capacitors-fdd": Case(
        "paper/k5-fdd", FDD | SLEEPERS | IDLE_FDD, {**CAPACITOR, **NOBODY}
    ),
    "nobody-capacitors-tdd": Case(
        "best/k5-tdd", TDD | STORES | IDLE_TDD, {**CAPACITOR, **NOBODY, **THREE_AUVS}
    ),
    "nobody-stored": Case("best/k3-tdd", TDD | IDLE_TDD, NOBODY),
    "nobody-three-auvs-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | IDLE_FDD | {"helped by another"},
        {"reward.credit": "difference", "auvs.motion": "hover", **THREE_AUVS, **NOBODY},
    ),
    "nobody-three-auvs-tdd": Case(
        "paper/k5-tdd",
        TDD | SHARED | IDLE_TDD | {"lost sight", "news from afar"},
        {"observation.view_range_m": 110, **THREE_AUVS, **NOBODY},
    ),
    "nobody-exclusive-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | IDLE_FDD | {"collision"},
        {"channel.access": "exclusive", **THREE_AUVS, **NOBODY},
    ),
    "nobody-exclusive-tdd": Case(
        "paper/k5-tdd",
        TDD | SHARED | IDLE_TDD | {"collision"},
        {"channel.access": "exclusive", **THREE_AUVS, **NOBODY},
    ),
    "nobody-interference-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED | DISTURBED | IDLE_FDD,
        {"channel.access": "interference", **LOUD, **THREE_AUVS, **NOBODY},
    ),
    "nobody-interference-tdd": Case(
        "best/k5-tdd",
        TDD | SHARED | DISTURBED | IDLE_TDD,
        {"channel.access": "interference", **THREE_AUVS, **NOBODY},
    ),
    "nobody-interference-tdd-synchronised": Case(
        "best/k5-tdd",
        TDD | SHARED | IDLE_TDD | {"disturbed uplink"},
        {
            "channel.access": "interference",
            "duplex.synchronised": True,
            **THREE_AUVS,
            **NOBODY,
        },
    ),
    "batteries-fdd": Case(
        "paper/k5-fdd", (FDD | TIRED) - {"overserved node", "left grid"}, ON_BATTERY
    ),
    "batteries-tdd": Case(
        "paper/k5-tdd", (TDD | TIRED) - {"overserved node", "left grid"}, ON_BATTERY
    ),
    "planar-fdd": Case(
        "paper/k5-fdd",
        FDD | SHARED,
        {
            **THREE_AUVS,
            "auvs.motion": "planar",
            "observation.kind": "scaled",
            "observation.entries": ["harvests"],
        },
    ),
    "batteries-fdd-docks": Case(
        "best/k5-fdd", FDD - {"overserved node"} | TIRED | {"vehicle docked"}, DOCKED
    ),
    "batteries-fdd-three-auvs": Case(
        "paper/k5-fdd",
        FDD | SHARED | TIRED | {"vehicle docked", "vehicle halted"},
        {**DOCKED, **THREE_AUVS, "observation.entries": ["battery", "batteries"]},
    ),
    "batteries-tdd-stored-three-auvs": Case(
        "best/k5-tdd",
        (TDD | SHARED) - {"overserved node", "contest at equal distance"}
        | TIRED
        | {"vehicle docked"},
        {**DOCKED, **THREE_AUVS, "auvs.motion": "hover", "grid.spacing_m": [100, 80, 30]},
    ),
    "batteries-tdd-interference": Case(
        "best/k5-tdd",
        TDD - {"overserved node"} | TIRED,
        {**DOCKED, **THREE_AUVS, "channel.access": "interference", "auvs.idle_choices": True},
    ),
    "low-maximum-age": Case("paper/k5-fdd", FDD, {"age.maximum": 4, "age.initial": 2}),
    "other-bounds-of-beta": Case(
        "paper/k3-tdd", TDD, {"duplex.beta_min": 0.3, "duplex.beta_max": 0.5}
    ),
    "other-bounds-of-beta-stored": Case(
        "best/k3-tdd", TDD, {"duplex.beta_min": 0.0, "duplex.beta_max": 0.6}
    ),
    "large-packets": Case("paper/k3-tdd", TDD, LARGE_PACKETS),
    "large-packets-stored": Case("best/k3-tdd", TDD, LARGE_PACKETS),
    "steep-packets": Case("paper/k3-tdd", TDD, STEEP_PACKETS),
    "steep-packets-stored": Case("best/k3-tdd", TDD, STEEP_PACKETS),
    # Cells of 25 s: three slots a move; two cells a slot; along y the one and along z the other.
    "short-slots-fdd": Case(
        "paper/k3-fdd",
        FDD | SHARED | {"under way"},
        {
            "episode.slot_s": 10,
            "auvs.motion": "hover",
            "observation.entries": ["transit"],
            **THREE_AUVS,
        },
    ),
    "short-slots-tdd": Case(
        "best/k3-tdd",
        TDD | {"under way"},
        {"episode.slot_s": 12, "observation.kind": "scaled", "observation.entries": ["transit"]},
    ),
    "long-slots-fdd": Case(
        "paper/k3-fdd", FDD | SHARED, {"episode.slot_s": 55, "age.maximum": 8, **THREE_AUVS}
    ),
    "long-slots-tdd": Case("best/k3-tdd", TDD, {"episode.slot_s": 80, "age.maximum": 6}),
    "short-and-long-moves-fdd": Case(
        "paper/k3-fdd",
        FDD | SHARED | {"under way"},
        {"episode.slot_s": 20, **FLAT_CELLS, **THREE_AUVS},
    ),
    "batteries-short-slots": Case(
        "paper/k3-fdd",
        (FDD | SHARED | TIRED | {"vehicle docked", "vehicle halted", "under way", "given up"})
        - {"overserved node"},
        {
            "episode.slot_s": 10,
            "auvs.motion": "hover",
            "observation.entries": ["transit", "battery"],
            **DOCKED,
            **THREE_AUVS,
        },
    ),
    "batteries-short-and-long-moves": Case(
        "best/k3-tdd",
        (TDD | SHARED | TIRED | {"vehicle docked", "under way"})
        - {"overserved node", "contest at equal distance"},
        {"episode.slot_s": 20, **FLAT_CELLS, **DOCKED, **THREE_AUVS},
    ),
    "packet-start-fdd": Case(
        "paper/k3-fdd",
        FDD | SHARED | {"helped by another"},
        {"age.sampling": "packet_start", "reward.credit": "difference", **TWO_AUVS},
    ),
    "packet-start-tdd": Case(
        "best/k3-tdd", TDD, {"age.sampling": "packet_start", "observation.view_range_m": 200}
    ),
    "packet-start-modem-fdd": Case(
        "paper/k3-fdd", FDD | {"out of range"}, {"age.sampling": "packet_start", **MODEM}
    ),
    "polling-fdd": Case(
        "paper/k5-fdd", POLLS, {**QUICK_MODEM, "hearing": {**POLL, "max_nodes_per_slot": 3}}
    ),
    "polling-tdd": Case(
        "paper/k5-tdd",
        POLLS - {"polled in the place of the chosen"},
        {
            **QUICK_MODEM,
            "duplex": {"kind": "tdd", "beta_rule": "airtime", "beta_max": 0.7},
            "hearing": {**POLL, "max_nodes_per_slot": 4},
        },
    ),
    "polling-one-at-most": Case(
        "paper/k5-fdd",
        {"polled", "polled in the place of the chosen"},
        {**QUICK_MODEM, "hearing": {**POLL, "max_nodes_per_slot": 1}},
    ),
    "polling-packet-start": Case(
        "paper/k5-fdd",
        POLLS | {"packets of different ages", "too late", "news from afar", "rivals"},
        {
            **SLOW_MODEM,
            "age.sampling": "packet_start",
            "observation.view_range_m": 20,
            "hearing": {**POLL, "max_nodes_per_slot": 5},
            **TWO_AUVS,
        },
    ),
    "polling-three-auvs": Case(
        "paper/k10-fdd",
        POLLS | {"rivals", "helped by another", "overserved node"},
        {
            **QUICK_MODEM,
            "reward.credit": "difference",
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            **THREE_AUVS,
        },
    ),
    "polling-exclusive": Case(
        "paper/k5-fdd",
        POLLS | IDLE_FDD | {"polled and lost"},
        {
            **QUICK_MODEM,
            "channel.access": "exclusive",
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            **TWO_AUVS,
            **NOBODY,
        },
    ),
    "polling-on-battery": Case(
        "paper/k5-fdd",
        {"polled", "polled in the place of the chosen", "vehicle stranded"},
        {
            **QUICK_MODEM,
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            "vehicle": {**BATTERY, "capacity_j": 4e5},
            **TWO_AUVS,
        },
    ),
    "polling-capacitors": Case(
        "paper/k5-fdd",
        {"polled", "polled in the place of the chosen", "rivals"} | STORES,
        {
            **QUICK_MODEM,
            "storage": {**MODEM_STORES, "capacity_j": 30.0},
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            **TWO_AUVS,
        },
    ),
    "polling-capacitors-tdd": Case(
        "paper/k5-tdd",
        {"polled", "polled after the chosen"} | STORES,
        {
            **QUICK_MODEM,
            "duplex": {"kind": "tdd", "beta_rule": "airtime", "beta_max": 0.7},
            "storage": {**MODEM_STORES, "capacity_j": 30.0},
            "hearing": {**POLL, "max_nodes_per_slot": 4},
            **TWO_AUVS,
        },
    ),
    "current-uniform-fdd": Case(
        "paper/k3-fdd",
        (FDD | HELD) - {"overserved node"},
        in_current({"kind": "uniform", "speed_m_per_s": 2.0, "toward_deg": 25.0}, 5.0),
        tolerance=TABULATED,
    ),
    "current-shear-tdd": Case(
        "best/k3-tdd",
        TDD | HELD,
        {
            **in_current(
                {"kind": "shear", "speed_m_per_s": 3.0, "toward_deg": 250.0, "depth_scale_m": 150},
                5.0,
            ),
            "grid.origin": {"latitude_deg": 60.0, "longitude_deg": 5.0, "depth_m": 30.0},
        },
        tolerance=TABULATED,
    ),
    "current-tide-three-auvs": Case(
        "paper/k5-fdd",
        FDD | SHARED | HELD | ADRIFT,
        {
            **in_current(
                {
                    "kind": "tide",
                    "speed_m_per_s": 4.9,
                    "toward_deg": 300.0,
                    "period_h": 0.6,
                    "phase_deg": 40.0,
                },
                4.2,
            ),
            **THREE_AUVS,
            "vehicle": {**AMPLE, **DOCKS, "max_speed_m_per_s": 4.2},
        },
        tolerance=TABULATED,
    ),
    "current-vortex-without-battery": Case(
        "paper/k3-fdd",
        (FDD | SHARED | HELD | ADRIFT) - {"kept apart"},
        {
            **in_current(
                {
                    "kind": "vortex",
                    "circulation_m2_per_s": -9000.0,
                    "core_radius_m": 150.0,
                    "center_m": [190.0, 215.0],
                },
                4.1,
            ),
            **TWO_AUVS,
            "vehicle": {"kind": "unlimited", "max_speed_m_per_s": 4.1},
        },
        tolerance=TABULATED,
    ),
    "current-from-file-tdd": Case(
        "best/k3-tdd",
        (TDD | SHARED | HELD) - {"contest at equal distance"},
        {
            **in_current({"kind": "file", "file": WIDE, "start_h": 0.05}, 4.4),
            "grid.origin": ORIGIN,
            **TWO_AUVS,
        },
        tolerance=TABULATED,
    ),
    "current-gyre-on-a-small-battery": Case(
        "paper/k3-fdd",
        {"delivery", "vehicle stranded", "water: drifting"} | HELD,
        {
            **in_current({"kind": "double_gyre", "amplitude_m_per_s": 4.0, "period_h": 0.5}, 9.0),
            "vehicle": {**BATTERY, "capacity_j": 4e6, "max_speed_m_per_s": 9.0},
            "auvs.motion": "hover",
            **NOBODY,
        },
        tolerance=100 * TABULATED,  # what an all but empty battery has is a small difference
    ),
    "current-short-and-long-moves": Case(
        "paper/k3-fdd",
        (FDD | SHARED | HELD | ADRIFT | {"under way", "given up"}),
        {
            **in_current({"kind": "tide", "speed_m_per_s": 4.95, "toward_deg": 80.0}, 4.8),
            "current.period_h": 0.5,
            "episode.slot_s": 20,
            **FLAT_CELLS,
            **THREE_AUVS,
            "vehicle": {**AMPLE, **DOCKS, "max_speed_m_per_s": 4.8},
        },
        tolerance=TABULATED,
    ),
    "shadowing-fdd": Case("paper/k3-fdd", FDD, {**MODEM, "channel.fading": SHADOWING}),
    "shadowing-bpsk-fdd": Case(
        "paper/k3-fdd",
        (FDD | {"lost too weak", "lost by bit errors"}) - {"overserved node"},
        {**ROUGH_MODEM, "channel.wind": GUSTS},
    ),
    "shadowing-bpsk-two-auvs-fdd": Case(
        "paper/k3-fdd",
        (FDD | SHARED | {"lost too weak", "lost by bit errors"}) - {"overserved node"},
        {**ROUGH_MODEM, "storage": MODEM_STORES, **TWO_AUVS},
    ),
    "shadowing-threshold-tdd": Case(
        "paper/k3-fdd",
        {"both", "delivery", "no delivery", "lost too weak"},
        {
            **ROUGH_MODEM,
            "uplink.loss": "threshold",
            "duplex": {"kind": "tdd", "beta_rule": "airtime"},
            **TWO_AUVS,
        },
    ),
    "wind-series-table-fdd": Case(
        "paper/k3-fdd",
        {"delivery", "lost too weak", "lost by bit errors"},
        {
            **MODEM,
            "channel.wind": {"kind": "series", "file": WIND},
            "uplink.loss": {"kind": "table", "file": ERRORS},
            "uplink.power_control": False,
            "uplink.required_snr_db": 25.0,
        },
    ),
    "gusts-threshold-exclusive-fdd": Case(
        "paper/k3-fdd",
        {"delivery", "lost too weak", "collision"},
        {
            **MODEM,
            "channel.wind": GUSTS,
            "uplink.loss": "threshold",
            "channel.access": "exclusive",
            **TWO_AUVS,
        },
    ),
    "polling-losses-fdd": Case(
        "paper/k5-fdd",
        POLLS | {"lost when polled", "lost too weak", "lost by bit errors"},
        {
            **ROUGH_MODEM,
            "charging.power_w": 400,
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            "age.sampling": "packet_start",
            **TWO_AUVS,
        },
    ),
    "polling-losses-exclusive-fdd": Case(
        "paper/k5-fdd",
        {"polled and lost", "lost when polled", "lost too weak"},
        {
            **ROUGH_MODEM,
            "charging.power_w": 400,
            "channel.access": "exclusive",
            "hearing": {**POLL, "max_nodes_per_slot": 3},
            **TWO_AUVS,
        },
    ),
    "other-hardware-fdd": Case(
        "paper/k3-fdd",
        FDD,
        {
            "duplex.charging_frequency_khz": 36.0,
            "duplex.uplink_frequency_khz": 25.0,
            **OTHER_HARDWARE,
        },
    ),
    "other-hardware-tdd": Case(
        "paper/k3-tdd", TDD, {"duplex.frequency_khz": 33.0, **OTHER_HARDWARE}
    ),
}


#: The published scenarios are compared in `make quick`, too.
NAMES = [
    pytest.param(name, marks=() if name.startswith("paper/k3") else pytest.mark.slow, id=name)
    for name in CASES
]


@functools.cache
def expected(name):
    """One play for the tests of all libraries."""
    return play(CASES[name])


@pytest.fixture(autouse=True)
def _one_thread():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def said(slot):
    """What the oracle says of a slot, by what it is called."""
    terms = {f"reward: {name}": values for name, values in slot.terms.items()}
    return {
        **{f"state.{name}": values for name, values in slot.state.items()},
        **{f"events.{name}": values for name, values in slot.events.items()},
        **terms,
        "reward": sum(map(np.asarray, terms.values())),
        **{f"metrics: {name}": values for name, values in slot.metrics.items()},
        "observation": slot.observation,
    }


def found(world, state, events, slot):
    """What the world says of the same."""
    return {
        **{f"state.{name}": getattr(state, name) for name in slot.state},
        **{f"events.{name}": getattr(events, name) for name in slot.events},
        **{f"reward: {name}": term for name, term in world.reward_terms(state, events).items()},
        "reward": world.reward(state, events),
        **{f"metrics: {name}": values for name, values in world.metrics(state).items()},
        "observation": world.observe(state),
    }


def over_slots(rows):
    """An array over slots of all that is said of each."""
    assert all(row.keys() == rows[0].keys() for row in rows)
    return {
        what: np.array([np.asarray(row[what], dtype=float) for row in rows]) for what in rows[0]
    }


@functools.cache
def said_over_slots(name):
    return [over_slots([said(slot) for slot in episode.slots]) for episode in expected(name)[1]]


def assert_same(actual, wanted, what, tolerance):
    assert actual.shape == wanted.shape, what
    near = np.abs(actual - wanted) <= tolerance * (1 + np.abs(wanted))
    # The report takes longer than the comparison: only where there is something to report.
    if not near.all():
        slot = np.argwhere(~near)[0, 0]
        where = f"{what}, slot {slot}"
        np.testing.assert_allclose(actual[slot], wanted[slot], tolerance, tolerance, err_msg=where)
        pytest.fail(where)


#: Slots of an episode that each library plays: torch runs the same lines as NumPy, which plays all.
SLOTS = {np: None, torch: 40}


@pytest.mark.parametrize("library", SLOTS, ids=["numpy", "torch"])
@pytest.mark.parametrize("name", NAMES)
def test_world_agrees_with_the_oracle_in_every_slot(name, library):
    scenario, episodes, _ = expected(name)
    world = World(scenario, num_envs=ENVS, library=library, dtype="float64")
    for number, episode in enumerate(episodes):
        state = world.reset(codes(world, scenario, number))
        ours = over_slots([{"first observation": world.observe(state)}])
        theirs = over_slots([{"first observation": episode.first_observation}])
        rows = []
        for slot in episode.slots[: SLOTS[library]]:
            action = library.asarray(np.asarray(slot.action, dtype=np.int64))
            chance = slot.chance and slot.chance.map(world.backend.floats)
            state, events = world.step(state, action, chance)
            rows.append(found(world, state, events, slot))
        ours |= over_slots(rows)
        said_of = said_over_slots(name)[number]
        theirs |= {what: values[: SLOTS[library]] for what, values in said_of.items()}
        assert ours.keys() == theirs.keys()
        for what, values in ours.items():
            assert_same(values, theirs[what], f"episode {number}: {what}", CASES[name].tolerance)


@pytest.mark.parametrize("name", NAMES)
def test_episodes_exercise_what_they_are_meant_to(name):
    _, _, seen = expected(name)
    assert not [what for what in CASES[name].happens if not seen[what]]


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in CASES if name.startswith("random-nodes")])
def test_random_nodes_lie_in_cells_of_their_own_and_differ_between_episodes(name):
    scenario, episodes, _ = expected(name)
    drawn = [layout for episode in episodes for layout in episode.layouts]
    assert len({tuple(layout) for layout in drawn}) == len(drawn)
    for layout in drawn:
        assert len(set(layout)) == scenario.num_nodes
        for cell in layout:
            assert all(1 <= c <= n for c, n in zip(cell, scenario.grid.cells, strict=True))


def test_every_paper_scenario_is_compared():
    assert {name for name in bundled_names() if name.startswith("paper/")} <= set(CASES)
