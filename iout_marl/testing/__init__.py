"""Checks for whoever brings something of their own: environments, and parts of scenarios.

    from iout_marl import iout_v0, parts
    from iout_marl.testing import check_parallel_env, check_part

    check_parallel_env(lambda: iout_v0.parallel_env("paper/k3-fdd"))
    check_part(parts.rewards, "mine", {"weight": 2.0})

Each raises an `AssertionError` with what it has found.
"""

from iout_marl.testing.environments import (
    MAX_SLOTS,
    SEEDS,
    assert_equal,
    check_contained,
    check_copies_continue,
    check_deterministic,
    check_global_generators_untouched,
    check_nothing_is_mutated,
    check_parallel_env,
    check_reset_repeats,
    check_vector_env,
    play,
    play_on,
    sample_actions,
)
from iout_marl.testing.parts import check_part

__all__ = [
    "MAX_SLOTS",
    "SEEDS",
    "assert_equal",
    "check_contained",
    "check_copies_continue",
    "check_deterministic",
    "check_global_generators_untouched",
    "check_nothing_is_mutated",
    "check_parallel_env",
    "check_part",
    "check_reset_repeats",
    "check_vector_env",
    "play",
    "play_on",
    "sample_actions",
]
