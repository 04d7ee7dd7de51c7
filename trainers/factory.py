"""Networks for a world."""

from __future__ import annotations

import math

import numpy as np
import torch

from iout_marl.scenario import Training
from iout_marl.world.observation import Observer, Ranges
from trainers.networks import ActorCritic, Scaler


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
