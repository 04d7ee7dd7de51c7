"""The most probable actions of a policy, in place of the one most probable choice of each entry."""

from __future__ import annotations

import torch
from torch import Tensor

from trainers.networks import IMPOSSIBLE, ActorCritic


def likely_actions(
    network: ActorCritic, inputs: Tensor, mask: Tensor | None, number: int
) -> tuple[Tensor, Tensor]:
    """The most probable actions of an AUV, the most probable first.

    Of an actor that chooses one entry after the other, they are the best that a beam search finds
    which keeps so many after each entry.

    Args:
        network: the networks.
        inputs: (…, entries) scaled observations.
        mask: (…, choices) bool; None where everything is allowed.
        number: how many, at most; there may be fewer. Where fewer are allowed, the most probable
            one stands in the place of the others.

    Returns:
        (…, number, action entries) actions and (…, number) log-probabilities.
    """
    lead, entries = inputs.shape[:-1], len(network.action_sizes)
    actions = torch.zeros(*lead, 1, entries, dtype=torch.int64, device=inputs.device)
    found = torch.zeros(*lead, 1, device=inputs.device)
    for entry, size in enumerate(network.action_sizes):
        kept = actions.shape[-2]
        seen = inputs.unsqueeze(-2).expand(*lead, kept, -1)
        allowed = None if mask is None else mask.unsqueeze(-2).expand(*lead, kept, -1)
        logits = network.logits(seen, allowed, actions)
        of_entry = network.log_probabilities(logits)[..., entry, :size]
        found, parent, choice = _best(found[..., None] + of_entry, number)
        actions = actions.gather(-2, parent[..., None].expand(*parent.shape, entries))
        actions[..., entry] = choice
    is_allowed = found > IMPOSSIBLE / 2
    actions = torch.where(is_allowed[..., None], actions, actions[..., :1, :])
    return actions, torch.where(is_allowed, found, found[..., :1])


def likely_together(actions: Tensor, log_probability: Tensor) -> Tensor:
    """The most probable actions of several AUVs that each draw their own.

    Args:
        actions: (envs, auvs, number, entries) those of each.
        log_probability: (envs, auvs, number) of these.

    Returns:
        (envs, number, auvs, entries), the most probable first.
    """
    number, env = actions.shape[2], torch.arange(len(actions), device=actions.device)[:, None]
    joint, found = actions[:, 0, :, None], log_probability[:, 0]
    for own, its_log_probability in zip(
        actions.unbind(1)[1:], log_probability.unbind(1)[1:], strict=True
    ):
        pairs = found[:, :, None] + its_log_probability[:, None]
        found, parent, choice = _best(pairs, number)
        joint = torch.cat([joint[env, parent], own[env, choice][:, :, None]], dim=2)
    return joint


def _best(values: Tensor, number: int) -> tuple[Tensor, Tensor, Tensor]:
    """The largest of (…, rows, columns) values, (…, number), and the row and column of each."""
    flat = values.flatten(-2)
    best, index = flat.topk(min(number, flat.shape[-1]), dim=-1)
    columns = values.shape[-1]
    return best, index // columns, index % columns
