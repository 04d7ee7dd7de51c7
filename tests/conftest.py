"""Fixtures of all tests: one thread, a scenario that is small in every respect, `iout`."""

import pytest
import torch

from iout_marl import load_scenario
from iout_marl.cli import main

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


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Tests share the cores with one another, and sums keep their order."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session")
def tiny():
    """Makes the tiny scenario of a bundled one, with changes of the caller's."""

    def make(changes=(), scenario="best/k3-fdd"):
        return load_scenario(load_scenario(scenario, TINY), changes)

    return make


@pytest.fixture(scope="session")
def tiny_settings():
    """The tiny scenario as options of the command line."""
    return [word for key, value in TINY.items() for word in ("--set", f"{key}={value}")]


@pytest.fixture
def iout(capsys):
    """Runs a command line; returns exit status, standard output and standard error."""

    def run(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return run
