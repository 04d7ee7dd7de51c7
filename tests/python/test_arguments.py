"""Arguments that functions refuse, in one line that names them."""

import math

import pytest

from iout_marl import InputError, bound, evaluate, parts
from iout_marl.replay.recorder import record_policy
from iout_marl.testing import check_part
from trainers import Trainer, train

SEEDS = [
    ("x", "must be a whole number, not 'x'"),
    (1.5, r"must be a whole number, not 1\.5"),
    (True, "must be a whole number, not True"),
    (None, "must be a whole number, not None"),
    (-1, "must be at least 0, not -1"),
    (2**64, "must be at most"),
]


@pytest.mark.parametrize(("seed", "message"), SEEDS, ids=lambda each: str(each)[:5])
def test_seeds(tmp_path, seed, message):
    calls = [
        lambda: train("paper/k3-fdd", tmp_path / "run", seed),
        lambda: Trainer("paper/k3-fdd", seed),
        lambda: evaluate("paper/k3-fdd", "greedy", 1, seed),
        lambda: record_policy("paper/k3-fdd", "greedy", seed),
    ]
    for call in calls:
        with pytest.raises(InputError, match=f"^seed {message}"):
            call()
    assert not (tmp_path / "run").exists()


def test_the_last_of_several_seeds_is_one():
    with pytest.raises(InputError, match=r"^seed must be at most 18,446,744,073,709,551,614, not"):
        Trainer("paper/k3-fdd", 2**64 - 1, replicas=2)


@pytest.mark.parametrize("seconds", ["a", None, -1, math.nan, True, [1]], ids=str)
def test_seconds_of_a_bound(seconds):
    with pytest.raises(InputError, match=r"^seconds must be 0 or more, not "):
        bound("paper/k3-fdd", seconds=seconds)


@pytest.mark.parametrize("best_known", ["a", 0, math.inf], ids=str)
def test_best_known_of_a_bound(best_known):
    with pytest.raises(InputError, match=r"^best_known must be a mean AoI above 0, not "):
        bound("paper/k3-fdd", best_known=best_known)


@pytest.mark.parametrize("policy", [None, object(), 3], ids=["None", "object", "3"])
def test_policies_that_are_none(policy):
    with pytest.raises(InputError, match=r"^a policy needs a name and a method act") as raised:
        evaluate("paper/k3-fdd", policy)
    assert isinstance(raised.value, TypeError)


def test_settings_of_a_part_that_is_checked():
    message = "^reward 'mean_age': fairness_wieght: unknown key; did you mean 'fairness_weight'"
    with pytest.raises(InputError, match=message):
        check_part(parts.rewards, "mean_age", {"fairness_wieght": 2})


@pytest.mark.parametrize("base", [parts.Settings, parts.rewards["mean_age"].item.Settings])
def test_settings_without_a_type(base):
    message = r"^Mine\.Settings: weight lacks its type, such as weight: float = 1\.0$"
    with pytest.raises(InputError, match=message):

        class Mine:
            class Settings(base):
                weight = 1.0
