"""Random scenarios for random slots: between them they use every part of the world."""

from __future__ import annotations

from typing import Any

import numpy as np

#: What is drawn: settings of a scenario that go over one of the paper's.
Settings = dict[str, Any]


def draw_settings(rng: np.random.Generator) -> tuple[str, Settings]:
    """A bundled scenario, and what takes its settings' places."""

    def one_of(*choices: Any) -> Any:
        return choices[rng.integers(len(choices))]

    def sometimes(section: Settings, key: str, *choices: Any) -> None:
        if rng.random() < 0.5:
            section[key] = one_of(*choices)

    grid = rng.integers(1, 8, 3).tolist() if rng.random() < 0.9 else [1, 1, int(rng.integers(1, 4))]
    room = int(np.prod(grid))
    num_auvs = int(min(rng.integers(1, 6), room))
    num_nodes = int(min(rng.integers(1, 11), room))
    slots = int(rng.integers(5, 41))
    spacing_m, speed = one_of(1.0, 20.0, 100.0, 400.0), one_of(1.0, 4.0)
    shorter = [spacing_m * one_of(0.2, 0.7, 1.0) for _ in range(2)]
    cells = np.stack(np.unravel_index(rng.permutation(room), grid), axis=-1) + 1
    settings: Settings = {
        "grid": {"cells": grid, "spacing_m": one_of(spacing_m, [spacing_m, *shorter])},
        "grid.own_cell_distance": one_of("zero", "mean"),
        "auvs": {
            "start_cells": cells[: int(rng.integers(1, num_auvs + 1))].tolist(),
            "count": num_auvs,
            "speed_m_per_s": speed,
            "motion": one_of("six", "hover"),
            "separation_cells": one_of(0, 0.5, 1, 1, 1, 1.5, 2),
            "idle_choices": one_of(False, False, True),
        },
        "age": {"initial": 1, "maximum": one_of(1, 2, 5, 50, 1000)},
        "charging.power_w": one_of(1.0, 500.0, 2000.0, 1e5),
        "uplink.packet_bits": one_of(10.0, 100.0, 1e4, 1e5),
        "uplink.bandwidth_hz": one_of(500.0, 3000.0),
        "harvester.hydrophones": one_of(1, 2, 20),
    }
    if rng.random() < 0.5:
        nodes: Settings = {
            "kind": "fixed",
            "cells": cells[rng.permutation(room)[:num_nodes]].tolist(),
        }
        nodes["count"] = num_nodes
    else:
        nodes = {"kind": "random", "count": num_nodes, "redraw": one_of("run", "episode")}
    if rng.random() < 0.4:
        nodes["weights"] = rng.choice([0.0, 0.5, 1.0, 3.0], num_nodes).tolist()
    settings["nodes"] = nodes
    slot_s = spacing_m / speed
    if rng.random() < 0.3:
        # Moves over several slots, over several cells in one, and both along unlike edges.
        slot_s *= one_of(0.15, 0.4, 0.7, 1.0, 2.5)
        settings["episode"] = {"slot_s": slot_s, "duration_s": slots * slot_s}
    else:
        settings["episode"] = {"duration_s": slots * slot_s}
    if rng.random() < 0.3:
        settings["age"]["sampling"] = "packet_start"
    if rng.random() < 0.4:
        capacity_j = one_of(1e-3, 1.0, 60.0, 1e3, 1e6)
        settings["storage"] = {
            "kind": "capacitor",
            "capacity_j": capacity_j,
            "initial_j": capacity_j * one_of(0.0, 0.3, 1.0),
            "leakage_w": capacity_j * one_of(0.0, 1e-4, 0.1),
            "idle_w": capacity_j * one_of(0.0, 1e-3, 0.2),
        }
    has_battery = rng.random() < 0.4
    if has_battery:
        # Of at most so many slots of hotel load and moves.
        lasts = one_of(1.5, 4.0, 30.0)
        hotel_w = one_of(0.0, 40.0, 500.0)
        move_w = 0.5 * 1025 * 0.006 * 3.0 * speed**3 / 0.7
        settings["vehicle"] = {
            "kind": "battery",
            "capacity_j": lasts * (hotel_w + move_w + one_of(0.0, 1e3)) * slot_s,
            "initial_share": one_of(0.7, 1.0),
            "drag_area_m2": 3.0,
            "drag_coefficient": 0.006,
            "propulsion_efficiency": 0.7,
            "hotel_w": hotel_w,
            "docks": cells[: int(rng.integers(0, 4))].tolist(),
            "dock_power_w": hotel_w + one_of(10.0, 5e3),
        }
    kind = one_of("fdd", "tdd")
    settings["duplex"] = {"kind": kind}
    if kind == "tdd":
        low, high = one_of((0.1, 0.9), (0.0, 0.5), (0.05, 0.99), (0.4, 0.6))
        settings["duplex"] |= {
            "beta_rule": one_of("paper", "stored"),
            "beta_min": low,
            "beta_max": high,
            "synchronised": one_of(True, False),
            "frequency_khz": one_of(10.0, 40.0),
        }
    channel: Settings = {"kind": one_of("table", "table", "equation", "sonar")}
    channel["access"] = one_of("orthogonal", "interference", "exclusive")
    sometimes(channel, "spreading_factor", 1.0, 1.5, 2.0)
    sometimes(
        channel,
        "absorption",
        {"kind": "thorp"},
        {"kind": "francois_garrison", "temperature_c": 4.0, "ph": 7.9},
    )
    if channel["kind"] == "sonar":
        sometimes(channel, "wind_m_per_s", 0.0, 10.0)
        sometimes(channel, "uplink_directivity_index_db", 0.0, 6.0)
    else:
        channel["noise_level_db"] = one_of(20.0, 30.0)
    settings["channel"] = channel
    if rng.random() < 0.3:
        modems = _of_modems(rng, settings, slot_s)
        for key in [key for key in settings if key.partition(".")[0] in modems]:
            del settings[key]
        settings |= modems
    reward: Settings = {"kind": one_of("paper", "mean_age"), "credit": one_of("team", "difference")}
    if reward["kind"] == "mean_age":
        sometimes(reward, "fairness_weight", 0.0, 20.0)
    else:
        for key in ("age_weight", "location_penalty", "separation_penalty", "unserved_penalty"):
            sometimes(reward, key, 0.0, 1.0, 10.0, -2.0)
        for key in ("no_able_node", "wrong_node", "only_charging", "only_transmitting"):
            sometimes(reward, f"{key}_penalty", 0.0, 4.0, -1.0)
    if has_battery:
        sometimes(reward, "stranded_penalty", 0.0, 5.0, -1.0)
        sometimes(reward, "vehicle_energy_penalty_per_kj", 0.0, 0.01)
    settings["reward"] = reward
    observation: Settings = {"kind": one_of("paper", "scaled")}
    for key in ("node_positions", "time", "other_auvs", "agent_index"):
        sometimes(observation, key, True, False)
    sometimes(observation, "view_range_m", None, 0.5 * spacing_m, 2 * spacing_m)
    if has_battery:
        observation["entries"] = ["battery", "batteries"][: min(num_auvs, 2)]
    sometimes(observation, "action_mask", "none", "info", "observation")
    settings["observation"] = observation
    return f"paper/k3-{kind}", settings


def _of_modems(rng: np.random.Generator, settings: Settings, slot_s: float) -> Settings:
    """What takes the settings' places where nodes have modems; AUVs often hear several of them."""

    def one_of(*choices: Any) -> Any:
        return choices[rng.integers(len(choices))]

    airtime_s = slot_s * one_of(0.02, 0.1, 0.3)
    bits = one_of(100.0, 8000.0)
    found: Settings = {
        # Modems do not raise their level against one another.
        "channel": {
            "kind": "sonar",
            "spreading_factor": one_of(1.5, 2.0),
            "access": one_of("orthogonal", "exclusive"),
        },
        "uplink": {
            "kind": "modem",
            "bit_rate_bps": bits / airtime_s,
            "packet_bits": bits,
            "bandwidth_hz": one_of(500.0, 5000.0),
            "electronics_w": one_of(0.0, 0.5, 2.0),
            "maximum_source_level_db": one_of(150.0, 185.0),
            "required_snr_db": one_of(0.0, 10.0),
            "power_control": one_of(True, True, False),
        },
    }
    if rng.random() < 0.6:
        found["channel"] |= _of_a_sea_that_changes(rng, slot_s)
        found["uplink"] |= {
            "loss": one_of("none", "threshold", "bpsk", "bpsk"),
            "margin_db": one_of(0.0, 3.0),
        }
    if rng.random() < 0.6:
        found["harvester"] = {"kind": "aperture", "area_m2": one_of(0.02, 0.5), "efficiency": 0.5}
    if settings["duplex"]["kind"] == "tdd":
        found["duplex"] = {**settings["duplex"], "beta_rule": "airtime"}
    if rng.random() < 0.7:
        found["hearing"] = {"kind": "polling", "max_nodes_per_slot": int(rng.integers(2, 6))}
    return found


def _of_a_sea_that_changes(rng: np.random.Generator, slot_s: float) -> Settings:
    """Shadowing and gusts, or none."""
    found: Settings = {"wind_m_per_s": float(rng.choice([0.0, 8.0]))}
    if rng.random() < 0.7:
        coherence_s = slot_s * float(rng.choice([0.3, 10.0]))
        sigma_db = float(rng.choice([1.0, 5.0]))
        found["fading"] = {"kind": "shadowing", "sigma_db": sigma_db, "coherence_s": coherence_s}
    if rng.random() < 0.7:
        sigma = float(rng.choice([1.0, 6.0]))
        found["wind"] = {"kind": "gauss_markov", "sigma_m_per_s": sigma, "coherence_s": 9 * slot_s}
    return found
