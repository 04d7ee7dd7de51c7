"""Proximal policy optimisation (Schulman et al., 2017) on the batched world.

The loop, top to bottom: `Trainer.iterate` collects a rollout, estimates advantages and
takes the clipped-surrogate steps. Every setting is explained in
`iout_marl.scenario.Training`; every quantity that is logged, in `Trainer.iterate`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from iout_marl.scenario import Scenario, Training
from iout_marl.world import pin_layout
from iout_marl.world.observation import Observer, Ranges
from trainers.networks import ActorCritic, Scaler
from trainers.rollout import Rollout, Simulation


def advantages(
    reward: Tensor,
    value: Tensor,
    next_value: Tensor,
    truncated: list[bool],
    discount: float,
    gae_lambda: float,
) -> Tensor:
    """Generalised advantage estimation (Schulman et al., 2016).

    Â_t = δ_t + γλ Â_{t+1}, δ_t = r_t + γ V(s_{t+1}) − V(s_t). Where an episode is
    truncated, V(s_{t+1}) is the value of its last state and the sum over later slots ends.

    Args:
        reward, value, next_value: (slots, …) each.
        truncated: (slots,), whether the episode ended with the slot.
        discount: γ.
        gae_lambda: λ.

    Returns:
        (slots, …) advantages.
    """
    delta = reward + discount * next_value - value
    result = torch.empty_like(delta)
    running = torch.zeros_like(delta[0])
    for t in reversed(range(delta.shape[0])):
        running = delta[t] + (0.0 if truncated[t] else discount * gae_lambda) * running
        result[t] = running
    return result


class RewardScale:
    """The divisor of the rewards, so that values are of order one.

    Args:
        kind: `none`; `first_rollout`, the spread of the rewards of the first rollout;
            `running`, the spread of the discounted return over all that was seen.
        discount: γ.
    """

    def __init__(self, kind: str, discount: float) -> None:
        self._kind = kind
        self._discount = discount
        self._return: Tensor | None = None
        self._count = 0.0
        self._mean = 0.0
        self._variance = 0.0
        self.divisor = 1.0

    def update(self, reward: Tensor, truncated: list[bool]) -> None:
        """Take in (slots, envs, auvs) rewards."""
        if self._kind == "first_rollout" and self._count == 0:
            self._count = 1.0
            self.divisor = max(float(reward.std(correction=0)), 1e-6)
        elif self._kind == "running":
            if self._return is None:
                self._return = torch.zeros_like(reward[0])
            for slot_reward, ended in zip(reward, truncated, strict=True):
                self._return = self._return * self._discount + slot_reward
                self._merge(self._return)
                if ended:
                    self._return = torch.zeros_like(self._return)
            self.divisor = max(math.sqrt(self._variance), 1e-6)

    def _merge(self, values: Tensor) -> None:
        number = values.numel()
        mean, variance = float(values.mean()), float(values.var(correction=0))
        total = self._count + number
        delta = mean - self._mean
        self._variance = (
            self._variance * self._count
            + variance * number
            + delta**2 * self._count * number / total
        ) / total
        self._mean += delta * number / total
        self._count = total

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` goes on from."""
        return {
            "return": None if self._return is None else self._return.cpu(),
            "moments": [self._count, self._mean, self._variance, self.divisor],
        }

    def load_state_dict(self, saved: dict[str, Any], device: torch.device) -> None:
        """Go on from a `state_dict`."""
        self._return = None if saved["return"] is None else saved["return"].to(device)
        self._count, self._mean, self._variance, self.divisor = saved["moments"]


class Trainer:
    """Trains one policy, shared by all AUVs, on a scenario.

    Args:
        scenario: the scenario; its `training` section has the settings. A layout that
            is drawn once for a run is drawn from `seed`.
        seed: seeds weights, layouts, actions and minibatches.
        device: where to train.

    Attributes:
        scenario: the scenario, its layout pinned.
        network: actor and critic.
        env_steps: environment steps taken so far.
    """

    def __init__(
        self, scenario: Scenario, seed: int = 0, device: str | torch.device = "cpu"
    ) -> None:
        self.scenario = pin_layout(scenario, seed)
        self.settings: Training = self.scenario.training
        self.seed = seed
        self.device = torch.device(device)
        self.simulation = Simulation(self.scenario, self.settings.environments, self.device, seed)
        # Weights come from torch's global generator, which is put back as it was.
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed)
            self.network = self._make_network().to(self.device)
        self.optimizer = torch.optim.Adam(
            self.network.parameters(),
            lr=self.settings.learning_rate,
            eps=self.settings.adam_epsilon,
            foreach=True,
        )
        self.reward_scale = RewardScale(self.settings.reward_scaling, self.settings.discount)
        self.env_steps = 0

    def _make_network(self) -> ActorCritic:
        world = self.simulation.world
        return make_network(world.observer, world.action_sizes, self.settings)

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of a rollout."""
        return self.settings.environments * self.settings.rollout_slots

    @property
    def finished(self) -> bool:
        """Whether the scenario's number of steps has been taken."""
        return self.env_steps >= self.settings.steps

    def iterate(self) -> dict[str, float]:
        """One iteration: a rollout, and the epochs of learning from it.

        Returns:
            what there is to log, by TensorBoard tag:

            - `aoi/…`, `fairness/…`, `energy/…`, `uplink/…`, `constraints/…`: metrics of
              the episodes that ended in the rollout, as in `World.metrics`;
            - `reward/…`: mean of each term of the reward a slot, and their `total`;
            - `ppo/loss`, and its terms `ppo/policy_loss`, `ppo/value_loss`, `ppo/entropy`;
              `ppo/kl`: mean Kullback-Leibler divergence from the policy of the rollout,
              (r − 1) − log r; `ppo/clip_fraction`: share of ratios that were clipped;
              `ppo/explained_variance`: of the returns, by the critic of the rollout;
              `ppo/gradient_norm`: before clipping; `ppo/learning_rate`;
            - `speed/…`: environment steps a second, and how the time is shared.
        """
        started = time.perf_counter()
        rollout = self.simulation.collect(
            self.network, self.settings.rollout_slots, use_mask=self.settings.mask_actions
        )
        collected = time.perf_counter()
        learning = self._learn(rollout)
        self.env_steps += self.steps_per_iteration
        ended = time.perf_counter()
        return {
            **_episode_log(rollout),
            **learning,
            "speed/env_steps_per_s": self.steps_per_iteration / (ended - started),
            "speed/rollout_share": (collected - started) / (ended - started),
            "speed/learn_share": (ended - collected) / (ended - started),
        }

    def _learning_rate(self) -> float:
        rate = self.settings.learning_rate
        if self.settings.learning_rate_schedule == "linear":
            rate *= max(1 - self.env_steps / self.settings.steps, 0.0)
        return rate

    def _learn(self, rollout: Rollout) -> dict[str, float]:
        settings = self.settings
        self.reward_scale.update(rollout.reward, rollout.truncated)
        advantage = advantages(
            rollout.reward / self.reward_scale.divisor,
            rollout.value,
            rollout.next_value,
            rollout.truncated,
            settings.discount,
            settings.gae_lambda,
        )
        returns = advantage + rollout.value
        if settings.normalise_value:
            self.network.follow_returns(returns)
        data = {
            "inputs": rollout.inputs.flatten(0, 2),
            "action": rollout.action.flatten(0, 2),
            "log_probability": rollout.log_probability.flatten(),
            "advantage": advantage.flatten(),
            "returns": self.network.normalised_return(returns).flatten(),
        }
        if rollout.critic_inputs is not rollout.inputs:
            data["critic_inputs"] = rollout.critic_inputs.flatten(0, 2)
        if rollout.mask is not None:
            data["mask"] = rollout.mask.flatten(0, 2)
        rate = self._learning_rate()
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        losses = self._epochs(data)
        self.network.scaler.update(rollout.observation)
        if self.network.privileged is not None and rollout.privileged is not None:
            self.network.privileged.update(rollout.privileged)
        unexplained = float((returns - rollout.value).var())
        return {
            **losses,
            "ppo/explained_variance": 1 - unexplained / max(float(returns.var()), 1e-12),
            "ppo/learning_rate": rate,
        }

    def _epochs(self, data: dict[str, Tensor]) -> dict[str, float]:
        settings = self.settings
        logs: list[dict[str, Tensor]] = []
        for _ in range(settings.epochs):
            logs += [
                self._step({k: v[index] for k, v in data.items()})
                for index in self._minibatches(len(data["returns"]))
            ]
            if settings.target_kl is not None and float(logs[-1]["kl"]) > settings.target_kl:
                break
        return {f"ppo/{k}": float(torch.stack([log[k] for log in logs]).mean()) for k in logs[0]}

    def _minibatches(self, samples: int) -> Iterator[Tensor]:
        generator = self.simulation.generator
        order = torch.randperm(samples, generator=generator, device=self.device)
        yield from order.tensor_split(self.settings.minibatches)

    def _step(self, batch: dict[str, Tensor]) -> dict[str, Tensor]:
        """One step of the optimiser on a minibatch (eq. `total loss function`)."""
        settings, network = self.settings, self.network
        policy = network.log_probabilities(batch["inputs"], batch.get("mask"))
        log_ratio = network.log_probability(policy, batch["action"]) - batch["log_probability"]
        ratio = log_ratio.exp()
        advantage = batch["advantage"]
        if settings.normalise_advantage and len(advantage) > 1:
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        clipped = ratio.clamp(1 - settings.clip, 1 + settings.clip)
        policy_loss = -torch.minimum(ratio * advantage, clipped * advantage).mean()
        value_loss = nn.functional.mse_loss(
            network.normalised_value(batch.get("critic_inputs", batch["inputs"])),
            batch["returns"],
        )
        entropy = network.entropy(policy).mean()
        loss = (
            policy_loss
            + settings.value_coefficient * value_loss
            - settings.entropy_coefficient * entropy
        )
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        norm = nn.utils.clip_grad_norm_(network.parameters(), settings.max_gradient_norm)
        self.optimizer.step()
        with torch.no_grad():
            return {
                "loss": loss.detach(),
                "policy_loss": policy_loss.detach(),
                "value_loss": value_loss.detach(),
                "entropy": entropy.detach(),
                "kl": (ratio - 1 - log_ratio).mean(),
                "clip_fraction": ((ratio - 1).abs() > settings.clip).float().mean(),
                "gradient_norm": norm,
            }

    def state_dict(self) -> dict[str, Any]:
        """All that training goes on from, as tensors and plain values."""
        return {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "reward_scale": self.reward_scale.state_dict(),
            "simulation": self.simulation.state_dict(),
            "env_steps": self.env_steps,
            "seed": self.seed,
        }

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Go on from a `state_dict`; on a CPU, bit for bit as if never stopped."""
        self.network.load_state_dict(saved["network"])
        self.optimizer.load_state_dict(saved["optimizer"])
        self.reward_scale.load_state_dict(saved["reward_scale"], self.device)
        self.simulation.load_state_dict(saved["simulation"])
        self.env_steps = saved["env_steps"]
        self.seed = saved["seed"]


def make_network(
    observer: Observer, action_sizes: tuple[int, ...], settings: Training
) -> ActorCritic:
    """Untrained networks for a world's observations and actions of these sizes."""
    privileged = observer.critic_ranges(central=settings.critic == "central")
    return ActorCritic(
        _scaler(observer.agent_ranges, settings),
        action_sizes,
        settings.hidden_units,
        settings.activation,
        None if privileged is None else _scaler(privileged, settings),
        observer.node_entries if settings.node_network else None,
    )


def _scaler(ranges: Ranges, settings: Training) -> Scaler:
    entries = len(ranges.low)
    shift, scale, limit = np.zeros(entries), np.ones(entries), math.inf
    if settings.observation_scaling == "fixed":
        shift, scale, limit = ranges.low, ranges.scale, ranges.limit
    elif settings.observation_scaling == "running":
        limit = 10.0
    return Scaler(
        torch.from_numpy(shift),
        torch.from_numpy(scale),
        limit,
        running=settings.observation_scaling == "running",
    )


def _episode_log(rollout: Rollout) -> dict[str, float]:
    """Mean over the episodes that ended in a rollout, by TensorBoard tag."""
    tags = {
        "mean_aoi": "aoi/mean",
        "final_aoi": "aoi/final",
        "peak_aoi": "aoi/peak",
        "jain": "fairness/jain",
        "harvested_kj": "energy/harvested_kj",
        "spent_kj": "energy/spent_kj",
        "uplink_success": "uplink/success_rate",
        "age_violations": "constraints/age_violations",
        "jain_violation": "constraints/jain_violation",
    }
    log = {
        tag: sum(e[name] for e in rollout.episodes) / len(rollout.episodes)
        for name, tag in tags.items()
        if rollout.episodes
    }
    log |= {f"reward/{name}": value for name, value in rollout.reward_terms.items()}
    log["reward/total"] = sum(rollout.reward_terms.values())
    return log
