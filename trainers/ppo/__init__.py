"""Proximal policy optimisation (Schulman et al., 2017) on the batched world.

The loop, top to bottom: `Trainer.iterate_all` collects a rollout, estimates advantages and
takes the clipped-surrogate steps. Every setting is explained in
`iout_marl.scenario.Training`; every quantity that is logged, in `Trainer.iterate_all`.

On a CUDA device the slots of a rollout, and all that is learnt from it, are recorded as CUDA
graphs and replayed: the host waits for the device once in an iteration, for the log. Several
processes record nothing, since what they exchange cannot be; with `training.target_kl` the
learning is not recorded, as the host decides when it ends.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from typing import Any

import torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides, Scenario, Training, load_scenario
from iout_marl.world import pin_layout
from trainers.adam import Adam, clipped
from trainers.factory import make_network
from trainers.functions import policy_loss
from trainers.graphs import GRAPHS, Recorded
from trainers.group import Group
from trainers.laps import Laps
from trainers.memory import enough_memory
from trainers.moments import Moments
from trainers.networks import ActorCritic, Scaler, aligned, stacked
from trainers.returns import RewardScale, advantages
from trainers.rollout import Rollout, Simulation
from trainers.trained import TrainedPolicy


class Trainer:
    """Trains one policy, shared by all AUVs, on a scenario; or several side by side.

    Several policies (`replicas`) are trained in one batch, each from a seed of its own,
    as each would be trained alone: their weights, environments and minibatches have nothing
    to do with one another.

    Args:
        scenario: whatever `load_scenario` takes; its `training` section has
            the settings. A layout that is drawn once for a run is drawn from the seed.
        seed: seeds weights, layouts, actions and minibatches; the i-th policy's is seed + i.
        device: where to train.
        replicas: how many policies.
        group: the processes that share the environments.
        use_graphs: record the work and replay it, where the device can.
        overrides: changes of the scenario, as for `load_scenario`.

    Attributes:
        seeds: of each policy.
        scenarios: the scenario of each policy, its layout pinned.
        network: actor and critic, `stacked` where there are several.
        env_steps: environment steps taken so far, for each policy.

    Raises:
        InputError: settings that several policies or processes cannot be trained with, or that
            need more memory than there is.
    """

    @enough_memory()
    def __init__(
        self,
        scenario: AnyScenario,
        seed: int = 0,
        device: str | torch.device = "cpu",
        replicas: int = 1,
        group: Group | None = None,
        *,
        use_graphs: bool = True,
        overrides: Overrides = None,
    ) -> None:
        scenario = load_scenario(scenario, overrides)
        self.group = group or Group()
        self.seeds = range(seed, seed + replicas)
        self.scenarios = [pin_layout(scenario, each) for each in self.seeds]
        self.settings: Training = scenario.training
        _check_shares(self.settings, replicas, self.group)
        self.device = torch.device(device)
        graph = GRAPHS.get(self.device.type) if use_graphs and self.group.size == 1 else None
        new_graph = None if graph is None else partial(graph, self.device)
        self.simulation = Simulation(
            self.scenarios,
            self.settings.environments,
            self.device,
            self.seeds,
            self.group,
            new_graph,
        )
        self._axes = len(self.simulation.replicas)
        self.network = self._make_network().to(self.device)
        #: Makes what learning is recorded in.
        self._new_graph = new_graph if self.settings.target_kl is None else None
        self.optimizer = Adam(
            list(self.network.parameters()),
            self.settings.adam_epsilon,
            self.simulation.replicas,
            is_recorded=self._new_graph is not None,
        )
        self.reward_scale = RewardScale(
            self.settings.reward_scaling,
            self.settings.discount,
            self.simulation.replicas,
            self.group,
            self.device,
        )
        #: A rollout, and what is recorded of learning from it.
        self._lesson: tuple[Rollout, Recorded[dict[str, Tensor]]] | None = None
        self.env_steps = 0

    def _make_network(self) -> ActorCritic:
        world = self.simulation.world
        networks = []
        for seed in self.seeds:
            # Weights come from torch's global generator, which is put back as it was.
            with torch.random.fork_rng(devices=[]):
                torch.default_generator.manual_seed(seed)
                networks.append(make_network(world.observer, world.action_sizes, self.settings))
        return stacked(networks) if len(networks) > 1 else networks[0]

    @property
    def scenario(self) -> Scenario:
        """The scenario of the first policy."""
        return self.scenarios[0]

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of a rollout, for each policy."""
        return self.settings.environments * self.settings.rollout_slots

    @property
    def finished(self) -> bool:
        """Whether the scenario's number of steps has been taken."""
        return self.env_steps >= self.settings.steps

    def iterate(self) -> dict[str, float]:
        """`iterate_all` for a lone policy."""
        (log,) = self.iterate_all()
        return log

    @enough_memory()
    def iterate_all(self) -> list[dict[str, float]]:
        """One iteration: a rollout, and the epochs of learning from it.

        Returns:
            what there is to log of each policy, by TensorBoard tag:

            - `aoi/…`, `fairness/…`, `energy/…`, `uplink/…`, `constraints/…`: metrics of
              the episodes that ended in the rollout, see `iout_marl.metrics`; `metrics/…`:
              those of users;
            - `reward/…`: mean of each term of the reward a slot, and their `total`;
            - `ppo/loss`, and its terms `ppo/policy_loss`, `ppo/value_loss`, `ppo/entropy`;
              `ppo/kl`: mean Kullback-Leibler divergence from the policy of the rollout,
              (r − 1) − log r; `ppo/clip_fraction`: share of ratios that were clipped;
              `ppo/explained_variance`: of the returns, by the critic of the rollout;
              `ppo/gradient_norm`: before clipping; `ppo/learning_rate`;
            - `speed/env_steps_per_s`, of all policies together; `speed/rollout_share`, of
              the iteration's time, within it `speed/environment_share` (step, reward,
              observation) and `speed/inference_share` (networks and sampling), of a
              recorded slot neither; and `speed/learn_share`.
        """
        laps = Laps()
        learning_rate = self._learning_rate()
        rollout = self.simulation.collect(
            self.network,
            self.settings.rollout_slots,
            use_mask=self.settings.mask_actions,
            laps=laps,
        )
        figures = {**rollout.log(), **self._taught(rollout, learning_rate)}
        columns = torch.stack([f.double() for f in figures.values()]).cpu()
        self.env_steps += self.steps_per_iteration
        laps("learn")
        steps = self.steps_per_iteration * len(self.seeds)
        shares = laps.shares()
        speed = {
            "speed/env_steps_per_s": steps / sum(laps.seconds.values()),
            "speed/rollout_share": 1 - shares["learn"],
            "speed/environment_share": shares.get("environment", 0.0),
            "speed/inference_share": shares["inference"],
            "speed/learn_share": shares["learn"],
            "ppo/learning_rate": learning_rate,
        }
        return [
            {**dict(zip(figures, values, strict=True)), **speed}
            for values in columns.reshape(len(figures), -1).T.tolist()
        ]

    def _learning_rate(self) -> float:
        rate = self.settings.learning_rate
        if self.settings.learning_rate_schedule == "linear":
            rate *= max(1 - self.env_steps / self.settings.steps, 0.0)
        return rate

    def _samples(self, values: Tensor, entries: int = 0) -> Tensor:
        """(slots, envs, auvs, …) as (samples, …), (replicas, samples, …) where stacked.

        The last `entries` axes are no samples.
        """
        return self.simulation.policies_first(values).flatten(self._axes, -1 - entries)

    def _moments(self, values: Tensor) -> Moments:
        """Of (slots, envs, auvs) values: (replicas) or ()."""
        return Moments.of(values, (0, -2, -1), self.group)

    def _taught(self, rollout: Rollout, learning_rate: float) -> dict[str, Tensor]:
        """Learn from a rollout, by a recording where there is one: what there is to log."""
        samples = rollout.value.numel() // len(self.seeds)
        orders = (self._order(samples) for _ in range(self.settings.epochs))
        if self._new_graph is None:
            return self._learn(rollout, orders, learning_rate)
        if self._lesson is None or self._lesson[0] is not rollout:
            self._lesson = rollout, Recorded(partial(self._learn, rollout), self._new_graph())
        rate = torch.full((), learning_rate, dtype=torch.float64, device=self.device)
        return self._lesson[1](torch.stack(list(orders)), rate)

    def _learn(
        self, rollout: Rollout, orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """Learn from a rollout.

        Args:
            rollout: the rollout.
            orders: of its samples in each epoch, as by `_order`.
            learning_rate: of this iteration.
        """
        settings = self.settings
        self.reward_scale.update(rollout.reward, rollout.truncated)
        advantage = advantages(
            rollout.reward / self.reward_scale.divisor[..., None, None],
            rollout.value,
            rollout.next_value,
            rollout.truncated,
            settings.discount,
            settings.gae_lambda,
        )
        returns = advantage + rollout.value
        of_returns = self._moments(returns)
        if settings.normalise_value:
            self.network.follow_returns(of_returns)
        data = {
            "inputs": self._samples(rollout.inputs, 1),
            "action": self._samples(rollout.action, 1),
            "log_probability": self._samples(rollout.log_probability),
            "advantage": self._samples(advantage),
            "returns": self.network.normalised_return(self._samples(returns)),
        }
        if rollout.critic_inputs is not rollout.inputs:
            data["critic_inputs"] = self._samples(rollout.critic_inputs, 1)
        if rollout.mask is not None:
            data["mask"] = self._samples(rollout.mask, 1)
        losses = self._epochs(data, orders, learning_rate)
        self._follow_inputs(self.network.scaler, rollout.observation)
        if self.network.privileged is not None and rollout.privileged is not None:
            self._follow_inputs(self.network.privileged, rollout.privileged)
        unexplained = self._moments(returns - rollout.value).variance
        explained = 1 - unexplained / of_returns.variance.clamp_min(1e-12)
        return {**losses, "ppo/explained_variance": explained}

    def _follow_inputs(self, scaler: Scaler, seen: Tensor) -> None:
        if scaler.running:
            scaler.update(Moments.of(seen, (0, -3, -2), self.group))

    def _epochs(
        self, data: dict[str, Tensor], orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        settings = self.settings
        logs: list[dict[str, Tensor]] = []
        for order in orders:
            minibatches = list(self._minibatches(order))
            normalised = self._normalised(data["advantage"], minibatches)
            for (index, samples), advantage in zip(minibatches, normalised, strict=True):
                batch = {name: _taken(values, index) for name, values in data.items()}
                batch["advantage"] = advantage
                logs.append(self._step(batch, samples, learning_rate))
            if settings.target_kl is not None and self._mean_kl(logs[-1]) > settings.target_kl:
                break
        norms = torch.stack([log.pop("gradient_norm") for log in logs])
        sums = self.group.sum(torch.stack([torch.stack([*log.values()]) for log in logs]))
        figures = dict(zip(logs[0], sums.mean(0), strict=True))
        return {f"ppo/{k}": v for k, v in {**figures, "gradient_norm": norms.mean(0)}.items()}

    def _mean_kl(self, log: dict[str, Tensor]) -> float:
        return float(self.group.sum(log["kl"].clone()))

    def _order(self, own_samples: int) -> Tensor:
        """A new order of the samples of all processes: (samples) or (replicas, samples)."""
        every = own_samples * self.group.size
        orders = [
            torch.randperm(every, generator=generator, device=self.device)
            for generator in self.simulation.generators
        ]
        return torch.stack(orders) if self._axes else orders[0]

    def _minibatches(self, order: Tensor) -> Iterator[tuple[Tensor, int]]:
        """Indices of samples, (samples) or (replicas, samples), and how many all have of them."""
        for index in order.tensor_split(self.settings.minibatches, dim=-1):
            yield self._own(index), index.shape[-1]

    def _own(self, index: Tensor) -> Tensor:
        """Of samples of all processes, those of this one, as it counts them."""
        if self.group.size == 1:
            return index
        auvs = self.simulation.world.num_auvs
        row = self.settings.environments * auvs
        own = self.group.share(row)
        slot, place = index // row, index % row
        is_own = (place >= own.start) & (place < own.stop)
        return (slot * (own.stop - own.start) + place - own.start)[is_own]

    def _normalised(self, advantage: Tensor, minibatches: list[tuple[Tensor, int]]) -> list[Tensor]:
        """The advantages of each minibatch, of mean 0 and spread 1 over all of its samples."""
        parts = [_taken(advantage, index) for index, _ in minibatches]
        if not self.settings.normalise_advantage:
            return parts
        exact = [part.double() for part in parts]
        sums = torch.stack([torch.stack([e.sum(-1), e.square().sum(-1)]) for e in exact])
        normalised = []
        for part, (total, squares), (_, samples) in zip(
            parts, self.group.sum(sums), minibatches, strict=True
        ):
            if samples > 1:
                mean = total / samples
                spread = ((squares - samples * mean**2) / (samples - 1)).clamp_min(0).sqrt()
                mean, spread = mean.float(), spread.float() + 1e-8
                part = (part - aligned(mean, part)) / aligned(spread, part)  # noqa: PLW2901
            normalised.append(part)
        return normalised

    def _step(
        self, batch: dict[str, Tensor], samples: int, learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """One step of the optimiser on a minibatch (eq. `total loss function`).

        What it returns for the log are this process's parts of sums over all.

        Args:
            batch: this process's part of the minibatch, the advantages normalised.
            samples: size of the whole minibatch, of each policy.
            learning_rate: of this step.
        """
        settings, network = self.settings, self.network
        of_policy = policy_loss(
            network.scores(batch["inputs"], batch.get("mask")),
            batch["action"],
            batch["log_probability"],
            batch["advantage"],
            settings.clip,
            settings.entropy_coefficient,
            samples,
        )
        value = network.normalised_value(batch.get("critic_inputs", batch["inputs"]))
        value_loss = (value - batch["returns"]).square().sum(-1) / samples
        loss = of_policy.loss + settings.value_coefficient * value_loss
        loss.sum().backward()  # type: ignore[no-untyped-call]
        gradient = self.group.sum(self.optimizer.gradient())
        gradient, norm = clipped(gradient, settings.max_gradient_norm)
        self.optimizer.step(gradient, learning_rate)
        log = {**of_policy._asdict(), "value_loss": value_loss, "loss": loss}
        return {**{name: value.detach() for name, value in log.items()}, "gradient_norm": norm}

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """All that the training of one policy goes on from, as tensors and plain values.

        It is the same whatever was trained beside it, and by how many processes; these have
        to ask for it together.
        """
        return {
            "network": self.weights(policy),
            "optimizer": self.optimizer.state_dict(policy),
            "reward_scale": self.reward_scale.state_dict(policy),
            "simulation": self.simulation.state_dict(policy),
            "env_steps": self.env_steps,
            "seed": self.seeds[policy],
            "side_by_side": [self.seeds.start, len(self.seeds)],
        }

    def policy(self, policy: int = 0, name: str = "ppo") -> TrainedPolicy:
        """One policy as it is now, to be evaluated.

        Args:
            policy: which.
            name: what tables call it.
        """
        world = self.simulation.world
        network = make_network(world.observer, world.action_sizes, self.settings).to(self.device)
        network.load_state_dict(self.weights(policy))
        return TrainedPolicy(
            network, name, use_mask=self.settings.mask_actions, num_auvs=world.num_auvs
        )

    def weights(self, policy: int = 0) -> dict[str, Tensor]:
        """The `state_dict` of one policy's networks."""
        weights = self.network.state_dict()
        return {k: (v[policy] if self._axes else v).clone() for k, v in weights.items()}

    def load_state_dict(self, *saved: dict[str, Any]) -> None:
        """Go on from the `state_dict` of each policy; on a CPU, bit for bit as if never stopped."""
        weights = [one["network"] for one in saved]
        self.network.load_state_dict(
            {
                k: torch.stack([w[k] for w in weights]) if self._axes else weights[0][k]
                for k in weights[0]
            }
        )
        self.optimizer.load_state_dict([one["optimizer"] for one in saved])
        self.reward_scale.load_state_dict([one["reward_scale"] for one in saved])
        self.simulation.load_state_dict([one["simulation"] for one in saved])
        self._lesson = None
        self.env_steps = saved[0]["env_steps"]
        self.seeds = range(saved[0]["seed"], saved[0]["seed"] + len(saved))


def _check_shares(settings: Training, replicas: int, group: Group) -> None:
    if settings.environments % group.size:
        raise InputError(
            f"training.environments: {settings.environments} cannot be shared evenly by "
            f"{group.size} processes"
        )
    if group.size > 1 and replicas > 1:
        raise InputError(
            "--replicas: policies side by side are trained by one process, without torchrun"
        )
    if settings.target_kl is not None and replicas > 1:
        raise InputError(
            "training.target_kl: policies trained side by side cannot stop their epochs apart; "
            "set it to null, or train them one after the other"
        )


def _taken(values: Tensor, index: Tensor) -> Tensor:
    """The samples at (samples) or (replicas, samples) indices."""
    if index.ndim == 1:
        return values.index_select(0, index)
    return values[torch.arange(len(index), device=index.device)[:, None], index]
