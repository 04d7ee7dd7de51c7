"""Whether a state that was read from a file is one that a training can continue from."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.world import redraws_every_episode
from trainers.base import BaseTrainer

#: What seeds and states of generators stay below.
_SEEDS, _WORDS, _STATES = 2**64, 2**32, 2**128


def check_like(path: Path, value: Any, like: Any, where: str = "") -> None:
    """Refuse what is not of the structure, types and shapes of an example, or is not finite.

    Args:
        path: the file, for the message.
        value: what was read.
        like: the example: tensors and plain values in mappings and lists.
        where: what to call the value.

    Raises:
        InputError: it names the file and the place in it.
    """
    name = repr(where) if where else "what is in it"
    if isinstance(like, dict):
        if not isinstance(value, dict):
            _refuse(path, f"{name} is no mapping")
        if lacking := [key for key in like if key not in value]:
            _refuse(path, f"lacks {_below(where, lacking[0])!r}")
        if unknown := [key for key in value if key not in like]:
            _refuse(path, f"has {_below(where, str(unknown[0])[:40])!r}, unknown here")
        for key, each in like.items():
            check_like(path, value[key], each, _below(where, key))
    elif isinstance(like, list):
        if not isinstance(value, list) or len(value) != len(like):
            _refuse(path, f"{name} is no list of {len(like)}")
        for i, each in enumerate(like):
            check_like(path, value[i], each, f"{where}[{i}]")
    elif isinstance(like, Tensor):
        _check_tensor(path, value, like, name)
    elif type(value) is not type(like):
        _refuse(path, f"{name} is of type {type(value).__name__}, not {type(like).__name__}")
    elif isinstance(value, float) and not math.isfinite(value):
        _refuse(path, f"{name} is not finite")


def _check_tensor(path: Path, value: Any, like: Tensor, name: str) -> None:
    if not isinstance(value, Tensor):
        _refuse(path, f"{name} is of type {type(value).__name__}, not a tensor")
    found = (value.dtype, tuple(value.shape), value.layout, value.device.type)
    if found != (like.dtype, tuple(like.shape), torch.strided, "cpu"):
        _refuse(
            path,
            f"{name} is a tensor of {value.dtype}, shape {tuple(value.shape)}, "
            f"not of {like.dtype}, shape {tuple(like.shape)}",
        )
    if not value.isfinite().all():
        _refuse(path, f"{name} is not finite")


def _below(where: str, key: str) -> str:
    return f"{where}.{key}" if where else key


def _refuse(path: Path, fault: str) -> NoReturn:
    raise InputError(f"{path}: cannot be read: {fault}")


def check_origin(path: Path, saved: dict[str, Any]) -> None:
    """Check what says which policies were trained, before a trainer for them is built.

    Raises:
        InputError: it names the file and the place in it.
    """
    example = {"env_steps": 0, "seed": 0, "side_by_side": [0, 0]}
    found = {key: saved[key] for key in example if key in saved}
    check_like(path, found, example)
    first, count = saved["side_by_side"]
    if not 0 <= saved["seed"] < _SEEDS:
        _refuse(path, "'seed' is no seed")
    if count < 1 or not 0 <= first <= saved["seed"] < first + count <= _SEEDS:
        _refuse(path, "'side_by_side' does not hold the seed")
    if not 0 <= saved["env_steps"] < 2**63:
        _refuse(path, "'env_steps' is out of its range")


def check_state(path: Path, saved: dict[str, Any], trainer: BaseTrainer, policy: int) -> None:
    """Refuse a `Trainer.state_dict` that a training cannot continue from.

    Args:
        path: the file, for the message.
        saved: what was read.
        trainer: one of the same scenario, seeds and settings, as it was built.
        policy: which of its policies this is.

    Raises:
        InputError: it names the file and the place in it.
    """
    settings, like = trainer.settings, trainer.state_dict(policy)
    if settings.reward_scaling == "running" and saved["env_steps"]:
        shape = (settings.environments, trainer.collector.world.num_auvs)
        like["reward_scale"]["return"] = torch.zeros(shape)
    _allow_other_sums(saved, like)
    check_like(path, saved, like)
    for name, is_right in _ranges(saved, like, trainer, policy):
        if not is_right:
            _refuse(path, f"{name!r} is out of its range")
    try:
        torch.Generator(trainer.runtime.device).set_state(saved["collector"]["generator"])
    except RuntimeError:
        _refuse(path, "'collector.generator' is no state of a generator")


def _allow_other_sums(saved: dict[str, Any], like: dict[str, Any]) -> None:
    """Other metrics may be registered now than when a checkpoint was made."""
    collector = saved.get("collector")
    sums = collector.get("sums") if isinstance(collector, dict) else None
    like["collector"].pop("sums", None)
    if isinstance(sums, dict):
        one = torch.zeros_like(like["collector"]["state"]["mean_age"])
        like["collector"]["sums"] = dict.fromkeys(sums, one)


def _ranges(
    saved: dict[str, Any], fresh: dict[str, Any], trainer: BaseTrainer, policy: int
) -> Iterator[tuple[str, bool]]:
    """What has to hold, by the name of what it is about."""
    settings, scenario = trainer.settings, trainer.scenarios[policy]
    steps, per_iteration = saved["env_steps"], trainer.steps_per_iteration
    # Rollouts of training.over and of teachers are of other lengths: a step or more.
    is_even = not settings.over and settings.imitate is None
    yield "env_steps", steps >= 0 and (not is_even or steps % per_iteration == 0)
    iterations = steps // per_iteration if is_even else steps
    epochs = settings.epochs
    if settings.imitate is not None:
        epochs = max(epochs, settings.imitation_epochs)
    most = iterations * epochs * settings.minibatches
    yield "optimizer.steps", 0 <= saved["optimizer"]["steps"] <= most
    if "second" in saved["optimizer"]:
        yield "optimizer.second", bool((saved["optimizer"]["second"] >= 0).all())
    _, variance, number = saved["reward_scale"]["moments"]
    yield "reward_scale.moments", variance >= 0 and number >= 0
    for name, tensor in saved["network"].items():
        if name.endswith((".scale", "return_std")):
            yield f"network.{name}", bool((tensor > 0).all())
        elif name.endswith("count"):
            yield f"network.{name}", bool((tensor >= 0).all())
    yield from _rng_ranges("collector.layout_rng", saved["collector"]["layout_rng"])
    if settings.over:
        yield from _rng_ranges("over.rng", saved["over"]["rng"])
        for i, gap in enumerate(saved["over"]["gaps"]):
            yield f"over.gaps.{i}", -1 <= gap < math.inf
    if settings.imitate is not None:
        yield "imitation", 0 <= saved["imitation"] < math.inf
    state, world = saved["collector"]["state"], trainer.collector.world
    for name, tensor in state.items():
        yield f"collector.state.{name}", bool((tensor >= 0).all())
    # What training.over draws is played in states of its own, from their beginning.
    slots = 0 if settings.over else steps // settings.environments
    yield "collector.state.slot", bool((state["slot"] == slots % world.num_slots).all())
    yield "collector.state.age", bool((state["age"] <= scenario.age.maximum).all())
    most = slots * world.num_auvs
    yield "collector.state.deliveries", bool((state["deliveries"] <= most).all())
    codes = torch.from_numpy(world.grid.encode(world.grid.all_coordinates()))
    for name in ("cell", "node_cell"):
        yield f"collector.state.{name}", bool(torch.isin(state[name], codes).all())
    if not redraws_every_episode(scenario):
        placed = fresh["collector"]["state"]["node_cell"]
        yield "collector.state.node_cell", torch.equal(state["node_cell"], placed)


def _rng_ranges(name: str, rng: dict[str, Any]) -> Iterator[tuple[str, bool]]:
    """What has to hold of the state of a NumPy generator."""
    like = np.random.default_rng(0).bit_generator.state
    yield f"{name}.bit_generator", rng["bit_generator"] == like["bit_generator"]
    for key in ("state", "inc"):
        yield f"{name}.state.{key}", 0 <= rng["state"][key] < _STATES
    yield f"{name}.has_uint32", rng["has_uint32"] in (0, 1)
    yield f"{name}.uinteger", 0 <= rng["uinteger"] < _WORDS
