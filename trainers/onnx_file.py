"""A trained policy as an ONNX file, which needs neither torch nor this software to be run.

| | name | shape | type | what |
|---|---|---|---|---|
| input | `observation` | (batch, entries) | float32 | as environments give it: scaling is inside |
| input | `mask` | (batch, choices) | bool | may be left out; choices that are false are not taken |
| output | `action` | (batch, action entries) | int64 | the most probable choices |
| output | `logits` | (batch, choices) | float32 | those of one entry of an action after the other |

Networks for node tables see their arrays instead, of any number of nodes, and of AUVs if there are
several:

| | name | shape | type |
|---|---|---|---|
| input | `context` | (batch, columns) | float32 |
| input | `nodes` | (batch, nodes, columns) | float32 |
| input | `auvs` | (batch, other AUVs, columns) | float32 |
| input | `action_mask` | (batch, choices) | bool |
"""

from __future__ import annotations

import copy
import logging
import warnings
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn
from torch.export import Dim

from iout_marl.errors import InputError, printable
from iout_marl.evaluation import play
from iout_marl.extras import require
from iout_marl.files import to_json
from iout_marl.scenario import Scenario
from iout_marl.world import World
from trainers.factory import PolicyByPolicy
from trainers.networks import IMPOSSIBLE, ActorCritic, Perceptron
from trainers.sets import Rows, SetActor
from trainers.trained import TrainedPolicy

#: By how much logits of onnxruntime and torch may differ, of those that are 1 or less; of larger
#: ones in proportion.
TOLERANCE = 1e-5
#: Slots of the episode that is compared.
MAX_COMPARED = 200
#: Version of ONNX's operators: what onnxruntime has known since 2023.
OPSET = 18

Floats: TypeAlias = npt.NDArray[np.float32]
Bools: TypeAlias = npt.NDArray[np.bool_]
#: By name of an input, the axes that may have other lengths.
Axes: TypeAlias = dict[str, dict[int, Any]]


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
    graph: OnnxPolicy | OnnxTablePolicy
    if isinstance(policy.network.actor, SetActor):
        graph = OnnxTablePolicy(policy.network, scenario)
    else:
        graph = OnnxPolicy(policy.network)
    contents = _written(graph.eval(), policy, scenario)
    _compare(contents, graph, policy, scenario)
    return contents


class OnnxPolicy(nn.Module):
    """Scaler and actor of trained networks, in plain modules on the CPU.

    Args:
        network: stays as it is.

    Attributes:
        sample: inputs by name, of numbers other than 0 and 1, for which exporters might make a
            graph of its own.
        axes: which axes of the inputs may have other lengths.
    """

    def __init__(self, network: ActorCritic) -> None:
        super().__init__()
        self.network = network = _plain(copy.deepcopy(network).cpu())
        self._flat = [
            entry * network.width + choice
            for entry, size in enumerate(network.action_sizes)
            for choice in range(size)
        ]
        choices = sum(network.action_sizes)
        self.sample = {
            "observation": torch.zeros(2, network.observation_entries),
            "mask": torch.ones(2, choices, dtype=torch.bool),
        }
        batch = {0: Dim("batch")}
        self.axes: Axes = {"observation": batch, "mask": batch}

    def forward(self, observation: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
        """See the module."""
        logits = self.network.logits(self.network.scaler(observation), mask)
        return self.network.greedy_action(logits), logits.flatten(-2)[..., self._flat]

    def finish(self, model: Any) -> None:
        """Give the mask a default, which allows everything and serves a batch of any size."""
        from onnx import numpy_helper

        (mask,) = [each for each in model.graph.input if each.name == "mask"]
        mask.type.tensor_type.shape.dim[0].dim_param = "batch_or_1"
        everything = self.sample["mask"][:1].numpy()
        model.graph.initializer.append(numpy_helper.from_array(everything, "mask"))

    def given(self, seen: Floats, mask: Bools | None) -> dict[str, npt.NDArray[Any]]:
        """Inputs by name: (batch, entries) observations, and (batch, choices) masks or none."""
        return {"observation": seen} | ({} if mask is None else {"mask": mask})


class OnnxTablePolicy(nn.Module):
    """The actor of networks for node tables, for any number of nodes, and of AUVs if several.

    Args:
        network: stays as it is.
        scenario: whose sizes are compared, with node tables as its observation.

    Attributes:
        sample, axes: as of `OnnxPolicy`.
    """

    def __init__(self, network: ActorCritic, scenario: Scenario) -> None:
        super().__init__()
        world = World(scenario)
        layout, sizes = world.observer.layout, world.action_sizes
        assert layout is not None
        self.actor: Any = _plain(copy.deepcopy(network.actor).cpu())
        self._layout, self._moves = layout, layout.moves * layout.move_columns
        self._directions, *others = sizes
        #: Choices that are no node: nobody.
        self._beside = [size - layout.nodes for size in others]
        self._choices = sum(sizes)
        nodes, auvs = 3, 2
        choices = self._directions + len(others) * nodes + sum(self._beside)
        self.sample = {
            "context": torch.zeros(2, layout.context),
            "nodes": torch.zeros(2, nodes, layout.node_entries),
            "action_mask": torch.ones(2, choices, dtype=torch.bool),
        }
        batch, count = Dim("batch"), Dim("nodes")
        counted: Any = len(others) * count + self._directions + sum(self._beside)
        self.axes: Axes = {
            "context": {0: batch},
            "nodes": {0: batch, 1: count},
            "action_mask": {0: batch, 1: counted},
        }
        if layout.auvs:
            self.sample["auvs"] = torch.zeros(2, auvs, layout.auv_columns)
            self.axes["auvs"] = {0: batch, 1: Dim("auvs")}

    def forward(
        self, context: Tensor, nodes: Tensor, action_mask: Tensor, auvs: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """See the module."""
        sizes = [self._directions, *(nodes.shape[1] + beside for beside in self._beside)]
        masks = iter(torch.split(action_mask.mT, sizes))
        logits, action = [], []

        def choose(found: Tensor) -> Tensor:
            logits.append(found.masked_fill(~next(masks), IMPOSSIBLE))
            action.append(logits[-1].argmax(-2))
            return action[-1]

        of_auvs = context.new_zeros(context.shape[0], 0, 0) if auvs is None else auvs
        own, moves = torch.split(nodes, [self._layout.node_columns, self._moves], dim=-1)
        by_move = torch.unflatten(moves, -1, (self._layout.move_columns, self._layout.moves))
        self.actor.decide_by(
            Rows(
                context.mT.unsqueeze(-2),
                of_auvs.permute(2, 1, 0),
                own.permute(2, 1, 0),
                by_move.permute(2, 3, 1, 0),
            ),
            choose,
        )
        return torch.stack(action, dim=-1), torch.cat(logits).mT

    def finish(self, model: Any) -> None:
        """Call the axis of logits as that of the mask, which has the same length."""
        (mask,) = [each for each in model.graph.input if each.name == "action_mask"]
        (logits,) = [each for each in model.graph.output if each.name == "logits"]
        logits.type.CopyFrom(mask.type)
        logits.type.tensor_type.elem_type = 1  # float32

    def given(self, seen: Floats, mask: Bools | None) -> dict[str, npt.NDArray[Any]]:
        """Inputs by name: (batch, entries) observations, and (batch, choices) masks or none."""
        everything = np.ones((len(seen), self._choices), dtype=np.bool_)
        return {
            **{name: np.ascontiguousarray(rows) for name, rows in self._layout.rows(seen).items()},
            "action_mask": everything if mask is None else mask,
        }


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


def _written(
    graph: OnnxPolicy | OnnxTablePolicy, policy: TrainedPolicy, scenario: Scenario
) -> bytes:
    import onnx

    for library in ("torch.onnx", "onnxscript"):
        logging.getLogger(library).setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            program = torch.onnx.export(
                graph,
                kwargs=graph.sample,
                dynamo=True,
                input_names=list(graph.sample),
                output_names=["action", "logits"],
                dynamic_shapes=graph.axes,
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
    graph.finish(model)
    about = {
        "software": "iout_marl",
        "scenario": scenario.name,
        "scenario_hash": scenario.hash,
        "action_sizes": to_json(list(policy.network.action_sizes)),
        "trained_with_mask": to_json(policy.use_mask),
    }
    onnx.helper.set_model_props(model, {key: printable(value) for key, value in about.items()})
    onnx.checker.check_model(model, full_check=True)
    contents: bytes = model.SerializeToString()
    return contents


def _compare(
    contents: bytes,
    graph: OnnxPolicy | OnnxTablePolicy,
    policy: TrainedPolicy,
    scenario: Scenario,
) -> None:
    """See that onnxruntime finds what torch does, on the observations of an episode."""
    from onnxruntime import InferenceSession, SessionOptions

    world = World(scenario)
    states = [state for state, _ in islice(play(world, policy), MAX_COMPARED)]
    seen = np.concatenate([world.observe(state)[0] for state in states]).astype(np.float32)
    masks = np.concatenate([world.action_mask(state)[0] for state in states])
    options = SessionOptions()
    options.log_severity_level = 3  # that the mask is optional would be a warning
    session = InferenceSession(contents, options, providers=["CPUExecutionProvider"])
    network = copy.deepcopy(policy.network).cpu()
    if world.observer.layout is not None and network.layout is not None:
        network = network.sized_for(world.observer.layout, world.action_sizes)
    for mask in (masks, None):
        action, found = session.run(["action", "logits"], graph.given(seen, mask))
        with torch.no_grad():
            expected = network.logits(
                network.scaler(torch.from_numpy(seen)),
                None if mask is None else torch.from_numpy(mask),
                torch.from_numpy(action),
            )
        sizes = enumerate(network.action_sizes)
        logits = torch.cat([expected[:, entry, :size] for entry, size in sizes], dim=-1).numpy()
        worst = float((np.abs(found - logits) / np.maximum(1, np.abs(logits))).max())
        if not worst <= TOLERANCE:
            raise InputError(
                f"{policy.name}: cannot be written in ONNX: onnxruntime finds logits that differ "
                f"from those of torch by {worst:.1e}"
            )
