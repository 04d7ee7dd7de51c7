"""Functions whose gradients are written by hand, against what autograd makes of plain ones."""

import itertools

import pytest
import torch
from torch import nn

from trainers import functions
from trainers.networks import perceptron

CLIP, COEFFICIENT = 0.2, 0.03
#: (replicas, …) or nothing before the axis of samples.
LEADS = [(), (3,)]


def numbers(*shape, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(*shape, generator=generator, dtype=torch.float64)


def layers(lead, sizes):
    return [
        numbers(*lead, *shape, seed=i).requires_grad_()
        for a, b in itertools.pairwise(sizes)
        for i, shape in enumerate([(b, a), (b,)])
    ]


def plain_perceptron(inputs, parameters, activation):
    """By torch's own functions, one network after the other."""
    if inputs.ndim == 3:
        rows = zip(inputs, *parameters, strict=True)
        return torch.stack([plain_perceptron(x, p, activation) for x, *p in rows])
    x = inputs.T
    for i in range(0, len(parameters), 2):
        x = nn.functional.linear(x, parameters[i], parameters[i + 1])
        if i + 2 < len(parameters):
            x = torch.tanh(x) if activation == "tanh" else torch.relu(x)
    return x.T


@pytest.mark.parametrize("lead", LEADS)
@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("sizes", [(4, 2), (4, 5, 2), (4, 5, 6, 1)])
def test_perceptron_and_its_gradients(lead, activation, sizes):
    parameters = layers(lead, sizes)
    inputs = numbers(*lead, 4, 7, seed=9).requires_grad_()
    weights = numbers(*lead, sizes[-1], 7, seed=8)
    results = []
    for function in (functions.perceptron, plain_perceptron):
        output = function(inputs, parameters, activation)
        gradients = torch.autograd.grad((output * weights).sum(), [inputs, *parameters])
        results.append([output.detach(), *gradients])
    for ours, theirs in zip(*results, strict=True):
        torch.testing.assert_close(ours, theirs)


def test_perceptron_leaves_its_inputs_as_they_are():
    inputs = numbers(4, 7)
    before = inputs.clone()
    functions.perceptron(inputs, layers((), (4, 3, 2)), "tanh").sum().backward()
    assert torch.equal(inputs, before)


def test_modules_are_nn_sequential_with_another_engine():
    torch.manual_seed(0)
    ours = perceptron(4, (8, 8), 3, "tanh", 1.0)
    theirs = nn.Sequential(*ours)
    for shape in [(), (5,), (2, 5), (2, 1, 5)]:
        x = torch.randn(*shape, 4)
        torch.testing.assert_close(ours(x), theirs(x))


def plain_policy_loss(scores, action, before, advantage, samples):
    log_p = scores.log_softmax(-1)
    log_ratio = log_p.gather(-1, action[..., None]).squeeze(-1).sum(-1) - before
    ratio = log_ratio.exp()
    clipped = ratio.clamp(1 - CLIP, 1 + CLIP)
    surrogate = -torch.minimum(ratio * advantage, clipped * advantage).sum(-1) / samples
    entropy = -(log_p.exp() * log_p).sum((-3, -2, -1)) / samples
    return functions.PolicyLoss(
        surrogate - COEFFICIENT * entropy,
        surrogate,
        entropy,
        (ratio - 1 - log_ratio).sum(-1) / samples,
        (ratio != clipped).double().sum(-1) / samples,
    )


def policy_batch(lead, *, impossible):
    scores = 3 * numbers(*lead, 50, 3, 6)
    if impossible:  # as padding and masks make them
        scores[..., 0, 2:] = -1e9
        scores[..., 20:, 1, :4] = -1e9
    scores.requires_grad_()
    action = torch.distributions.Categorical(logits=scores.detach()).sample()
    now = scores.detach().log_softmax(-1).gather(-1, action[..., None]).squeeze(-1).sum(-1)
    # As if the policy had moved since: some ratios are clipped, some are not.
    return scores, action, now + 0.3 * numbers(*lead, 50, seed=3), numbers(*lead, 50, seed=4)


@pytest.mark.parametrize("lead", LEADS)
@pytest.mark.parametrize("impossible", [False, True])
@pytest.mark.parametrize("samples", [50, 80])
def test_policy_loss_and_its_gradient(lead, impossible, samples):
    torch.manual_seed(0)
    scores, *others = policy_batch(lead, impossible=impossible)
    ours = functions.policy_loss(scores, *others, CLIP, COEFFICIENT, samples)
    theirs = plain_policy_loss(scores, *others, samples)
    assert (theirs.clip_fraction > 0).all()
    assert (theirs.clip_fraction < 1).all()
    for name, expected in theirs._asdict().items():
        torch.testing.assert_close(getattr(ours, name).detach(), expected.detach(), msg=name)
    # Replicas must not mix, whatever each one's loss counts for.
    weights = torch.arange(1.0, 4.0)[: len(ours.loss)] if lead else torch.tensor(2.0)
    found, expected = (
        torch.autograd.grad((loss * weights).sum(), scores)[0] for loss in (ours.loss, theirs.loss)
    )
    torch.testing.assert_close(found, expected)


def test_probabilities_that_underflow_leave_no_denormal_numbers_in_the_gradient():
    scores, *others = policy_batch((), impossible=True)
    scores = scores.detach().float().requires_grad_()
    others = [others[0], *(o.float() for o in others[1:])]
    loss = functions.policy_loss(scores, *others, CLIP, COEFFICIENT, 50).loss
    (gradient,) = torch.autograd.grad(loss, scores)
    size = gradient.abs()
    assert not ((size > 0) & (size < torch.finfo(torch.float32).tiny)).any()
