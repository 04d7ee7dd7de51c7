"""Adam on one row of weights, against torch's on many."""

import pytest
import torch
from torch import nn

from trainers.adam import Adam, clipped

SHAPES = [(4, 3), (4,), (1, 4), (1,)]
EPSILON = 1e-5


def parameters(lead=(), seed=0):
    torch.manual_seed(seed)
    return [nn.Parameter(torch.randn(*lead, *shape)) for shape in SHAPES]


def gradients(like, seed):
    torch.manual_seed(seed)
    return [torch.randn_like(p) * 10 ** torch.randn(1) for p in like]


@pytest.mark.parametrize("maximum", [0.5, 1e9])
def test_steps_are_those_of_torch(maximum):
    ours, theirs = parameters(), parameters()
    adam = Adam(ours, EPSILON)
    reference = torch.optim.Adam(theirs, eps=EPSILON)
    for i in range(20):
        rate = 1e-2 / (1 + i)
        for p, q, gradient in zip(ours, theirs, gradients(ours, i), strict=True):
            p.grad, q.grad = gradient.clone(), gradient.clone()
        row, norm = clipped(adam.gradient(), maximum)
        adam.step(row, rate)
        expected = nn.utils.clip_grad_norm_(theirs, maximum)
        reference.param_groups[0]["lr"] = rate
        reference.step()
        torch.testing.assert_close(norm, expected)
        for p, q in zip(ours, theirs, strict=True):
            torch.testing.assert_close(p, q, rtol=1e-5, atol=1e-6)
    assert all(p.grad is None for p in ours)


def test_replicas_do_not_mix_and_go_on_apart():
    together, alone = parameters((3,)), [nn.Parameter(p[1].clone()) for p in parameters((3,))]
    both, one = Adam(together, EPSILON, (3,)), Adam(alone, EPSILON)

    def step(i):
        for p, q, gradient in zip(together, alone, gradients(together, i), strict=True):
            p.grad, q.grad = gradient.clone(), gradient[1].clone()
        for adam in (both, one):
            row, _ = clipped(adam.gradient(), 0.5)
            adam.step(row, 1e-2)
        for p, q in zip(together, alone, strict=True):
            torch.testing.assert_close(p[1], q)

    for i in range(5):
        step(i)
    saved = both.state_dict(1)
    one = Adam(alone, EPSILON)
    one.load_state_dict([saved])
    again = Adam(together, EPSILON, (3,))
    again.load_state_dict([both.state_dict(i) for i in range(3)])
    assert torch.equal(again.second, both.second)
    both = again
    step(5)
