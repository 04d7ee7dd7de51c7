"""Functions whose gradients are written by hand, against what autograd makes of plain ones."""

import itertools

import pytest
import torch
from torch import nn

from iout_marl import machine
from trainers import ops
from trainers.networks import perceptron

CLIP, COEFFICIENT = 0.2, 0.03
#: (replicas, …) or nothing before the axis of samples.
LEADS = [(), (1,), (3,)]


def numbers(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def layers(lead, sizes):
    return [
        numbers(*lead, *shape, seed=i).requires_grad_()
        for a, b in itertools.pairwise(sizes)
        for i, shape in enumerate([(b, a), (b,)])
    ]


@pytest.mark.parametrize("lead", LEADS)
@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("sizes", [(4, 2), (4, 5, 2), (4, 5, 6, 1)])
def test_perceptron_and_its_gradients(lead, activation, sizes):
    parameters = layers(lead, sizes)
    inputs = numbers(*lead, 4, 7, seed=9).requires_grad_()
    weights = numbers(*lead, sizes[-1], 7, seed=8)
    results = []
    for function in (ops.perceptron, ops.reference_perceptron):
        output = function(inputs, parameters, activation)
        gradients = torch.autograd.grad((output * weights).sum(), [inputs, *parameters])
        results.append([output.detach(), *gradients])
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs)


@pytest.mark.parametrize("is_slow", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_tanh_by_either_way(monkeypatch, dtype, is_slow):
    monkeypatch.setattr(ops, "_has_slow_tanh", lambda: is_slow)
    special = [0.0, 1e-30, -40.0, 3e38, torch.inf, -torch.inf, torch.nan]
    values = torch.cat([torch.linspace(-12, 12, 10_001), torch.tensor(special)]).to(dtype)
    expected = values.tanh()
    found = ops.tanh_(values)
    assert found is values
    torch.testing.assert_close(
        found, expected, atol=2 * torch.finfo(dtype).eps, rtol=0, equal_nan=True
    )


@pytest.mark.parametrize(
    ("says", "is_by_intel"), [("GenuineIntel", True), ("AuthenticAMD", False), ("", False)]
)
def test_whose_processor_it_is(monkeypatch, says, is_by_intel):
    monkeypatch.setattr(machine, "_said_by_linux", lambda _: says)
    monkeypatch.setattr(machine.platform, "processor", lambda: "")
    assert machine.is_by_intel() is is_by_intel


def test_perceptron_leaves_its_inputs_as_they_are():
    inputs = numbers(4, 7)
    before = inputs.clone()
    ops.perceptron(inputs, layers((), (4, 3, 2)), "tanh").sum().backward()
    assert torch.equal(inputs, before)


def test_modules_are_nn_sequential_with_another_engine():
    torch.manual_seed(0)
    ours = perceptron(4, (8, 8), 3, "tanh", 1.0)
    theirs = nn.Sequential(*ours)
    for shape in [(), (5,), (2, 5), (2, 1, 5)]:
        x = torch.randn(*shape, 4)
        torch.testing.assert_close(ours(x), theirs(x))


def policy_batch(lead, *, impossible):
    logits = 3 * numbers(*lead, 50, 3, 6)
    if impossible:  # as padding and masks make them
        logits[..., 0, 2:] = -1e9
        logits[..., 20:, 1, :4] = -1e9
    logits.requires_grad_()
    action = torch.distributions.Categorical(logits=logits.detach()).sample()
    now = logits.detach().log_softmax(-1).gather(-1, action[..., None]).squeeze(-1).sum(-1)
    # As if the policy had moved since: some ratios are clipped, some are not.
    return logits, action, now + 0.3 * numbers(*lead, 50, seed=3), numbers(*lead, 50, seed=4)


@pytest.mark.parametrize("lead", LEADS)
@pytest.mark.parametrize("impossible", [False, True])
@pytest.mark.parametrize("samples", [50, 80])
def test_policy_loss_and_its_gradient(lead, impossible, samples):
    torch.manual_seed(0)
    logits, *others = policy_batch(lead, impossible=impossible)
    ours = ops.policy_loss(logits, *others, CLIP, COEFFICIENT, samples)
    theirs = ops.reference_policy_loss(logits, *others, CLIP, COEFFICIENT, samples)
    assert (theirs.clip_fraction > 0).all()
    assert (theirs.clip_fraction < 1).all()
    for name, expected in theirs._asdict().items():
        torch.testing.assert_close(getattr(ours, name).detach(), expected.detach(), msg=name)
    # Replicas must not mix, whatever each one's loss counts for.
    weights = torch.arange(1.0, 1.0 + lead[0]) if lead else torch.tensor(2.0)
    found, expected = (
        torch.autograd.grad((loss * weights).sum(), logits)[0] for loss in (ours.loss, theirs.loss)
    )
    torch.testing.assert_close(found, expected)


def test_probabilities_that_underflow_leave_no_denormal_numbers_in_the_gradient():
    logits, *others = policy_batch((), impossible=True)
    logits = logits.detach().float().requires_grad_()
    others = [others[0], *(o.float() for o in others[1:])]
    loss = ops.policy_loss(logits, *others, CLIP, COEFFICIENT, 50).loss
    (gradient,) = torch.autograd.grad(loss, logits)
    size = gradient.abs()
    assert not ((size > 0) & (size < torch.finfo(torch.float32).tiny)).any()
