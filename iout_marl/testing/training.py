"""Contract tests of the parts of a training: networks and optimizers."""

from __future__ import annotations

import math
from typing import Any

from iout_marl.scenario import Scenario, load_scenario

#: A short training of a small network.
SHORT = {
    "training.environments": 4,
    "training.rollout_slots": 8,
    "training.minibatches": 2,
    "training.epochs": 2,
    "training.hidden_units": [8],
}
ITERATIONS = 2
#: Rounding of float32, in sums of another order.
ROUNDING = 1e-3


def check_training(scenario: Scenario) -> None:
    """Train on a scenario for a moment.

    Figures and weights are finite, and weights change; the same seed leads to the same weights;
    a policy trained beside another is what it would be alone; and a training continues from its
    state as if it had never stopped.

    Raises:
        AssertionError: one of these fails.
    """
    import torch

    from trainers import Trainer

    scenario = load_scenario(scenario, SHORT)
    first, again = (Trainer(scenario, 1) for _ in range(2))
    beside = Trainer(scenario, 0, replicas=2)
    before = first.weights()
    state = first.state_dict()
    for _ in range(ITERATIONS):
        figures = first.iterate()
        again.iterate()
        beside.iterate_all()
        state_before, state = state, first.state_dict()
    for tag, figure in figures.items():
        assert math.isfinite(figure), f"{tag} is {figure}"
    after = first.weights()
    for name, tensor in after.items():
        assert tensor.isfinite().all(), f"{name} is not finite"
    assert any(not torch.equal(after[name], before[name]) for name in after), "nothing is learnt"
    _compare(again.weights(), after, "the same seed leads to other weights", 0)
    _compare(beside.weights(1), after, "beside another policy it learns something else", ROUNDING)
    continued = Trainer(scenario, 5)
    continued.load_state_dict(state_before)
    continued.iterate()
    _compare(continued.weights(), after, "it does not continue from its state", 0)


def _compare(found: dict[str, Any], expected: dict[str, Any], fault: str, limit: float) -> None:
    import torch

    for name, tensor in expected.items():
        assert torch.allclose(found[name], tensor, limit, limit / 10), f"{fault} ({name})"
