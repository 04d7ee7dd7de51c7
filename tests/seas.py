"""Scenarios of a sea that changes, for tests."""

from iout_marl.scenario.data_files import DataFile

SHADOWING = {"kind": "shadowing", "sigma_db": 3.0, "coherence_s": 600.0}
GUSTS = {"kind": "gauss_markov", "sigma_m_per_s": 4.0, "coherence_s": 1800.0}
WIND = DataFile("wind.csv", b"time_s,wind_m_per_s\n0,8\n3000,14\n20000,3\n")
ERRORS = DataFile("errors.csv", b"snr_db,packet_error_rate\n0,1\n10,0.3\n20,0.05\n")

#: Nodes some tens of metres away that modems hear by an SNR at which bit errors show.
ROUGH = {
    "grid.cells": [5, 4, 2],
    "grid.spacing_m": 20,
    "auvs.speed_m_per_s": 0.8,
    "auvs.start_cells": [[1, 1, 1]],
    "episode.duration_s": 1000,
    "nodes": {"kind": "fixed", "cells": [[2, 1, 1], [4, 3, 2], [1, 4, 1]]},
    "charging.power_w": 300,
    "channel": {
        "kind": "sonar",
        "spreading_factor": 2.0,
        "shipping": 0.8,
        "wind_m_per_s": 8.0,
        "fading": SHADOWING,
        "wind": GUSTS,
    },
    "harvester": {"kind": "aperture", "area_m2": 0.05, "efficiency": 0.6, "threshold_w": 0.01},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 3000.0,
        "packet_bits": 2048.0,
        "bandwidth_hz": 4500.0,
        "electronics_w": 0.8,
        "maximum_source_level_db": 140.0,
        "required_snr_db": 6.0,
        "margin_db": 1.0,
        "loss": "bpsk",
    },
    "duplex": {"kind": "fdd"},
}
POLLED = {**ROUGH, "hearing": {"kind": "polling", "max_nodes_per_slot": 2}}
TDD = {**ROUGH, "duplex": {"kind": "tdd", "beta_rule": "airtime"}}
TWO = {"auvs.start_cells": [[1, 1, 1], [5, 4, 1]]}
#: The same for scenarios that have a grid and nodes of their own.
OF_ANY = {
    "grid.spacing_m": 20,
    "auvs.speed_m_per_s": 0.8,
    **{key: ROUGH[key] for key in ("charging.power_w", "channel", "harvester", "uplink")},
    "hearing": POLLED["hearing"],
}
