"""Whole episodes of every bundled scenario, recorded: `python tests/recording.py` records anew.

What is published must not change: hashes, texts, decisions and whole numbers are compared exactly
everywhere; floating-point numbers bit for bit on the kind of processor and with the versions that
are stored with the recording, to 1e-12 elsewhere. `--compare` also compares what `iout
show` prints and the weights after three iterations of six trainings.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import sys
from pathlib import Path

import numpy as np
import torch
from numpy._core._multiarray_umath import __cpu_features__

from iout_marl import World, bundled_names, cli, load_scenario
from iout_marl.machine import processor, versions
from iout_marl.policies import EpisodeStreams, make_baseline
from iout_marl.scenario import to_yaml
from iout_marl.testing.recorded import chance_for
from iout_marl.world import node_codes, pin_layout

RECORDED = Path(__file__).parent / "reference" / "recorded.json"
TRAININGS = (
    "paper/k10-fdd",
    "paper/k5-tdd",
    "best/k10-fdd",
    "best/k7-tdd",
    "multi/m3-k10-fdd",
    "random/k10-fdd",
)
WHOLE = ("slot", "cell", "node_cell", "age", "deliveries", "seen_age", "seen_slot", "others_age")
REAL = ("energy_j", "jain", "harvested_j", "spent_j", "mean_age", "age_sum", "seen_energy_j")


def machine() -> dict[str, str]:
    """On what floating-point numbers are the same to the last bit."""
    features = "".join(name for name, has in __cpu_features__.items() if has)
    found = versions(("numpy", "torch"))
    return {"processor": processor(), "features": _digest(features.encode()), **found}


def _digest(*arrays) -> str:
    found = hashlib.sha256()
    for array in arrays:
        found.update(array if isinstance(array, bytes) else np.ascontiguousarray(array).tobytes())
    return found.hexdigest()[:16]


def _episode(scenario, policy):
    """An episode of two environments: digests of it, and what floats come to."""
    world = World(scenario, 2)
    state = world.reset(
        node_codes(scenario, world.grid, [np.random.default_rng(i) for i in (0, 1)])
    )
    drawn, streams = np.random.default_rng(5), EpisodeStreams(0, 2)
    whole, real = [], []
    sums = 0.0
    chances = chance_for(world, range(2))
    for _ in range(world.num_slots):
        if policy is None:
            sizes = world.action_sizes
            action = np.stack([drawn.integers(0, n, (2, world.num_auvs)) for n in sizes], -1)
        else:
            action = policy.act(world, state, streams)
        state, events = world.step(state, action, next(chances))
        reward, seen = world.reward(state, events), world.observe(state)
        whole += [action, events.delivered, world.action_mask(state)]
        whole += [np.asarray(getattr(state, name), dtype=np.int64) for name in WHOLE]
        real += [reward, seen, events.beta, *(getattr(state, name) for name in REAL)]
        sums += np.array(
            [float(np.sum(reward)), float(np.sum(seen)), float(np.sum(state.energy_j))]
        )
    metrics = {name: np.asarray(values).tolist() for name, values in world.metrics(state).items()}
    return {
        "whole": _digest(*whole),
        "real": _digest(*real),
        "metrics": metrics,
        "sums": sums.tolist(),
        "energy_j": np.asarray(state.energy_j).tolist(),
    }


def record_scenario(name):
    """What is recorded of a scenario."""
    scenario = load_scenario(name)
    pinned = pin_layout(scenario, 0)
    return {
        "hash": scenario.hash,
        "world_hash": scenario.world_hash,
        "yaml": hashlib.sha256(to_yaml(scenario).encode()).hexdigest()[:16],
        "random actions": _episode(pinned, None),
        "greedy": _episode(pinned, make_baseline("greedy")),
    }


def record_trainings():
    """Digests of the weights of six trainings after three iterations."""
    from trainers import Trainer

    torch.set_num_threads(1)
    found = {}
    for name in TRAININGS:
        trainer = Trainer(load_scenario(name), 0, "cpu")
        for _ in range(3):
            trainer.iterate()
        found[name] = _digest(*(w.numpy() for _, w in sorted(trainer.weights(0).items())))
    return found


def record_outputs():
    """Digests of what `iout show` prints."""
    found = {}
    for name in bundled_names():
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            cli.main(["show", name])
        found[name] = _digest(printed.getvalue().encode())
    return found


def main() -> int:
    """Record, or compare."""
    found = {
        "machine": machine(),
        "scenarios": {name: record_scenario(name) for name in bundled_names()},
        "trainings": record_trainings(),
        "shown": record_outputs(),
    }
    found = json.loads(json.dumps(found))
    if "--compare" not in sys.argv:
        RECORDED.write_text(json.dumps(found, indent=1) + "\n")
        return 0
    recorded = json.loads(RECORDED.read_text())
    differing = [
        f"{what} of {name}"
        for what in ("scenarios", "trainings", "shown")
        for name in recorded[what]
        if recorded[what][name] != found[what].get(name)
    ]
    sys.stdout.write("\n".join(differing or ["all is equal"]) + "\n")
    return 1 if differing else 0


if __name__ == "__main__":
    sys.exit(main())
