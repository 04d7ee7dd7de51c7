"""Training where the world runs on torch: on a GPU where there is one, as far as a CPU can tell."""

import pytest
import torch
from emulated_graph import waits
from torch.utils._python_dispatch import TorchDispatchMode

from iout_marl import evaluate
from iout_marl.world import redraws_every_episode
from trainers import TrainedPolicy, Trainer, collector


def needs_cuda(test):
    """For a test on a CUDA device."""
    there = torch.cuda.is_available()
    return pytest.mark.gpu(pytest.mark.skipif(not there, reason="no CUDA device here")(test))


#: Episodes of ten slots, each as long as a rollout where a variant does not say otherwise.
SHORT = {"episode.duration_s": 250, "training.rollout_slots": 10}
TWO_AUVS = {"auvs.start_cells": [[2, 1, 1], [1, 2, 1]]}
VARIANTS = {
    "plain": {},
    "tdd, masks, running normalisers": {
        "duplex.kind": "tdd",
        "training.mask_actions": True,
        "training.observation_scaling": "running",
        "training.reward_scaling": "running",
    },
    "random layouts, paper's reward": {
        "nodes": {"kind": "random", "count": 2},
        "reward.kind": "paper",
    },
    "two auvs, a critic that sees more, a network for nodes": {
        **TWO_AUVS,
        "channel.access": "interference",
        "training.critic": "central",
        "training.node_network": True,
        "reward.credit": "difference",
    },
}


class NoWaiting(TorchDispatchMode):
    """Fails where the host would wait for the device."""

    def __init__(self, brings_layouts):
        super().__init__()
        self.brings_layouts = brings_layouts

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        # Layouts that are drawn on the host come to a CUDA device by pinned memory.
        brings = func._schema.name == "aten::lift_fresh" and not self.brings_layouts
        is_refused = brings or waits(func, args)
        assert not is_refused, f"{func._schema.name} waits for the device"
        return func(*args, **(kwargs or {}))


@pytest.fixture
def on_torch(monkeypatch):
    monkeypatch.setattr(collector, "NUMPY_DEVICES", ())


@pytest.fixture(params=VARIANTS.values(), ids=list(VARIANTS))
def scenario(request, tiny):
    return tiny({**SHORT, **request.param})


def assert_alike(first, second, tolerance):
    for name, tensor in first.items():
        torch.testing.assert_close(
            tensor.cpu(),
            second[name].cpu(),
            rtol=tolerance,
            atol=tolerance,
            msg=lambda text, name=name: f"{name}: {text}",
        )


@pytest.mark.slow
def test_learns_the_same_as_on_numpy(scenario, monkeypatch):
    on_numpy = Trainer(scenario, seed=2)
    monkeypatch.setattr(collector, "NUMPY_DEVICES", ())
    on_torch = Trainer(scenario, seed=2)
    for _ in range(3):
        on_numpy.iterate(), on_torch.iterate()
    assert isinstance(on_torch.collector.state.age, torch.Tensor)
    assert_alike(on_torch.weights(), on_numpy.weights(), 1e-4)


@pytest.mark.slow
@pytest.mark.usefixtures("on_torch")
@pytest.mark.parametrize("replicas", [1, 2])
def test_host_never_waits_within_an_iteration(scenario, replicas):
    trainer = Trainer(scenario, replicas=replicas)
    trainer.iterate_all()
    with NoWaiting(redraws_every_episode(scenario)):
        trainer.iterate_all()


@pytest.mark.usefixtures("on_torch")
def test_the_check_for_waiting_can_fail(tiny):
    trainer = Trainer(tiny({"training.target_kl": 1.0}))  # compared on the host
    with (
        pytest.raises(AssertionError, match="_local_scalar_dense waits for the device"),
        NoWaiting(brings_layouts=False),
    ):
        trainer.iterate_all()


@needs_cuda
def test_gpu_learns_the_same_as_the_cpu_from_the_same_numbers(scenario, monkeypatch):
    on_cpu = Trainer(scenario, seed=2)
    # Generators differ between devices: both get the numbers of the CPU's.
    uniform, randperm = collector.uniform_noise, torch.randperm
    monkeypatch.setattr(
        collector,
        "uniform_noise",
        lambda shape, generator: uniform(
            shape, torch.Generator().manual_seed(generator.initial_seed())
        ).to(generator.device),
    )
    monkeypatch.setattr(
        torch,
        "randperm",
        lambda count, generator, device: randperm(
            count, generator=torch.Generator().manual_seed(generator.initial_seed())
        ).to(device),
    )
    on_gpu = Trainer(scenario, seed=2, device="cuda")
    on_cpu.iterate(), on_gpu.iterate()
    assert on_gpu.collector.state.age.is_cuda
    assert_alike(on_gpu.weights(), on_cpu.weights(), 1e-3)


@needs_cuda
def test_gpu_trains_saves_and_plays(scenario):
    trainer = Trainer(scenario, replicas=2, device="cuda")
    trainer.iterate_all()
    again = Trainer(scenario, replicas=2, device="cuda")
    again.load_state_dict(*(trainer.state_dict(i) for i in range(2)))
    assert_alike(again.weights(1), trainer.weights(1), 0.0)
    alone = Trainer(scenario, device="cuda")
    alone.iterate()
    assert evaluate(scenario, TrainedPolicy(alone.network), 2).metrics["mean_aoi"].mean > 0
