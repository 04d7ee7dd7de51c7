"""Rewards, term by term."""

from iout_marl.parts.reward.base import Reward, WeightedAge, rewards

__all__ = ["Reward", "WeightedAge", "rewards"]
