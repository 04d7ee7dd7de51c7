"""Training is the same by compiled slots, to the last digit."""

import pytest
import torch

from iout_marl.compiled import choice
from iout_marl.scenario import load_scenario
from trainers import Trainer


@pytest.mark.slow
@pytest.mark.parametrize("mask", [True, False])
def test_training_by_compiled_slots_is_the_same(monkeypatch, mask):
    pytest.importorskip("llvmlite")
    scenario = load_scenario("paper/k3-fdd", {"training.mask_actions": mask})
    trainers = []
    for said in ("never", "always"):
        monkeypatch.setenv(choice.VARIABLE, said)
        trainers.append(Trainer(scenario))
        trainers[-1].iterate()
    one, other = (trainer.network.state_dict() for trainer in trainers)
    assert one.keys() == other.keys()
    assert all(torch.equal(one[name], other[name]) for name in one)
