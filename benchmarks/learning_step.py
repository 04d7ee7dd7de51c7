"""Where a training's time goes, and what was tried to shorten it.

First the shares that every run logs, of an idle trainer; then the operations that a profiler
finds; then each idea beside what it would replace, on the arrays of a learning step (3200
samples of 23 entries, 64 × 64 tanh) or of a slot's choice (256 environments). Subjects take
turns; medians count, of processor time in one thread, so that a busy machine disturbs little.

    python benchmarks/learning_step.py [--repeats 9]
"""

from __future__ import annotations

import argparse
import statistics
import time
from collections.abc import Callable

import machine
import torch
from torch import Tensor, nn
from torch.profiler import profile

from iout_marl.scenario import load_scenario
from trainers import Trainer
from trainers.factory import make_network
from trainers.networks import ActorCritic, perceptron, uniform_noise
from trainers.ops import policy_loss
from trainers.optimizers import Adam, clip_gradient

SAMPLES, ENVS, ENTRIES = 3200, 256, 23
SIZES, CLIP, COEFFICIENT = (6, 10, 10), 0.2, 0.003


def shares(trainer: Trainer, iterations: int = 20) -> dict[str, float]:
    """Medians of the shares that are logged."""
    logs = [trainer.iterate() for _ in range(iterations)]
    tags = [tag for tag in logs[0] if tag.startswith("speed/")]
    return {tag: statistics.median(log[tag] for log in logs) for tag in tags}


def plain_step(network: ActorCritic, batch: dict[str, Tensor]) -> Tensor:
    """The loss of a learning step as one writes it for autograd."""
    layers = nn.Sequential(*network.actor), nn.Sequential(*network.critic)
    logits = layers[0](batch["inputs"]).unflatten(-1, (len(SIZES), -1)) + network.padding
    log_p = logits.log_softmax(-1)
    now = log_p.gather(-1, batch["action"][..., None]).squeeze(-1).sum(-1)
    ratio = (now - batch["log_probability"]).exp()
    surrogate = torch.minimum(
        ratio * batch["advantage"], ratio.clamp(1 - CLIP, 1 + CLIP) * batch["advantage"]
    ).mean()
    entropy = -(log_p.exp() * log_p).sum((-2, -1)).mean()
    value_loss = (layers[1](batch["inputs"])[:, 0] - batch["returns"]).square().mean()
    return 0.5 * value_loss - surrogate - COEFFICIENT * entropy


def our_step(network: ActorCritic, batch: dict[str, Tensor]) -> Tensor:
    """The same with gradients by hand."""
    of_policy = policy_loss(
        network.logits(batch["inputs"]),
        batch["action"],
        batch["log_probability"],
        batch["advantage"],
        CLIP,
        COEFFICIENT,
        SAMPLES,
    )
    value = network.normalised_value(batch["inputs"])
    return of_policy.loss + 0.5 * (value - batch["returns"]).square().sum() / SAMPLES


def losses(network: ActorCritic) -> dict[str, Callable[[], object]]:
    """Loss and gradients of a minibatch."""
    generator = torch.Generator().manual_seed(0)
    inputs = torch.randn(SAMPLES, ENTRIES, generator=generator)
    with torch.no_grad():
        action, log_p = network.sample(
            network.logits(inputs), uniform_noise((SAMPLES, len(SIZES)), generator)
        )
    batch = {
        "inputs": inputs,
        "action": action.contiguous(),
        "log_probability": log_p,
        "advantage": torch.randn(SAMPLES, generator=generator),
        "returns": torch.randn(SAMPLES, generator=generator),
    }

    def with_gradients(loss: Callable[[ActorCritic, dict[str, Tensor]], Tensor]) -> object:
        network.zero_grad(set_to_none=True)
        return loss(network, batch).backward()  # type: ignore[no-untyped-call]

    compiled = torch.compile(plain_step, fullgraph=True, dynamic=False)
    return {
        "autograd": lambda: with_gradients(plain_step),
        "by hand": lambda: with_gradients(our_step),
        "torch.compile": lambda: with_gradients(compiled),
    }


def optimizers(network: ActorCritic) -> dict[str, Callable[[], object]]:
    """Clipping and a step of Adam."""
    parameters = list(network.parameters())
    torch_adam = torch.optim.Adam(parameters, lr=1e-9, foreach=True)
    adam = Adam(parameters, 1e-5)
    gradients = [torch.randn_like(p) for p in parameters]

    def theirs() -> None:
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        nn.utils.clip_grad_norm_(parameters, 0.5)
        torch_adam.step()

    def ours() -> None:
        for parameter, gradient in zip(parameters, gradients, strict=True):
            parameter.grad = gradient
        row, _ = clip_gradient(adam.gradient(), 0.5)
        adam.step(row, 1e-9)

    return {"torch.optim, foreach": theirs, "one row": ours}


def products() -> dict[str, Callable[[], object]]:
    """The product of a hidden layer."""
    weight, samples = torch.randn(64, 64), torch.randn(64, SAMPLES)
    low_weight, low = weight.bfloat16(), samples.bfloat16()
    return {"float32": lambda: weight @ samples, "bfloat16": lambda: low_weight @ low}


def choices() -> dict[str, Callable[[], object]]:
    """Drawing the actions of a slot, noise included."""
    generator = torch.Generator().manual_seed(0)
    logits = torch.randn(len(SIZES), max(SIZES), ENVS).movedim(-1, 0)

    def gumbel() -> Tensor:
        noise = -(-torch.rand(logits.shape, generator=generator).clamp_min(1e-38).log()).log()
        return (logits + noise).argmax(-1)

    def inversion() -> Tensor:
        return ActorCritic.sample(logits, uniform_noise((ENVS, len(SIZES)), generator))[0]

    return {"Gumbel": gumbel, "inversion": inversion}


def fused_layers() -> dict[str, Callable[[], object]]:
    """Actor and critic forward: two perceptrons, or one of both with blocks of zeros."""
    inputs = torch.randn(SAMPLES, ENTRIES)
    actor = perceptron(ENTRIES, (64, 64), 30, "tanh", 0.01)
    critic = perceptron(ENTRIES, (64, 64), 1, "tanh", 1.0)
    both = perceptron(ENTRIES, (128, 128), 31, "tanh", 1.0)

    @torch.no_grad()
    def apart() -> object:
        return actor(inputs), critic(inputs)

    @torch.no_grad()
    def together() -> object:
        return both(inputs)

    return {"actor, critic": apart, "one of both": together}


def compare(title: str, subjects: dict[str, Callable[[], object]], repeats: int) -> None:
    """Median processor time of each, and ratios to the first."""
    times: dict[str, list[float]] = {name: [] for name in subjects}
    for subject in subjects.values():
        subject()
    for _ in range(repeats):
        for name, subject in subjects.items():
            started = time.thread_time()
            for _ in range(20):
                subject()
            times[name].append((time.thread_time() - started) / 20)
    medians = {name: statistics.median(values) for name, values in times.items()}
    first = next(iter(medians.values()))
    print(f"\n{title}")
    for name, values in times.items():
        spread = (max(values) - min(values)) / medians[name]
        row = f"{1e6 * medians[name]:10.0f} µs ±{spread:5.0%}{medians[name] / first:8.2f}"
        print(f"  {name:24s}{row}")


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=9)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe())
    trainer = Trainer(load_scenario("paper/k10-fdd"))
    trainer.iterate()
    print("\nshares of an iteration, preset fast, paper/k10-fdd")
    for tag, value in shares(trainer).items():
        print(f"  {tag:28s}{value:12,.2f}")
    with profile() as found:
        trainer.iterate()
    print("\noperations of an iteration, by their own time")
    events = sorted(found.key_averages(), key=lambda e: -e.self_cpu_time_total)
    total = sum(e.self_cpu_time_total for e in events)
    for event in events[:12]:
        row = f"{event.count:6d} calls{event.self_cpu_time_total / 1e3:8.1f} ms"
        print(f"  {event.key[:36]:38s}{row}{event.self_cpu_time_total / total:7.1%}")
    world = trainer.collector.world
    network = make_network(world.observer, world.action_sizes, trainer.settings)
    compare("loss and gradients", losses(network), options.repeats)
    compare("clipping and Adam", optimizers(trainer.network), options.repeats)
    compare("product of a hidden layer", products(), options.repeats)
    compare("drawing the actions of a slot", choices(), options.repeats)
    compare("actor and critic, forward", fused_layers(), options.repeats)


if __name__ == "__main__":
    main()
