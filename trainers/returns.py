"""Advantages, and the scale of the rewards that they are made of."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from trainers.accel import Runtime
from trainers.accel.graphs import write_over
from trainers.accel.group import ProcessGroup
from trainers.moments import Moments
from trainers.networks import expand_replicas


def advantages(
    reward: Tensor,
    value: Tensor,
    next_value: Tensor,
    truncated: Tensor,
    discount: float,
    gae_lambda: float,
) -> Tensor:
    """Generalised advantage estimation (Schulman et al., 2016).

    Â_t = δ_t + γλ Â_{t+1}, δ_t = r_t + γ V(s_{t+1}) − V(s_t). Where an episode is
    truncated, V(s_{t+1}) is the value of its last state and the sum over later slots ends.

    Args:
        reward, value, next_value: (slots, …) each.
        truncated: (slots,) bool, whether the episode ended with the slot.
        discount: γ.
        gae_lambda: λ.

    Returns:
        (slots, …) advantages.
    """
    delta = reward + discount * next_value - value
    carried = (~truncated).to(delta.dtype) * (discount * gae_lambda)
    result = torch.empty_like(delta)
    running = torch.zeros_like(delta[0])
    for t in reversed(range(delta.shape[0])):
        running = delta[t] + carried[t] * running
        result[t] = running
    return result


def standardised(reward: Tensor, truncated: Tensor, discount: float, group: ProcessGroup) -> Tensor:
    """Rewards whose discounted returns in the rollout have mean 0 and standard deviation 1.

    With the mean μ and the standard deviation σ of the returns, r' = (r − (1 − γ) μ) / σ: values
    of r are μ + σ V' where V' are those of r'. Of each rollout anew, as scenarios differ from one
    to the next. What follows an episode, or the rollout, counts as mean reward / (1 − γ).

    Args:
        reward: (slots, policies, envs, auvs).
        truncated: (slots,) bool, whether the episode ended with the slot.
        discount: γ, below 1.
        group: the processes that share the environments.
    """
    beyond = Moments.from_values(reward, (0, -2, -1), group).mean / (1 - discount)
    exact = reward.double()
    beyond = expand_replicas(beyond, exact[0])
    returns = torch.empty_like(exact)
    following = beyond.expand(exact.shape[1:])
    for t in reversed(range(len(exact))):
        following = torch.where(truncated[t], beyond, following)
        following = returns[t] = exact[t] + discount * following
    moments = Moments.from_values(returns, (0, -2, -1), group)
    mean = expand_replicas(moments.mean, exact[0])
    std = expand_replicas(moments.variance.sqrt().clamp_min(1e-6), exact[0])
    return ((exact - (1 - discount) * mean) / std).to(reward.dtype)


class RewardScale:
    """The divisor of the rewards, so that values are of order one.

    Args:
        kind: `none`; `first_rollout`, the standard deviation of the rewards of the first
            rollout; `running`, that of the discounted return over all that was seen.
        discount: γ.
        replicas: how many policies.
        runtime: the processes that share the environments.

    Attributes:
        divisor: (policies).
    """

    def __init__(self, kind: str, discount: float, replicas: int, runtime: Runtime) -> None:
        self._kind = kind
        self._discount = discount
        self._group = runtime.group
        self._return: Tensor | None = None
        self._seen = Moments.from_no_values((replicas,), runtime.device)
        self._is_first = True

    @property
    def divisor(self) -> Tensor:
        std = self._seen.variance.sqrt().clamp_min(1e-6).float()
        return torch.ones_like(std) if self._kind == "none" else std

    def scaled(self, reward: Tensor, truncated: Tensor) -> Tensor:
        """Rewards, (slots, policies, envs, auvs), once they are taken in; see `update`."""
        self.update(reward, truncated)
        return reward / self.divisor[..., None, None]

    def update(self, reward: Tensor, truncated: Tensor) -> None:
        """Take in rewards.

        Args:
            reward: (slots, policies, envs, auvs).
            truncated: (slots,) bool, whether the episode ended with the slot.
        """
        if self._kind == "none" or (self._kind == "first_rollout" and not self._is_first):
            return
        self._is_first = False
        if self._kind == "running":
            reward = self._discounted(reward, truncated)
        merged = self._seen.merged(Moments.from_values(reward, (0, -2, -1), self._group))
        write_over(self._seen, merged)

    def _discounted(self, reward: Tensor, truncated: Tensor) -> Tensor:
        """The return so far in every slot; it begins anew with each episode."""
        if self._return is None:
            self._return = torch.zeros_like(reward[0])
        now, returns = self._return, []
        continues = (~truncated).to(reward.dtype)
        for slot_reward, carried in zip(reward, continues, strict=True):
            returns.append(now * self._discount + slot_reward)
            now = returns[-1] * carried
        self._return.copy_(now)
        return torch.stack(returns)

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """What `load_state_dict` continues from, for one policy; see `Collector.state_dict`."""
        own = None
        if self._return is not None:
            own = self._group.join(self._return[policy].clone()).cpu()
        moments = torch.stack([m.expand(self._seen.mean.shape) for m in self._seen]).cpu()
        return {
            "return": own,
            "moments": moments[:, policy].tolist(),
            "is_first": self._is_first,
        }

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """Continue from the `state_dict` of each policy."""
        device = self._seen.mean.device
        moments = torch.tensor([one["moments"] for one in saved], dtype=torch.float64)
        mean, variance, number = (each.clone() for each in moments.to(device).unbind(-1))
        self._seen = Moments(mean, variance, number[0].clone())
        self._is_first = saved[0]["is_first"]
        self._return = None
        if saved[0]["return"] is not None:
            parts = [one["return"][self._group.share(len(one["return"]))] for one in saved]
            self._return = torch.stack(parts).to(device)
