"""Results of the paper's study, made up: figures that a test can set as it likes."""

import copy
import functools

from iout_marl.evaluation import METRICS
from iout_marl.paper.names import BASELINES, BEST, TRAINED, in_fdd
from iout_marl.scenario import load_scenario
from iout_marl.study.results import CellResult, Emissions, Record, Results, TrainingRecord
from iout_marl.study.schema import load_study

PLACES = (3, 5, 7, 10)
#: What every record has unless a test says otherwise.
DEFAULT_BUDGET = {
    "mean_aoi": 9.0,
    "final_aoi": 9.5,
    "peak_aoi": 27.0,
    "jain": 0.95,
    "harvested_kj": 9.0,
    "uplink_success": 0.9,
}
MACHINE = {"processor": "A processor", "cores": "2", "system": "Linux", "Python": "3.11.7"}


def episode(nodes, heard):
    """One AUV that goes to and fro for as many slots as it hears nodes; 0 for none."""
    slots = len(heard)
    return {
        "grid": [10, 10, 4],
        "spacing_m": 100.0,
        "nodes": [[i + 1, 1, 1] for i in range(nodes)],
        "path": [[[5 + i % 2, 5, 2]] for i in range(slots + 1)],
        "charged": [[1]] * slots,
        "heard": [[node] for node in heard],
        "delivered": [[node > 0] for node in heard],
        "ages": [[1] * nodes] * slots,
    }


@functools.cache
def _settings():
    return load_scenario("paper/k10-tdd").training.model_dump(mode="json")


def record(policy, place, seed, samples, *, seconds=20.0, heard=(1, 2, 1)):
    """A record whose metrics are `samples` (a number, or one for each episode)."""
    count = (
        max(len(v) for v in samples.values() if isinstance(v, list | tuple))
        if any(isinstance(v, list | tuple) for v in samples.values())
        else 1
    )
    full = {
        name: list(value)
        if isinstance(value := samples.get(name, DEFAULT_BUDGET.get(name, 0.0)), list | tuple)
        else [value] * count
        for name in METRICS
    }
    trained = policy == "ppo"
    curve = {
        "env_steps": [1e6, 2e6, 3e6],
        "aoi/mean": [20.0, 10.0, full["mean_aoi"][0]],
        "fairness/jain": [0.5, 0.8, full["jain"][0]],
        "energy/harvested_kj": [5.0, 8.5, full["harvested_kj"][0]],
        "reward/total": [-9.0, -5.0, -1.0],
    }
    energy = seconds * 4e-6
    training = TrainingRecord(
        settings=copy.deepcopy(_settings()),
        env_steps=3_000_000,
        seconds=seconds,
        curve=curve,
        emissions=Emissions(energy_kwh=energy, co2_kg=0.571 * energy, codecarbon="3"),
    )
    return Record(
        key=f"{policy}-{place}-{seed}",
        scenario=f"paper/k{place}",
        scenario_hash="0123456789ab",
        world_hash="ba9876543210",
        duplex="tdd",
        nodes=int(place),
        auvs=1,
        policy=policy,
        seed=seed,
        episodes=count,
        samples=full,
        maximum_age=50,
        minimum_jain=0.85,
        training=training if trained else None,
        episode=episode(int(place), list(heard)) if trained else None,
        machine=MACHINE,
        date="2026-01-02",
    )


def results(cells, *, quick=False, report="paper"):
    """Results of the paper's study with these cells: (group, series, place, record) each."""
    study, _ = load_study("paper")
    made = [
        CellResult(group=group, series=series, axis=place, record=made)
        for group, series, place, made in cells
    ]
    return Results.from_records(
        "paper",
        study.model_copy(update={"report": report}),
        made,
        [],
        "iout reproduce",
        quick=quick,
    )


#: Mean AoI at K = 3 of every series; it grows with K. Much as the paper has it.
AOI = {
    "random-walk": 20.0,
    "round-robin": 16.4,
    "greedy": 11.7,
    "PPO-TDD": 9.9,
    "PPO-FDD": 5.0,
    "Mean-AoI TDD": 6.0,
    "Mean-AoI FDD": 4.0,
}
KJ = {"random-walk": 6.0, "round-robin": 6.1, "greedy": 7.0, "PPO-TDD": 8.6, "PPO-FDD": 11.7}
JAIN = {"random-walk": 0.7, "round-robin": 0.72, "greedy": 0.75, "PPO-TDD": 0.93, "PPO-FDD": 0.97}


def paper_like(change=None, places=PLACES, without=()):
    """A study in which most claims hold.

    Args:
        change: maps (series, place, seed) and the record's metrics to other ones, or to
            None for a record that is missing.
        places: numbers of nodes.
        without: series that are left out.
    """
    cells = []
    for place in places:
        growth = 1 + (place - 3) / 10
        series = [(n, "greedy", (0,)) for n in (*BASELINES, *map(in_fdd, BASELINES))]
        series += [(n, "ppo", (0, 1, 2)) for n in (*TRAINED, *BEST)]
        for name, policy, seeds in series:
            base = name.removesuffix(" (FDD)")
            for seed in seeds:
                spread = [-0.02, 0.0, 0.02] if policy == "greedy" else [(-0.02, 0, 0.02)[seed]]
                jain = JAIN.get(base, 0.96) - (0.01 * (place - 3) if policy == "greedy" else 0)
                metrics = {
                    "mean_aoi": [AOI[base] * growth + s for s in spread],
                    "final_aoi": [AOI[base] * growth * 1.1 + s for s in spread],
                    "peak_aoi": [3 * AOI[base] + s for s in spread],
                    "harvested_kj": [KJ.get(base, 9.0) + 0.1 * (place == 7) + s for s in spread],
                    "jain": [jain + s / 10 for s in spread],
                }
                if change is not None:
                    metrics = change(name, place, seed, metrics)
                if metrics is None or name in without:
                    continue
                seconds = 30.0 + seed if "FDD" in name else 20.0 + seed
                made = record(policy, place, seed, metrics, seconds=seconds)
                cells.append((name.lower(), name, place, made))
    return results(cells)
