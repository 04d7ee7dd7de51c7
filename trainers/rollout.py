"""What a policy has seen and done in a number of slots, and the memory that it is written to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
from torch import Tensor

from iout_marl.metrics import described


@dataclass
class Rollout:
    """A rollout: (slots, policies, envs, auvs, …) each; `truncated` is (slots,).

    All environments start and end their episodes together, so that one flag a slot
    tells of all of them. Where slots are captured, the next rollout is written over it.
    """

    observation: Tensor | None  # (…, entries) float32, as the world gives it, for running scalers
    privileged: Tensor | None  # (…, entries) float32, for the critic alone
    inputs: Tensor  # (…, entries) float32, scaled as the policy saw it
    critic_inputs: Tensor  # (…, entries) float32, scaled as the critic saw it
    mask: Tensor | None  # (…, choices) bool, where masks are in use
    action: Tensor  # (…, action entries) int64
    log_probability: Tensor | None  # float32; None where a teacher has chosen the actions
    value: Tensor  # float32
    reward: Tensor  # float32, as the world gives it
    truncated: Tensor  # (slots,) bool: the episode ended with this slot
    next_value: Tensor  # float32: value of what followed the slot
    episodes: list[dict[str, Tensor]] = field(default_factory=list)  # metrics: mean over envs
    reward_terms: dict[str, Tensor] = field(default_factory=dict)  # mean of each term a slot

    def samples(self) -> dict[str, Tensor]:
        """What the losses need of every sample: (policies, samples, …) each."""
        found = {
            "inputs": self.inputs,
            "critic_inputs": None if self.critic_inputs is self.inputs else self.critic_inputs,
            "mask": self.mask,
            "action": self.action,
            "log_probability": self.log_probability,
        }
        return {name: samples_of(v) for name, v in found.items() if v is not None}

    def log(self) -> dict[str, Tensor]:
        """Means of the episodes that ended, and of the rewards, by tag: (policies,) each."""
        log = {
            described(name).tag: torch.stack([e[name] for e in self.episodes]).mean(0)
            for name in (self.episodes[0] if self.episodes else ())
        }
        log |= {f"reward/{name}": value for name, value in self.reward_terms.items()}
        log[described("reward").tag] = torch.stack(list(self.reward_terms.values())).sum(0)
        return log


@dataclass
class RolloutStorage:
    """The memory of a rollout, and what its slots read and add up."""

    rollout: Rollout
    noise: Tensor  # (slots, policies, envs, auvs, action entries): chooses the actions
    chance: dict[str, Tensor]  # (slots, policies, envs, …): what the world leaves to chance
    row: Tensor  # (1,) int64: the slot that comes next, where slots are captured
    totals: dict[str, Any] = field(default_factory=dict)  # sum of each reward term, (envs, auvs)

    @classmethod
    def allocate(
        cls,
        shape: Sequence[int],
        noise: Tensor,
        *,
        entries: int,
        privileged: int,
        choices: int,
        keep_observations: bool,
        use_mask: bool,
        is_shown: bool,
        chance: dict[str, Tensor],
    ) -> RolloutStorage:
        """Memory for a rollout.

        Args:
            shape: slots, policies, envs, auvs.
            noise: (…, action entries), see there.
            entries: of an observation.
            privileged: of what the critic alone sees.
            choices: of all entries of an action together.
            keep_observations: keep them as the world gives them, too.
            use_mask: keep masks.
            is_shown: a teacher chooses the actions.
            chance: see there.
        """

        def empty(*inner: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.empty(*shape, *inner, dtype=dtype, device=noise.device)

        inputs = empty(entries)
        rollout = Rollout(
            observation=empty(entries) if keep_observations else None,
            privileged=empty(privileged) if privileged else None,
            inputs=inputs,
            critic_inputs=empty(entries + privileged) if privileged else inputs,
            mask=empty(choices, dtype=torch.bool) if use_mask else None,
            action=empty(noise.shape[-1], dtype=torch.int64),
            log_probability=None if is_shown else empty(),
            value=empty(),
            reward=empty(),
            truncated=torch.zeros(shape[0], dtype=torch.bool, device=noise.device),
            next_value=empty(),
        )
        row = torch.zeros(1, dtype=torch.int64, device=noise.device)
        return cls(rollout, noise, chance, row)

    def restart(self, noise: Tensor, chance: dict[str, Tensor]) -> None:
        """Make it ready for another rollout with this noise and chance, in the same memory."""
        self.noise.copy_(noise)
        for name, rows in chance.items():
            self.chance[name].copy_(rows)
        self.row.zero_()
        self.rollout.truncated.zero_()
        self.rollout.episodes = []
        for total in self.totals.values():
            total.zero_()

    @staticmethod
    def at(rows: Tensor, t: int | Tensor) -> Tensor:
        """The row of a slot: a number, or a (1,) tensor."""
        return rows[t] if isinstance(t, int) else rows.index_select(0, t)[0]

    def write(self, t: int | Tensor, **values: Tensor | None) -> None:
        """Write fields of the rollout at a slot: a number, or a (1,) tensor.

        Fields that the rollout does not keep are left out.
        """
        for name, value in values.items():
            rows = getattr(self.rollout, name)
            if rows is None or value is None:
                continue
            if isinstance(t, int):
                rows[t] = value
            else:
                rows.index_copy_(0, t, value[None])


def policies_first(values: Tensor) -> Tensor:
    """(slots, policies, …) as (policies, slots, …), and back."""
    return values.transpose(0, 1)


def samples_of(values: Tensor) -> Tensor:
    """(slots, policies, envs, auvs, …) as (policies, samples, …)."""
    return policies_first(values).flatten(1, 3)
