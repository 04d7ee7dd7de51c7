"""A checkpoint is checked whole before a training continues from it."""

import copy
import io

import numpy as np
import pytest
import torch
from rich.console import Console

from iout_marl import InputError
from trainers import Trainer, train
from trainers.runs.checking import check_origin, check_state

VARIANTS = {
    "fixed nodes": {},
    "running normalisers, random layouts, tdd, two auvs": {
        "nodes": {"kind": "random", "count": 2},
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
        "duplex.kind": "tdd",
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
    },
    "limited view, difference rewards, a critic that sees more": {
        "auvs.start_cells": [[2, 1, 1], [1, 2, 1]],
        "observation.view_range_m": 60,
        "training.critic": "central",
        "reward.credit": "difference",
        "training.rollout_slots": 13,
    },
}


@pytest.fixture(scope="module", params=VARIANTS.values(), ids=list(VARIANTS))
def trained(request, tiny):
    """A state to continue from, and a trainer that could."""
    trainer = Trainer(tiny(request.param), seed=5)
    for _ in range(3):
        trainer.iterate()
    return trainer.state_dict(), Trainer(tiny(request.param), seed=5)


def check(saved, trainer):
    check_origin("file", saved)
    check_state("file", saved, trainer, 0)


def places(data, path=()):
    """Every place in nested mappings and lists, the value there along."""
    if path:
        yield path, data
    for key in (
        data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ()
    ):
        yield from places(data[key], (*path, key))


def changed(data, path, value):
    """The data with another value at a place; what is beside the way there is shared."""
    if not path:
        return value
    key, *rest = path
    copied = copy.copy(data)
    copied[key] = changed(data[key], rest, value)
    return copied


def refusal(saved, trainer):
    with pytest.raises(InputError) as raised:
        check(saved, trainer)
    message = str(raised.value)
    assert message.startswith("file: cannot be read: ")
    assert message.isprintable()
    return message


def test_states_of_trainings_pass(trained):
    check(*trained)


def test_states_of_the_beginning_pass(tiny):
    trainer = Trainer(tiny(), seed=5)
    check(trainer.state_dict(), trainer)


STRANGE = [
    None, True, -1, 2**70, 1.5, float("nan"), "x", [], {}, b"x", (),
    torch.zeros(()), torch.empty(0), torch.ones(3), torch.tensor(1, dtype=torch.int8),
    np.float64(1.0),
]  # fmt: skip


@pytest.mark.slow
def test_no_field_takes_what_it_is_not(trained):
    """Everywhere values of every other type: refused by the name of the place, or of its whole."""
    saved, trainer = trained
    for path, value in places(saved):
        for strange in STRANGE:
            if type(strange) is type(value):
                continue  # tensors of other kinds are tried below
            message = refusal(changed(saved, path, strange), trainer)
            assert str(path[0]) in message, (path, strange)


@pytest.mark.slow
def test_no_tensor_takes_other_shapes_types_or_values(trained):
    saved, trainer = trained
    for path, value in places(saved):
        if not isinstance(value, torch.Tensor):
            continue
        others = [value[None], value.flatten()[:0], value.to(torch.complex64), -1 - value.double()]
        others += [value.to_sparse(), value.to("meta")]
        if value.is_floating_point() and value.numel():
            others += [torch.full_like(value, float(bad)) for bad in ("nan", "inf")]
        for other in others:
            assert str(path[0]) in refusal(changed(saved, path, other), trainer), path


def test_nothing_is_missing_or_too_much(trained):
    saved, trainer = trained
    for path, value in places(saved):
        if isinstance(value, dict):
            assert "has " in refusal(changed(saved, path, {**value, "x": 1}), trainer)
            for key in value:
                lacking = {k: v for k, v in value.items() if k != key}
                assert key in refusal(changed(saved, path, lacking), trainer)
        if isinstance(value, list):
            assert "no list of" in refusal(changed(saved, path, [*value, 0]), trainer)
    assert "has 'x'" in refusal({**saved, "x": 1}, trainer)


@pytest.mark.parametrize(
    ("path", "value"),
    [
        (("env_steps",), 81),
        (("env_steps",), -80),
        (("env_steps",), 2**63),
        (("env_steps",), 10**400),
        (("seed",), -1),
        (("seed",), 2**64),
        (("side_by_side",), [4, 1]),
        (("side_by_side",), [5, 0]),
        (("side_by_side",), [-1, 10]),
        (("optimizer", "steps"), -1),
        (("optimizer", "steps"), 10**9),
        (("reward_scale", "moments"), [0.0, -1.0, 1.0]),
        (("reward_scale", "moments"), [0.0, 1.0, float("nan")]),
        (("collector", "layout_rng", "bit_generator"), "MT19937"),
        (("collector", "layout_rng", "has_uint32"), 2),
        (("collector", "layout_rng", "uinteger"), 2**32),
        (("collector", "layout_rng", "state", "state"), 2**128),
        (("collector", "layout_rng", "state", "inc"), -1),
    ],
    ids=str,
)
def test_numbers_out_of_range(trained, path, value):
    saved, trainer = trained
    assert path[-1] in refusal(changed(saved, path, value), trainer)


@pytest.mark.parametrize("name", ["cell", "node_cell", "slot", "age", "deliveries"])
@pytest.mark.parametrize("value", [-1, 10**6])
def test_states_that_no_world_comes_to(trained, name, value):
    saved, trainer = trained
    tensor = saved["collector"]["state"][name].clone()
    tensor[(0,) * tensor.ndim] = value
    message = refusal(changed(saved, ("collector", "state", name), tensor), trainer)
    assert f"'collector.state.{name}' is out of its range" in message


def test_cells_between_those_of_the_grid(tiny):
    trainer = Trainer(tiny(), seed=5)
    codes = set(
        trainer.collector.world.grid.encode(trainer.collector.world.grid.all_coordinates()).tolist()
    )
    between = next(code for code in range(max(codes)) if code not in codes)
    saved = trainer.state_dict()
    saved["collector"]["state"]["cell"][0] = between
    assert "'collector.state.cell' is out of its range" in refusal(saved, trainer)


def test_state_of_no_generator(trained):
    saved, trainer = trained
    garbage = torch.full_like(saved["collector"]["generator"], 255)
    message = refusal(changed(saved, ("collector", "generator"), garbage), trainer)
    assert "'collector.generator' is no state of a generator" in message


def test_of_several_policies_each_is_checked(tiny, tmp_path):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 1}
    train(tiny(), tmp_path, replicas=2, **quiet)
    for manifest in (tmp_path / "group.json", *tmp_path.glob("*/run.json")):
        manifest.unlink()
    path = tmp_path / "seed-1/checkpoint.pt"
    saved = torch.load(path, weights_only=True)
    saved["trainer"]["network"]["actor.0.bias"][0] = float("nan")
    torch.save(saved, path)
    with pytest.raises(
        InputError, match=r"seed-1/checkpoint\.pt: .* 'network\.actor\.0\.bias' is not"
    ):
        train(tiny({"training.steps": 800}), tmp_path, resume=True, **quiet)
