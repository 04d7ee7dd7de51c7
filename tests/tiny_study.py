"""A scenario that is small in every respect, a study of it, and a pool without processes."""

import json
import os
import signal
import time

from iout_marl.study.pools import LocalProcesses
from iout_marl.study.worker import run_cell

#: Two nodes in six cells, episodes of 20 slots, seven iterations of a few milliseconds.
TINY = {
    "grid.cells": [3, 2, 1],
    "nodes.cells": [[1, 1, 1], [3, 2, 1]],
    "nodes.count": 2,
    "auvs.start_cells": [[2, 1, 1]],
    "episode.duration_s": 500,
    "age.maximum": 15,
    "training.steps": 560,
    "training.environments": 4,
    "training.rollout_slots": 20,
    "training.epochs": 2,
    "training.minibatches": 2,
    "training.hidden_units": [8],
    "training.checkpoint_steps": 240,
}

#: The same with a third node, of which `nodes.count` chooses.
SETTINGS = {**TINY, "nodes.cells": [*TINY["nodes.cells"], [1, 2, 1]]}
#: Seconds after which something that is waited for is given up.
PATIENCE_S = 120

#: Nodes 1 to 3, two policies, two seeds.
STUDY = {
    "title": "A tiny study",
    "quick": {"axis": [2], "seeds": 1},
    "groups": {
        "baseline": {
            "scenarios": ["paper/k3-fdd"],
            "policies": ["greedy"],
            "seeds": [7],
            "episodes": 3,
            "settings": SETTINGS,
            "grid": {"nodes.count": [1, 2]},
        },
        "trained": {
            "series": "{policy}, {variant}",
            "scenarios": ["paper/k3-fdd"],
            "policies": ["ppo"],
            "seeds": [0, 1],
            "episodes": 1,
            "settings": {**SETTINGS, "nodes.count": 2},
            "variants": {"paper": {}, "no age": {"reward.age_weight": 0}},
        },
    },
}


def wait_for(condition):
    """What `condition` returns, as soon as that is true."""
    end = time.monotonic() + PATIENCE_S
    while not (found := condition()):
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)
    return found


def write_study(path, **changes):
    """Writes the tiny study, top-level keys changed, as YAML (of which JSON is a part)."""
    path.write_text(json.dumps({**STUDY, **changes}, indent=2), encoding="utf-8")
    return path


def let_last(path):
    """Give the trainings of a study so many seeds that whoever is to stop it is never too late."""
    study = json.loads(path.read_text())
    for group in study["groups"].values():
        if "ppo" in group["policies"]:
            group["seeds"] = list(range(40))
    path.write_text(json.dumps(study))


class SameProcess:
    """A pool that runs one cell after the other, here; `broken` maps keys of cells to errors."""

    def __init__(self, broken=None, stop_after=None):
        self.broken = broken or {}
        self.stop_after = stop_after
        self.ran = []

    def describe(self):
        return "this process"

    def run(self, cells, carbon_g_per_kwh):
        for cell in cells:
            if len(self.ran) == self.stop_after:
                raise KeyboardInterrupt
            self.ran.append(cell.key)
            yield cell, self.broken.get(cell.key) or run_cell(cell, carbon_g_per_kwh)


def die_as_no_1(cell, carbon_g_per_kwh):
    """Runs a cell, unless its seed is 1: then the process kills itself."""
    if cell.trains and cell.seed == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return run_cell(cell, carbon_g_per_kwh)


class DeadlyProcesses(LocalProcesses):
    """Processes that do not survive cells of seed 1."""

    task = staticmethod(die_as_no_1)


def with_training(scenario, **settings):
    """The scenario with settings of its training that its schema might refuse."""
    training = scenario.training.model_copy(update=settings)
    return scenario.model_copy(update={"training": training})
