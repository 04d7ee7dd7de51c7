"""The search for bounds: its time, worlds in which little or nothing can be had, gaps as text."""

import math

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import bounds
from iout_marl.bounds import (
    bound,
    branch_and_bound,
    branch_and_bound_check,
    gap_percent,
    percent_text,
    verified_age_sum,
)
from iout_marl.bounds.bound import ROUNDING_PERCENT
from iout_marl.bounds.branch_and_bound import first_layer, next_layer, search
from iout_marl.bounds.check_game import finite_game
from iout_marl.bounds.deadline import OutOfTime
from iout_marl.bounds.energy import COARSE, FINE, ROUGH, energy_levels_j
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.scheduling import least_remaining_ages
from iout_marl.errors import InputError


@pytest.mark.slow
@pytest.mark.parametrize("looks", [1, 2, 3, 5, 8, 13, 21, 34, 55, 10_000])
def test_a_search_that_is_cut_off_anywhere_has_a_bound_all_the_same(looks, monkeypatch):
    """As if the deadline came at the so manieth look at the clock."""
    scenario = small_world(np.random.default_rng(13), "fdd", "six", 3, 4)
    left = iter(range(looks))

    def check_time(deadline):
        if next(left, None) is None:
            raise OutOfTime

    monkeypatch.setattr(branch_and_bound, "check_time", check_time)
    found = search(
        FiniteGame.from_scenario(scenario), bounds.least_age_sum(scenario), 600, math.inf
    )
    assert bounds.least_age_sum(scenario) <= found <= least_age_sum(scenario)
    assert looks < 10_000 or found == least_age_sum(scenario)


@pytest.mark.parametrize("idle_choices", [False, True])
def test_to_spare_a_rich_node_is_a_way_only_where_nobody_is_a_choice(idle_choices):
    """In TDD a node that is named delivers, or else comes to no more than a poor one would."""
    rng = np.random.default_rng(3)
    scenario = small_world(rng, "tdd", "hover", 1, 6, "stored", idle_choices=idle_choices)
    field = FiniteGame.from_scenario(scenario)
    rich = field.num_levels - 2
    layer = first_layer(field)._replace(levels=np.full((1, 1), rich))
    after = next_layer(field, layer, 0, target=10**6)
    is_spared = (after.levels[:, 0] == rich) & (after.ages[:, 0] > 1)
    assert is_spared.any() == idle_choices
    game = finite_game(scenario, tuple(field.levels_j[:-1].tolist()))
    outcomes = branch_and_bound_check._outcomes(game, idle_choices=idle_choices)
    comes_to = {rich} if [] in outcomes[None] else set()
    for ((_, table),) in filter(None, outcomes[None]):
        comes_to |= set(table[:, rich].tolist())
    assert (rich in comes_to) == idle_choices


def test_no_time_is_no_search():
    scenario = small_world(np.random.default_rng(13), "tdd", "six", 2, 4)
    assert bound(scenario, seconds=0).energy_and_travel == bound(scenario, seconds=0).scheduling
    field = FiniteGame.from_scenario(scenario)
    with pytest.raises(OutOfTime):
        next_layer(field, first_layer(field), 0, 600, deadline=-math.inf)


@pytest.mark.parametrize("seconds", [math.nan, -1, -math.inf])
def test_time_is_a_number_from_0(seconds):
    with pytest.raises(InputError, match="seconds must be 0 or more, not"):
        bound("paper/k3-fdd", seconds=seconds)


@pytest.mark.parametrize("best_known", [math.nan, 0.0, -2.0, math.inf])
def test_what_is_best_known_is_a_mean_age(best_known):
    with pytest.raises(InputError, match="best_known must be a mean AoI above 0, not"):
        bound("paper/k3-fdd", best_known, seconds=0)


def test_a_claim_that_the_check_does_not_confirm_is_not_made(monkeypatch):
    scenario = small_world(np.random.default_rng(13), "tdd", "six", 2, 4)
    # `iout_marl.bounds.bound` is the function, which hides the module of that name.
    monkeypatch.setitem(bound.__globals__, "search", lambda *_: 10**4)
    found = bound(scenario, seconds=0)
    assert found.energy_and_travel == found.scheduling
    assert verified_age_sum(scenario, found.certificate) == bounds.least_age_sum(scenario)


@pytest.mark.parametrize("ladder", [COARSE, FINE, ROUGH])
@pytest.mark.parametrize("harvest_j", [0.0, 5e-324, 1e-320, 1e-12, 1.0, 1e290])
def test_ladders_rise_however_little_is_harvested(ladder, harvest_j):
    levels_j = energy_levels_j(ladder, harvest_j)
    assert levels_j[0] == 0
    assert (np.diff(levels_j) > 0).all()


@pytest.mark.slow
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("efficiency", [1e-15, 1e-12, 1.0])
def test_search_and_check_agree_however_little_is_harvested(duplex, efficiency):
    """Where next to nothing can be harvested, all ways to begin are next to alike."""
    scenario = small_world(np.random.default_rng(2), duplex, "hover", 2, 5)
    changed = scenario.harvester.model_copy(update={"efficiency": efficiency})
    scenario = scenario.model_copy(update={"harvester": changed})
    field = FiniteGame.from_scenario(scenario)
    highest = scenario.num_nodes * scenario.num_slots * scenario.age.maximum
    claim = search(field, bounds.least_age_sum(scenario), highest, math.inf)
    assert claim <= least_age_sum(scenario)
    assert efficiency == 1 or claim > bounds.least_age_sum(scenario)
    levels_j = tuple(field.levels_j[:-1].tolist())
    certificate = bounds.Certificate(scenario.world_hash, claim, levels_j)
    assert verified_age_sum(scenario, certificate) == claim


@pytest.mark.parametrize("resets", [1, 2, 3])
def test_long_episodes_take_no_longer_to_schedule(resets):
    ages = np.random.default_rng(0).integers(1, 9, (4, 5))
    for maximum in (3, 50):
        one, two = (least_remaining_ages(ages, n, maximum, resets) for n in (10**9, 10**9 + 7))
        per_slot = least_remaining_ages(ages, 21, maximum, resets) - least_remaining_ages(
            ages, 20, maximum, resets
        )
        np.testing.assert_array_equal(two - one, 7 * per_slot)


@pytest.mark.parametrize(
    ("gap", "text"),
    [
        (0.0, "0.0 %"),
        (-0.0, "0.0 %"),
        (0.04, "0.0 %"),
        (12.34, "12.3 %"),
        (-0.0001, "-0.1 %"),
        (-0.26, "-0.3 %"),
    ],
)
def test_gaps_as_text_hide_no_policy_below_a_bound(gap, text):
    assert percent_text(gap) == text


def test_rounding_is_no_gap_and_whatever_is_more_is_one():
    assert str(gap_percent(2.05 * (1 - 1e-15), 2.05)) == "0.0"
    for mean_aoi in (2.05 * (1 - 1e-9), 2.05 * (1 + 1e-9)):
        assert gap_percent(mean_aoi, 2.05) == pytest.approx(100 * (mean_aoi / 2.05 - 1))
        assert abs(gap_percent(mean_aoi, 2.05)) > ROUNDING_PERCENT
