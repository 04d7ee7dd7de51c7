"""What policies are called on pages and in films."""

from types import SimpleNamespace

import pytest

from iout_marl.replay.names import short_names


@pytest.mark.parametrize(
    ("policies", "names"),
    [
        (["greedy"], ["greedy"]),
        (["/home/me/runs/mine", "tour"], ["mine", "tour"]),
        (["runs/a/seed-0", "runs/b/seed-0"], ["a/seed-0", "b/seed-0"]),
        (["runs/mine", "other/runs/mine"], ["runs/mine", "other/runs/mine"]),
        (["../mine.py:Still", "greedy"], ["mine.py:Still", "greedy"]),
        (["greedy", "greedy"], ["greedy", "greedy"]),
        ([""], [""]),
    ],
)
def test_as_short_as_tells_them_apart(policies, names):
    assert short_names([SimpleNamespace(policy=policy) for policy in policies]) == names
