"""Adam on one row of weights, and torch's own behind the same interface, against torch alone."""

import pytest
import torch
from torch import nn

from iout_marl import InputError, load_scenario
from trainers import Trainer, train
from trainers.optimizers import Adam, TorchOptimizer, clip_gradient, make_optimizer
from trainers.parts.torch_optimizer import _classes

SHAPES = [(4, 3), (4,), (1, 4), (1,)]
EPSILON = 1e-5
POLICIES = 3
#: Of what torch offers, one of each way to keep its state.
OF_TORCH = {
    "SGD": {"momentum": 0.9},
    "AdamW": {"weight_decay": 0.01, "betas": [0.8, 0.99]},
    "RMSprop": {"centered": True},
    "Adagrad": {},
    "NAdam": {},
}


def parameters(seed=0):
    torch.manual_seed(seed)
    return [nn.Parameter(torch.randn(POLICIES, *shape)) for shape in SHAPES]


def alone(stacked, policy):
    return [nn.Parameter(p[policy].detach().clone()) for p in stacked]


def gradients(like, seed):
    torch.manual_seed(seed)
    return [torch.randn_like(p) * 10 ** torch.randn(1) for p in like]


def chosen(tiny, optimizer):
    return tiny({"training.optimizer": optimizer}).training


def assert_steps_are_those_of(ours, stacked, theirs, maximum=0.5):
    """Steps of policies side by side, and of each one's weights in an optimizer of torch."""
    own = [alone(stacked, i) for i in range(POLICIES)]
    references = [theirs(each) for each in own]
    for i in range(10):
        rate = 1e-2 / (1 + i)
        for p, gradient in zip(stacked, gradients(stacked, i), strict=True):
            p.grad = gradient.clone()
            for policy, each in enumerate(own):
                each[[q is p for q in stacked].index(True)].grad = gradient[policy].clone()
        row, norms = clip_gradient(ours.gradient(), maximum)
        ours.step(row, rate)
        for policy, (each, reference) in enumerate(zip(own, references, strict=True)):
            expected = nn.utils.clip_grad_norm_(each, maximum)
            reference.param_groups[0]["lr"] = rate
            reference.step()
            torch.testing.assert_close(norms[policy], expected)
            for p, q in zip(stacked, each, strict=True):
                torch.testing.assert_close(p[policy], q, rtol=1e-5, atol=1e-6)
    assert all(p.grad is None for p in stacked)


@pytest.mark.parametrize("maximum", [0.5, 1e9])
def test_steps_of_adam_are_those_of_torch(maximum):
    ours = parameters()
    assert_steps_are_those_of(
        Adam(ours, EPSILON), ours, lambda own: torch.optim.Adam(own, eps=EPSILON), maximum
    )


@pytest.mark.parametrize("name", OF_TORCH)
def test_optimizers_of_torch_take_their_own_steps(tiny, name):
    ours, options = parameters(), OF_TORCH[name]
    settings = chosen(tiny, {"kind": "torch", "name": name, "options": options})
    assert_steps_are_those_of(
        make_optimizer(settings, ours), ours, lambda own: getattr(torch.optim, name)(own, **options)
    )


@pytest.mark.parametrize("name", ["adam", *OF_TORCH])
def test_each_policy_continues_from_its_state(tiny, name):
    settings = chosen(tiny, name)
    together = parameters()
    both = make_optimizer(settings, together)
    like = both.state_dict(1)

    def step(stacked, optimizer, i, policies=slice(None)):
        for p, gradient in zip(stacked, gradients(together, i), strict=True):
            p.grad = gradient[policies].clone()
        optimizer.step(clip_gradient(optimizer.gradient(), 0.5)[0], 1e-2)

    for i in range(5):
        step(together, both, i)
    saved = both.state_dict(1)
    assert saved["steps"] == 5
    lone = [nn.Parameter(p[1:2].detach().clone()) for p in together]
    one = make_optimizer(settings, lone)
    one.load_state_dict([saved])
    for i in range(5, 8):
        step(together, both, i)
        step(lone, one, i, slice(1, 2))
        for p, q in zip(together, lone, strict=True):
            torch.testing.assert_close(p[1], q[0])
    # A state from before the first step has the same structure, and leads to it.
    assert structure(like) == structure(saved)
    one.load_state_dict([like])
    fresh = [nn.Parameter(p.detach().clone()) for p in lone]
    other = make_optimizer(settings, fresh)
    step(lone, one, 9, slice(1, 2))
    step(fresh, other, 9, slice(1, 2))
    for p, q in zip(lone, fresh, strict=True):
        torch.testing.assert_close(p, q)


def structure(value):
    if isinstance(value, dict):
        return {key: structure(each) for key, each in value.items()}
    return (value.shape, value.dtype) if isinstance(value, torch.Tensor) else type(value)


def test_a_typo_is_told_when_the_file_is_read(tmp_path):
    (tmp_path / "mine.yaml").write_text("extends: paper/k3-fdd\ntraining:\n  optimizer: Admaw\n")
    told = r"mine\.yaml:3: training\.optimizer\.name: torch\.optim has no optimizer 'Admaw'; did "
    with pytest.raises(InputError, match=told):
        load_scenario(tmp_path / "mine.yaml")


def test_the_classes_of_torch_are_known_without_importing_it():
    optimizers = [item for item in vars(torch.optim).values() if isinstance(item, type)]
    found = {item.__name__ for item in optimizers if issubclass(item, torch.optim.Optimizer)}
    assert set(_classes()) == found - {"Optimizer"}


@pytest.mark.parametrize(
    ("optimizer", "fault"),
    [
        ("Zzz", "torch.optim has no optimizer 'Zzz' (known: ASGD, Adadelta, "),
        ("Optimizer", "torch.optim has no optimizer 'Optimizer'"),
        ({"kind": "torch", "name": "SGD", "options": {"momentun": 0.9}}, "momentun"),
        ({"kind": "torch", "name": "SGD", "options": {"momentum": -1}}, "Invalid momentum"),
        ("LBFGS", "evaluates the loss again and again"),
        ("SparseAdam", "does not support dense gradients"),
    ],
    ids=[
        "another word",
        "the base class",
        "unknown option",
        "an option's value",
        "closures",
        "sparse",
    ],
)
def test_what_cannot_be_used_is_refused_before_anything_is_written(
    tiny, tmp_path, optimizer, fault
):
    scenario = tiny({"training.optimizer": optimizer})
    with pytest.raises(InputError, match=r"training\.optimizer: ") as raised:
        train(scenario, tmp_path / "run")
    assert fault in str(raised.value)
    assert str(raised.value).isprintable()
    assert not (tmp_path / "run").exists()


def test_a_word_that_is_no_kind_is_refused_by_the_scenario(tiny):
    with pytest.raises(InputError, match=r"training\.optimizer.*adamm.*did you mean 'adam'"):
        tiny({"training.optimizer": "adamm"})


def test_hash_knows_another_optimizer_but_not_that_there_are_others(tiny):
    hashes = {tiny({"training.optimizer": each}).hash for each in ("adam", "AdamW", "SGD")}
    assert len(hashes) == 3
    assert tiny().hash in hashes


@pytest.mark.slow
@pytest.mark.parametrize("replicas", [1, 2])
def test_trains_and_resumes_with_an_optimizer_of_torch(tiny, tmp_path, replicas):
    optimizer = {"kind": "torch", "name": "RMSprop", "options": {"alpha": 0.9}}
    changes = {"training.optimizer": optimizer, "training.learning_rate_schedule": "constant"}
    whole = train(tiny({**changes, "training.steps": 480}), tmp_path / "whole", replicas=replicas)
    train(tiny({**changes, "training.steps": 240}), tmp_path / "parts", replicas=replicas)
    again = train(
        tiny({**changes, "training.steps": 480}), tmp_path / "parts", replicas=replicas, resume=True
    )
    for policy in range(replicas):
        first, second = whole.trainer.weights(policy), again.trainer.weights(policy)
        assert all(torch.equal(first[name], second[name]) for name in first)
    assert not torch.equal(
        Trainer(load_scenario(tiny())).weights()["actor.0.weight"],
        whole.trainer.weights()["actor.0.weight"],
    )


def test_torch_optimizer_is_not_captured():
    assert not TorchOptimizer.can_be_captured
    assert Adam.can_be_captured
