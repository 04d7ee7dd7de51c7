"""Ideas for learning faster, each beside the trainer as it is: what they gain, what they cost.

V-trace (Espeholt et al., 2018): advantages and returns anew before every epoch but the first,
for which they are the trainer's own. Muon (Jordan, 2024): orthogonalised steps for the hidden
layers. Mirrored samples: the grid's symmetries as data for nothing. Where the layout is fixed
and unseen, as in the paper, a mirrored sample is one of another layout, unless a symmetry maps
the nodes to themselves: the first table counts those that do. So mirrored samples are measured
where each episode draws its layout and nodes' positions are observed.

Muon has a learning rate of its own, which was sought for these schedules; so every idea is also
seen beside the trainer with a rate that was sought just as long, and mirrored samples, which
double a minibatch, beside twice the steps.

Subjects take turns, seed by seed, for the same number of environment steps. Seconds are of
processor time, without the evaluation, so that a busy machine disturbs little; ratios are
taken round by round, and medians of them printed.

    python benchmarks/ideas.py [--seeds 5]
"""

from __future__ import annotations

import argparse
import itertools
import statistics
import time
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import machine
import numpy as np
import numpy.typing as npt
import torch
from contestants import OUR_STEPS
from time_to_quality import OURS, TARGETS
from torch import Tensor, nn

from iout_marl import evaluate, load_scenario
from iout_marl.scenario import Scenario
from iout_marl.world import redraws_every_episode
from iout_marl.world.motion import DIRECTIONS
from trainers import Trainer
from trainers.adam import Adam
from trainers.networks import ActorCritic
from trainers.rollout import Rollout, Simulation

#: The preset's learning rate, 0.004, goes with 3,072,000 steps. Of 0.002, 0.006 and
#: 0.008, tried on seeds 100 to 103 at the shorter schedules of these benchmarks, 0.006 and 0.008
#: were better than it and as good as one another.
FASTER = {"training.learning_rate": 0.008}
#: Environment steps where layouts are drawn every episode.
STEPS = 1_024_000
#: Samples that the networks judge at once: what a processor's cache holds.
CHUNK = 2560
#: Of Newton and Schulz's iteration, as Jordan chose them.
QUINTIC = (3.4445, -4.7750, 2.0315)


class EndsKept(Simulation):
    """Keeps what was seen at the ends of episodes and of the rollout, which no rollout holds."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self.ends: list[Tensor] = []

    def value(self, network: ActorCritic) -> Tensor:
        self.ends.append(network.scaler(self.observe()))
        return super().value(network)


class VTrace(Trainer):
    """Advantages and returns by the policy and the critic of every epoch's beginning.

    For one policy in one process, and critics that see what the actor sees.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        super().__init__(scenario, seed)
        settings = self.settings
        assert settings.target_kl is None
        assert not settings.mask_actions
        self.simulation: EndsKept = EndsKept(
            self.scenarios, settings.environments, self.device, self.seeds, self.group
        )

    def _learn(
        self, rollout: Rollout, orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        self._rollout = rollout
        figures = super()._learn(rollout, orders, learning_rate)
        self.simulation.ends.clear()
        return figures

    def _epochs(
        self, data: dict[str, Tensor], orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        logs = []
        for epoch, order in enumerate(orders):
            now = data if epoch == 0 else {**data, **self._traced(data)}
            logs.append(super()._epochs(now, [order], learning_rate))
        return {tag: torch.stack([log[tag] for log in logs]).mean(0) for tag in logs[0]}

    @torch.no_grad()
    def _traced(self, data: dict[str, Tensor]) -> dict[str, Tensor]:
        """V-trace with ρ̄ = c̄ = 1 and c_t = λ ρ_t.

        v_t − V_t = ρ_t Â_t, Â_t = r_t + γ V_{t+1} − V_t + γλ (v_{t+1} − V_{t+1}). The policy's
        loss weighs Â_t by the ratio itself, so that ρ_t does not stand in it once more; under
        the policy of the rollout Â is that of GAE.
        """
        rollout, network, settings = self._rollout, self.network, self.settings
        values, ratios = [], []
        for inputs, action, before in zip(
            *(torch.split(data[k], CHUNK) for k in ("inputs", "action", "log_probability")),
            strict=True,
        ):
            values.append(network.value(inputs))
            log_p = network.log_probabilities(network.scores(inputs))
            ratios.append((network.log_probability(log_p, action) - before).exp())
        value = torch.cat(values).view_as(rollout.value)
        weight = torch.cat(ratios).view_as(value).clamp_max(1.0)
        next_value = torch.cat([value[1:], value[:1]])
        truncated = rollout.truncated
        ended = [t for t, end in enumerate(truncated) if end or t == len(truncated) - 1]
        for t, inputs in zip(ended, self.simulation.ends, strict=True):
            next_value[t] = network.value(inputs)
        delta = rollout.reward / self.reward_scale.divisor + settings.discount * next_value - value
        decay = settings.discount * settings.gae_lambda
        advantage, correction = torch.empty_like(delta), torch.zeros_like(delta[0])
        returns = torch.empty_like(delta)
        for t in reversed(range(len(delta))):
            advantage[t] = delta[t] + (0.0 if truncated[t] else decay) * correction
            correction = weight[t] * advantage[t]
            returns[t] = value[t] + correction
        return {
            "advantage": advantage.flatten(),
            "returns": network.normalised_return(returns.flatten()),
        }


def orthogonalised(matrices: Tensor, steps: int = 5) -> Tensor:
    """(n, rows, columns) matrices with singular values near 1, by Newton and Schulz's iteration."""
    a, b, c = QUINTIC
    tall = matrices.shape[-2] > matrices.shape[-1]
    x = matrices.mT if tall else matrices
    x = x / (x.norm(dim=(-2, -1), keepdim=True) + 1e-7)
    for _ in range(steps):
        gram = x @ x.mT
        x = a * x + (b * gram + c * gram @ gram) @ x
    return x.mT if tall else x


class MuonAndAdam(Adam):
    """Nesterov momentum, orthogonalised, for some matrices; Adam for the other parameters.

    Args:
        matrices: of pairs that have one shape: actor's and critic's.
        others: what Adam moves.
        epsilon: of Adam.
        factor: learning rate of the matrices, over that of Adam.
    """

    def __init__(
        self,
        matrices: Sequence[Sequence[nn.Parameter]],
        others: Sequence[nn.Parameter],
        epsilon: float,
        factor: float,
    ) -> None:
        super().__init__(others, epsilon)
        self._matrices, self._factor = matrices, factor
        self._momenta = [torch.zeros(len(pair), *pair[0].shape) for pair in matrices]

    def gradient(self) -> Tensor:
        rows = [super().gradient()]
        for matrix in itertools.chain(*self._matrices):
            assert matrix.grad is not None
            rows.append(matrix.grad.flatten())
            matrix.grad = None
        return torch.cat(rows)

    @torch.no_grad()
    def step(self, gradient: Tensor, learning_rate: float, momentum: float = 0.95) -> None:
        others, *parts = torch.split(
            gradient, [len(self.first), *(mean.numel() for mean in self._momenta)]
        )
        super().step(others, learning_rate)
        for pair, mean, part in zip(self._matrices, self._momenta, parts, strict=True):
            now = part.view_as(mean)
            mean.lerp_(now, 1 - momentum)
            rows, columns = mean.shape[1:]
            size = learning_rate * self._factor * max(1, rows / columns) ** 0.5
            change = orthogonalised(now.lerp(mean, momentum))
            for matrix, own in zip(pair, change, strict=True):
                matrix.sub_(own, alpha=size)


class Muon(Trainer):
    """Muon for the weights of all layers but the last."""

    #: Falls over the training as Adam's does. Best of 0.005, 0.01, 0.02, 0.03 and 0.04 on seeds
    #: 100 to 103; the first layers left to Adam, it came out the same.
    rate = 0.03

    def __init__(self, scenario: Scenario, seed: int) -> None:
        super().__init__(scenario, seed)
        networks = (self.network.actor, self.network.critic)
        weights = [[p for p in network.parameters() if p.ndim > 1] for network in networks]
        matrices = [*zip(*weights, strict=True)][:-1]
        known = {id(matrix) for matrix in itertools.chain(*matrices)}
        others = [p for p in self.network.parameters() if id(p) not in known]
        epsilon, factor = self.settings.adam_epsilon, self.rate / self.settings.learning_rate
        self.optimizer = MuonAndAdam(matrices, others, epsilon, factor)


def symmetries(shape: Sequence[int]) -> npt.NDArray[np.int64]:
    """Rotations and reflections that map a grid to itself, (n, 3, 3); the first is none."""
    found = []
    for order in itertools.permutations(range(3)):
        if [shape[axis] for axis in order] == list(shape):
            signs = itertools.product((1, -1), repeat=3)
            found += [np.diag(sign)[:, list(order)] for sign in signs]
    return np.array(found)


def kept(scenario: Scenario) -> str:
    """How many symmetries but the identity map the nodes to themselves."""
    shape, nodes = scenario.grid.cells, scenario.nodes
    assert nodes.kind == "fixed"
    # In half cells from the centre of the grid.
    places = 2 * np.array(nodes.cells[: scenario.num_nodes]) - 1 - np.array(shape)
    same = [set(map(tuple, places @ m.T)) == set(map(tuple, places)) for m in symmetries(shape)]
    is_mirror = [bool((np.abs(m) == np.eye(3)).all()) for m in symmetries(shape)]
    mirrors = sum(itertools.compress(same, is_mirror)) - 1
    return f"{mirrors:4d} of {sum(is_mirror) - 1:2d}{sum(same) - 1:12d} of {len(same) - 1:2d}"


class Mirrored(Trainer):
    """Every minibatch twice: as it is, and each sample turned by a symmetry drawn for it.

    Value, advantage and log-probability stay those recorded. For a lone AUV that sees nothing
    but its position, ages, energies and the nodes' positions.
    """

    def __init__(self, scenario: Scenario, seed: int) -> None:
        super().__init__(scenario, seed)
        assert self.settings.observation_scaling == "fixed"
        assert not self.settings.mask_actions
        turns = symmetries(scenario.grid.cells)
        steps = np.array(DIRECTIONS[scenario.auvs.motion])
        turned = np.einsum("nij,dj->ndi", turns, steps)
        self._direction = torch.as_tensor((turned[:, :, None] == steps).all(-1).argmax(-1))
        self._turns = torch.as_tensor(turns, dtype=torch.float32)
        scaler, last = self.network.scaler, torch.tensor(scenario.grid.cells)
        # Scaled, the first cell is at 0.
        self._centre = (last - scaler.shift[:3]) / scaler.scale[:3] / 2
        nodes = self.simulation.world.observer.node_entries[-1].stop
        end = nodes + 3 * scenario.num_nodes
        self._places = torch.tensor([0, 1, 2, *range(nodes, end)])
        self._draws = torch.Generator().manual_seed(seed)

    def _step(
        self, batch: dict[str, Tensor], samples: int, learning_rate: float
    ) -> dict[str, Tensor]:
        drawn = torch.randint(1, len(self._turns), (samples,), generator=self._draws)
        inputs, action = batch["inputs"].clone(), batch["action"].clone()
        places = inputs[:, self._places].view(samples, -1, 3) - self._centre
        inputs[:, self._places] = (places @ self._turns[drawn].mT + self._centre).flatten(-2)
        action[:, 0] = self._direction[drawn, action[:, 0]]
        copy = {**batch, "inputs": inputs, "action": action}
        both = {name: torch.cat([batch[name], copy[name]]) for name in batch}
        return super()._step(both, 2 * samples, learning_rate)


class Outcome(NamedTuple):
    """What a training came to, and what it took."""

    mean_aoi: float
    seconds: float


def train(kind: type[Trainer], scenario: Scenario, seed: int) -> Outcome:
    """A whole training, and the mean AoI of its deterministic policy."""
    started = time.process_time()
    trainer = kind(scenario, seed)
    while not trainer.finished:
        trainer.iterate()
    seconds = time.process_time() - started
    # Layouts that are drawn anew are others than those of the training.
    episodes = 100 if redraws_every_episode(scenario) else 1
    result = evaluate(scenario, trainer.policy(), episodes=episodes, seed=1000)
    return Outcome(result.metrics["mean_aoi"].mean, seconds)


class Subject(NamedTuple):
    """What is compared."""

    trainer: type[Trainer]
    overrides: dict[str, Any]  # of the scenario


def compare(subjects: dict[str, Subject], scenario: Scenario, seeds: int) -> None:
    """Train each in turn, and print medians."""
    outcomes: dict[str, list[Outcome]] = {name: [] for name in subjects}
    short = load_scenario(scenario, {"training.steps": 1})
    for subject in subjects.values():
        train(subject.trainer, short, 0)  # the first ones warm caches and allocators
    for seed in range(seeds):
        for name, (trainer, overrides) in subjects.items():
            outcomes[name].append(train(trainer, load_scenario(scenario, overrides), seed))
    heads = ("mean AoI", "min", "max", "seconds", "ratio")
    print(f"{'':32s}" + "".join(f"{head:>10s}" for head in heads))
    for name, runs in outcomes.items():
        ages = [run.mean_aoi for run in runs]
        row = f"{statistics.median(ages):10.2f}{min(ages):10.2f}{max(ages):10.2f}"
        seconds = statistics.median(run.seconds for run in runs)
        ratio = statistics.median(
            run.seconds / ours.seconds for run, ours in zip(runs, outcomes[OURS], strict=True)
        )
        print(f"{name:32s}{row}{seconds:10.1f}{ratio:10.2f}", flush=True)


def with_faster(ideas: dict[str, type[Trainer]]) -> dict[str, Subject]:
    """Each as it is, and at the higher learning rate."""
    rates = {"": {}, f", rate {FASTER['training.learning_rate']}": FASTER}
    return {
        name + words: Subject(kind, overrides)
        for words, overrides in rates.items()
        for name, kind in ideas.items()
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=5)
    options = parser.parse_args()
    torch.set_num_threads(1)
    print(machine.describe())
    print(f"\nsymmetries of the grid that map the nodes to themselves\n{'':24s}", end="")
    print(f"{'mirrors':>10s}{'with turns':>18s}")
    for nodes in (3, 5, 7, 10):
        name = f"paper/k{nodes}-fdd"
        print(f"{name:24s}{kept(load_scenario(name))}")
    subjects = with_faster({OURS: Trainer, "V-trace": VTrace, "Muon": Muon})
    for name, target in TARGETS.items():
        steps = OUR_STEPS[load_scenario(name).reward.kind]
        print(f"\n{name}, {steps:,} steps, {options.seeds} seeds; target {target}\n")
        compare(subjects, load_scenario(name, {"training.steps": steps}), options.seeds)
    subjects = with_faster({OURS: Trainer, "mirrored samples": Mirrored})
    twice = {"training.steps": 2 * STEPS}
    subjects[f"{OURS}, twice the steps"] = Subject(Trainer, twice)
    title = "random/k10-fdd, layouts drawn every episode and seen"
    print(f"\n{title}, {STEPS:,} steps, {options.seeds} seeds\n")
    seen = {"nodes.redraw": "episode", "observation.node_positions": True}
    scenario = load_scenario("random/k10-fdd", {**seen, "training.steps": STEPS})
    compare(subjects, scenario, options.seeds)


if __name__ == "__main__":
    main()
