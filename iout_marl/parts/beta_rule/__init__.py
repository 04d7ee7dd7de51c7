"""Rules for β, the share of a slot that TDD gives to charging."""

from iout_marl.parts.beta_rule.base import BetaRule, beta_rules

__all__ = ["BetaRule", "beta_rules"]
