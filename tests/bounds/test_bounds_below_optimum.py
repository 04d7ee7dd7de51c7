"""No bound exceeds the optimum of small worlds, found by playing every action."""

import json

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import evaluate
from iout_marl.bounds import Certificate, ascent, bound, lagrangian, verified_age_sum
from iout_marl.bounds.ascent import climb
from iout_marl.bounds.check_game import finite_game
from iout_marl.bounds.energy import COARSE, FINE
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.lagrangian import Programme, oldest_age
from iout_marl.bounds.lagrangian_check import proven_age_sum
from iout_marl.bounds.prices import Prices
from iout_marl.errors import InputError
from iout_marl.policies import Budget, PlannerPolicy

pytestmark = pytest.mark.slow

CASES = [
    # duplex, rule for β, motion, nodes, slots
    ("fdd", "paper", "six", 2, 5),
    ("fdd", "paper", "hover", 2, 4),
    ("fdd", "paper", "six", 3, 4),
    ("tdd", "paper", "six", 2, 6),
    ("tdd", "paper", "hover", 3, 5),
    ("tdd", "stored", "six", 2, 6),
    ("tdd", "stored", "hover", 3, 5),
    # in oblong cells, of which an AUV is at the mean distance within its own
    ("fdd", "paper", "hover", 2, 4, True),
    ("tdd", "stored", "six", 2, 5, True),
    ("fdd", "modem", "six", 2, 5),
    ("tdd", "airtime", "six", 2, 6),
    # where the AUV may name nobody: a node alone, that it would have to name, and two
    ("fdd", "paper", "hover", 2, 4, False, True),
    ("tdd", "paper", "hover", 1, 7, False, True),
    ("tdd", "stored", "six", 1, 8, False, True),
    ("tdd", "stored", "hover", 2, 6, False, True),
]
SEEDS = range(3)


def world(case, seed):
    duplex, rule, motion, nodes, slots, is_oblong, idle_choices = (*case, False, False)[:7]
    rng = np.random.default_rng([seed, nodes, slots, duplex == "tdd", rule == "stored"])
    return small_world(
        rng, duplex, motion, nodes, slots, rule, is_oblong=is_oblong, idle_choices=idle_choices
    )


@pytest.fixture(scope="module")
def optimum():
    """The optimum of a case and seed, looked for once."""
    known = {}

    def find(case, seed):
        if (case, seed) not in known:
            known[case, seed] = least_age_sum(world(case, seed))
        return known[case, seed]

    return find


@pytest.fixture(scope="module")
def bounded():
    """The bound of a case and seed, and the planner's mean AoI, looked for once."""
    known = {}

    def find(case, seed):
        if (case, seed) not in known:
            scenario = world(case, seed)
            planner = PlannerPolicy(Budget(rounds=1))
            plan = evaluate(scenario, planner, episodes=1).metrics["mean_aoi"].mean
            known[case, seed] = bound(scenario, seconds=1), plan
        return known[case, seed]

    return find


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("case", CASES)
def test_bounds_stay_below_it_and_so_does_no_planner(case, seed, optimum, bounded):
    scenario, least = world(case, seed), optimum(case, seed)
    node_slots = scenario.num_nodes * scenario.num_slots
    found, planned = bounded(case, seed)
    assert found.scheduling <= found.energy_and_travel
    assert found.energy_and_travel * node_slots <= least + 1e-9
    assert planned * node_slots >= least - 1e-6


def test_the_opening_bound_is_the_optimum_where_energies_hardly_need_rounding(optimum, bounded):
    """Often, so that the tests above could fail; energy and travel bind; planners get there."""
    cases = [(case, seed) for case in CASES for seed in SEEDS]
    exact, binding, planned = 0, 0, 0
    for case, seed in cases:
        scenario = world(case, seed)
        found, plan = bounded(case, seed)
        node_slots = scenario.num_nodes * scenario.num_slots
        exact += round(found.energy_and_travel * node_slots) == optimum(case, seed)
        binding += found.energy_and_travel > found.scheduling
        planned += round(plan * node_slots) == optimum(case, seed)
    assert exact > 0.9 * len(cases)
    assert planned > 0.7 * len(cases)
    assert binding > 0.5 * len(cases)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("case", CASES)
def test_no_check_lets_a_claim_above_the_optimum_pass(case, seed, optimum):
    scenario = world(case, seed)
    levels_j = tuple(FiniteGame.from_scenario(scenario, COARSE).levels_j[:-1].tolist())
    too_much = optimum(case, seed) + 1
    for certificate in (
        Certificate(scenario.world_hash, too_much),
        Certificate(scenario.world_hash, too_much, levels_j),
    ):
        with pytest.raises(ValueError, match=r"prove|may end below"):
            verified_age_sum(scenario, certificate)


@pytest.mark.parametrize("seed", SEEDS[:2])
@pytest.mark.parametrize("case", [case for case in CASES if case[0] == "tdd"])
def test_the_sharing_bound_stays_below_it_at_any_prices(case, seed, optimum, monkeypatch):
    scenario, least = world(case, seed), optimum(case, seed)
    field = FiniteGame.from_scenario(scenario, FINE)
    levels_j = tuple(field.levels_j[:-1].tolist())
    game = finite_game(scenario, levels_j)
    assert climb(field, 0) is None
    # Where answers seem to take long, a rougher game shows the way.
    for few_answers in (np.inf, ascent.FEW_ANSWERS):
        monkeypatch.setattr(ascent, "FEW_ANSWERS", few_answers)
        value, prices, its_field, oldest = climb(field, np.inf)
        assert value <= least + 0.01
        its_game = finite_game(scenario, tuple(its_field.levels_j[:-1].tolist()))
        proven = proven_age_sum(scenario, prices, oldest, its_game)
        assert float(proven) == pytest.approx(value, abs=0.01)
    assert its_field is field
    rng = np.random.default_rng(seed)
    for size in (0.1, 1, 10):
        presence = rng.normal(size=prices.presence.shape) * size
        any_prices = Prices(
            prices.slots,
            rng.random(len(prices.slots)) * size,
            presence - presence.mean(axis=0),
            prices.reach_m,
        )
        for oldest in (2, 3, 50):
            assert proven_age_sum(scenario, any_prices, oldest, game) <= least
    rounded_down = int(np.floor(value - 0.01))
    good = Certificate(scenario.world_hash, rounded_down, levels_j, prices, oldest_age(field))
    read = Certificate.from_json(json.loads(json.dumps(good.to_json())))
    assert verified_age_sum(scenario, read) == rounded_down
    claim = Certificate(scenario.world_hash, least + 1, levels_j, prices, oldest_age(field))
    with pytest.raises(ValueError, match="prove"):
        verified_age_sum(scenario, claim)


def test_blocks_of_cells_change_nothing(monkeypatch):
    field = FiniteGame.from_scenario(world(CASES[3], 1), FINE)
    rng = np.random.default_rng(0)
    slots = field.scenario.num_slots
    naming, presence = rng.random(slots), rng.normal(size=(slots, len(field.next_cells)))
    whole = Programme(field, oldest=6).wish(0, naming, presence)
    monkeypatch.setattr(lagrangian, "BLOCK_ENTRIES", 5 * field.num_levels * 7)
    parts = Programme(field, oldest=6).wish(0, naming, presence)
    assert whole.value == parts.value
    np.testing.assert_array_equal(whole.path, parts.path)
    np.testing.assert_array_equal(whole.named, parts.named)


@pytest.mark.parametrize("access", ["orthogonal", "interference", "exclusive"])
@pytest.mark.parametrize(("duplex", "slots"), [("fdd", 2), ("tdd", 3)])
def test_two_auvs_stay_above_the_scheduling_bound(duplex, slots, access):
    rng = np.random.default_rng(slots)
    scenario = small_world(rng, duplex, slots=slots, auvs=2, access=access)
    found = bound(scenario)
    assert found.energy_and_travel is None
    assert found.best * scenario.num_nodes * slots <= least_age_sum(scenario) + 1e-9


def test_a_certificate_of_another_world_or_none_at_all_is_refused():
    first, second = world(CASES[0], 0), world(CASES[0], 1)
    certificate = bound(first, seconds=0).certificate
    with pytest.raises(InputError, match="is of world"):
        verified_age_sum(second, certificate)
    with pytest.raises(InputError, match="levels_j: is missing"):
        Certificate.from_json(
            {"kind": "branch-and-bound", "world_hash": first.world_hash, "age_sum": 1}
        )
