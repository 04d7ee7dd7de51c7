"""Names of the paper study's series, as `scenarios/studies/paper.yaml` gives them."""

from __future__ import annotations

RANDOM_WALK, ROUND_ROBIN, GREEDY = BASELINES = ("random-walk", "round-robin", "greedy")
TDD, FDD = TRAINED = ("PPO-TDD", "PPO-FDD")
LONGER_TDD = "PPO-TDD, three times as long"
BEST_TDD, BEST_FDD = BEST = ("Mean-AoI TDD", "Mean-AoI FDD")


def in_fdd(baseline: str) -> str:
    """A baseline in the FDD world."""
    return f"{baseline} (FDD)"
