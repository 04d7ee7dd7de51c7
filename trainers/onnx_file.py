"""A trained policy as an ONNX file, which needs neither torch nor this software to be run.

| | name | shape | type | what |
|---|---|---|---|---|
| input | `observation` | (batch, entries) | float32 | as environments give it: scaling is inside |
| input | `mask` | (batch, choices) | bool | may be left out; choices that are false are not taken |
| output | `action` | (batch, action entries) | int64 | the most probable choices |
| output | `logits` | (batch, choices) | float32 | those of one entry of an action after the other |
"""

from __future__ import annotations

import copy
import logging
import warnings
from itertools import islice
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from iout_marl.errors import InputError, printable
from iout_marl.evaluation import play
from iout_marl.extras import require
from iout_marl.files import to_json
from iout_marl.scenario import Scenario
from iout_marl.world import World
from trainers.factory import PolicyByPolicy
from trainers.networks import ActorCritic, Perceptron
from trainers.trained import TrainedPolicy

#: By how much logits of onnxruntime and torch may differ, of those that are 1 or less; of larger
#: ones in proportion.
TOLERANCE = 1e-5
#: Slots of the episode that is compared.
MAX_COMPARED = 200
#: Version of ONNX's operators: what onnxruntime has known since 2023.
OPSET = 18


def onnx_file(policy: TrainedPolicy, scenario: Scenario) -> bytes:
    """A policy's most probable actions as the contents of an ONNX file, compared with torch's.

    Args:
        policy: what to write; its weights may be on any device.
        scenario: that of its training.

    Raises:
        InputError: the extra `onnx` is not installed; its networks cannot be written in ONNX, or
            onnxruntime finds something else than torch.
    """
    require("ONNX", "onnx")
    graph = OnnxPolicy(policy.network)
    contents = _written(graph, policy, scenario)
    _compare(contents, graph, policy, scenario)
    return contents


class OnnxPolicy(nn.Module):
    """Scaler and actor of trained networks, in plain modules on the CPU.

    Args:
        network: stays as it is.
    """

    def __init__(self, network: ActorCritic) -> None:
        super().__init__()
        network = _plain(copy.deepcopy(network).cpu().eval())
        self.network = network
        self._flat = [
            entry * network.width + choice
            for entry, size in enumerate(network.action_sizes)
            for choice in range(size)
        ]

    def forward(self, observation: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """See the module."""
        logits = self.network.logits(self.network.scaler(observation), mask)
        return self.network.greedy_action(logits), logits.flatten(-2)[..., self._flat]


def _plain(module: Any) -> Any:
    """A module with plain ones for those that are made for training."""
    for name, child in module.named_children():
        found: Any = child
        if isinstance(child, PolicyByPolicy):
            found = child.module
        elif isinstance(child, Perceptron):
            found = nn.Sequential(*child)
        setattr(module, name, _plain(found))
    return module


def _written(graph: OnnxPolicy, policy: TrainedPolicy, scenario: Scenario) -> bytes:
    import onnx

    network = graph.network
    entries, choices = network.observation_entries, sum(network.action_sizes)
    # Any number but 0 and 1, for which exporters might make a graph of its own.
    sample = torch.zeros(2, entries), torch.ones(2, choices, dtype=torch.bool)
    batch = {0: torch.export.Dim("batch")}
    logging.getLogger("torch.onnx").setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                graph,
                sample,
                dynamo=True,
                input_names=["observation", "mask"],
                output_names=["action", "logits"],
                dynamic_shapes={"observation": batch, "mask": batch},
                opset_version=OPSET,
                verbose=False,
            )
    except Exception as error:
        # What a network does that no graph can stands in the innermost of the exporter's errors.
        inner: BaseException = error
        while inner.__cause__ is not None:
            inner = inner.__cause__
        why = (str(inner).strip() or type(inner).__name__).splitlines()[0]
        raise InputError(f"{policy.name}: cannot be written in ONNX: {why}") from None
    assert program is not None, "what is exported through torch.export is returned"
    model = program.model_proto
    _make_mask_optional(model, choices)
    about = {
        "software": "iout_marl",
        "scenario": scenario.name,
        "scenario_hash": scenario.hash,
        "action_sizes": to_json(list(network.action_sizes)),
        "trained_with_mask": to_json(policy.use_mask),
    }
    onnx.helper.set_model_props(model, {key: printable(value) for key, value in about.items()})
    onnx.checker.check_model(model, full_check=True)
    contents: bytes = model.SerializeToString()
    return contents


def _make_mask_optional(model: Any, choices: int) -> None:
    """Give the mask a default, which allows everything and serves a batch of any size."""
    from onnx import numpy_helper

    (mask,) = [each for each in model.graph.input if each.name == "mask"]
    mask.type.tensor_type.shape.dim[0].dim_param = "batch_or_1"
    everything = np.ones((1, choices), dtype=np.bool_)
    model.graph.initializer.append(numpy_helper.from_array(everything, "mask"))


def _compare(contents: bytes, graph: OnnxPolicy, policy: TrainedPolicy, scenario: Scenario) -> None:
    """See that onnxruntime finds what torch does, on the observations of an episode."""
    from onnxruntime import InferenceSession, SessionOptions

    world = World(scenario)
    states = [state for state, _ in islice(play(world, policy), MAX_COMPARED)]
    seen = np.concatenate([world.observe(state)[0] for state in states]).astype(np.float32)
    masks = np.concatenate([world.action_mask(state)[0] for state in states])
    options = SessionOptions()
    options.log_severity_level = 3  # that the mask is optional would be a warning
    session = InferenceSession(contents, options, providers=["CPUExecutionProvider"])
    for mask in (masks, None):
        given = {"observation": seen} if mask is None else {"observation": seen, "mask": mask}
        _, found = session.run(None, given)
        allowed = torch.ones(len(seen), masks.shape[1], dtype=torch.bool)
        with torch.no_grad():
            _, expected = graph(
                torch.from_numpy(seen), allowed if mask is None else torch.from_numpy(mask)
            )
        logits = expected.numpy()
        worst = float((np.abs(found - logits) / np.maximum(1, np.abs(logits))).max())
        if not worst <= TOLERANCE:
            raise InputError(
                f"{policy.name}: cannot be written in ONNX: onnxruntime finds logits that differ "
                f"from those of torch by {worst:.1e}"
            )
