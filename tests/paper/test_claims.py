"""The verdicts on the paper's claims follow from the figures, and from nothing else."""

import math

import numpy as np
import pytest
from fake_results import paper_like
from scipy import stats

from iout_marl.evaluation import Estimate
from iout_marl.paper import link_figures
from iout_marl.paper.checks import Check, Finding, verdict
from iout_marl.paper.claims import CHECKS, COMPUTED, answers
from iout_marl.paper.paper_data import claims
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.report.measures import (
    difference,
    duration,
    fixed,
    number,
    percent,
    reduction,
)
from iout_marl.report.page import render_page
from iout_marl.study.results import Measured

pytestmark = pytest.mark.slow


def answer(results, claim):
    return next(a for a in answers(results).answers if a.claim == claim)


def finding(*holds):
    return Finding("", tuple(Check("", h) for h in holds))


@pytest.mark.parametrize(
    ("findings", "expected"),
    [
        ([finding(True, True), finding(True)], "reproduced"),
        ([finding(True, False)], "reproduced in part"),
        ([finding(False), finding(True)], "reproduced in part"),
        ([finding(False), finding(False)], "not reproduced"),
        ([finding(True), finding()], "reproduced in part"),
        ([finding(False), finding()], "not reproduced"),
        ([finding(), finding()], "not measured"),
        ([Finding("", (Check("", holds=False, open=True),)), finding(False)], "left open"),
        ([Finding("", (Check("", holds=False, open=True),)), finding(True)], "reproduced in part"),
        ([], "not measured"),
    ],
)
def test_verdict_counts_the_statements_that_hold(findings, expected):
    assert verdict(findings) == expected


def test_difference_has_welchs_interval():
    first, second = [3.0, 4.0, 5.5], [1.0, 1.2, 0.7, 1.1, 0.9]
    test = stats.ttest_ind(first, second, equal_var=False)
    low, high = test.confidence_interval()
    found = difference(Measured(tuple(first), "seeds"), Measured(tuple(second), "episodes"))
    assert (found.mean, found.low, found.high) == pytest.approx(
        (np.mean(first) - np.mean(second), low, high)
    )


def test_interval_of_a_reduction_covers_the_true_one_as_often_as_it_says():
    rng = np.random.default_rng(0)
    covered = 0
    for _ in range(2000):
        a = Measured(tuple(rng.normal(6, 0.5, 5)), "seeds")
        b = Measured(tuple(rng.normal(10, 1, 100)), "episodes")
        estimate = reduction(a, b)
        covered += estimate.low <= 0.4 <= estimate.high
    assert 0.93 <= covered / 2000 <= 0.975


def test_single_values_have_a_reduction_without_an_interval():
    estimate = reduction(Measured((6.0,), "seeds"), Measured((10.0,), "seeds"))
    assert estimate.mean == pytest.approx(0.4)
    assert math.isnan(estimate.low)
    assert number(estimate, 2) == "0.40"


@pytest.mark.parametrize(
    ("value", "text"),
    [(-0.0, "0.0"), (-0.04, "0.0"), (-0.06, "-0.1"), (2e13, "2.000e+13"), (math.inf, "–")],
)
def test_numbers_are_written_without_a_sign_of_nothing(value, text):
    assert fixed(value, 1) == text


def test_an_interval_is_told_only_where_there_is_one():
    assert number(Estimate(3.0, 3.0, 3.0), 1) == "3.0"
    assert number(Estimate(3.0, math.nan, math.nan), 1, "kJ") == "3.0\N{NO-BREAK SPACE}kJ"
    assert number(Estimate(3.0, 2.96, math.inf), 1) == "3.0"
    assert number(Estimate(3.0, 2.9, 3.1), 1) == "3.0 (2.9 to 3.1)"
    assert percent(Estimate(-0.0004, -0.01, 0.01)).startswith("0.0\N{NO-BREAK SPACE}%")


@pytest.mark.parametrize("samples", [(0.0,), (0.0, 0.0), (0.0, 5e-324), (1e308, 1e308, -1e308)])
def test_ratios_of_nothing_and_of_everything_are_none_or_numbers(samples):
    whole = Measured((4.0, 5.0), "seeds")
    for a, b in ((whole, Measured(samples, "seeds")), (Measured(samples, "seeds"), whole)):
        for found in (reduction(a, b), difference(a, b)):
            assert isinstance(number(found, 2), str)
    assert math.isnan(reduction(whole, Measured((0.0, 0.0), "seeds")).mean)


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.2, "0 s"), (24, "24 s"), (60, "1 min"), (125, "2 min 5 s"), (29460, "8 h 11 min")],
)
def test_durations_read_as_people_say_them(seconds, text):
    assert duration(seconds) == text


def test_every_claim_of_the_paper_is_answered():
    assert [claim.key for claim in claims()] == list(CHECKS)
    assert [a.claim for a in answers(paper_like()).answers] == list(CHECKS)
    assert len(CHECKS) == 17


def test_figures_like_the_papers_reproduce_it():
    found = {a.claim: a.verdict for a in answers(paper_like()).answers}
    not_reproduced = {claim for claim, v in found.items() if v != "reproduced"}
    # The made-up reductions of round robin are 18 % throughout: not up to 25 %.
    assert not_reproduced == {"aoi-rr"}
    assert found["aoi-rr"] == "reproduced in part"


def test_what_holds_needs_no_explanation_and_what_does_not_has_one():
    for a in answers(paper_like()).answers:
        assert bool(a.explanation) == (a.verdict != "reproduced")
        assert a.measured


def only(series, **changes):
    """A change of the metrics of one series alone: factors."""

    def change(name, place, seed, metrics):
        if name != series:
            return metrics
        return {k: [v * changes.get(k, 1) for v in values] for k, values in metrics.items()}

    return change


@pytest.mark.parametrize(
    ("claim", "series", "changes", "expected"),
    [
        ("aoi-rw", "random-walk", {"mean_aoi": 0.1}, "not reproduced"),
        ("aoi-rw", "random-walk", {"mean_aoi": 0.7}, "reproduced in part"),
        ("aoi-rr", "round-robin", {"mean_aoi": 2}, "not reproduced"),
        ("aoi-ga", "greedy", {"mean_aoi": 2}, "not reproduced"),
        ("aoi-ga", "greedy", {"mean_aoi": 0.5}, "reproduced in part"),
        ("aoi-tdd", "PPO-TDD", {"mean_aoi": 3}, "not reproduced"),
        ("aoi-tdd", "PPO-TDD", {"mean_aoi": 0.5}, "reproduced in part"),
        ("aoi-fdd", "PPO-FDD", {"mean_aoi": 9}, "not reproduced"),
        ("energy-baselines", "random-walk", {"harvested_kj": 1.3}, "reproduced in part"),
        ("energy-tdd", "PPO-TDD", {"harvested_kj": 1.2}, "reproduced in part"),
        ("energy-tdd", "PPO-TDD", {"harvested_kj": 0.5}, "not reproduced"),
        ("energy-fdd", "PPO-FDD", {"harvested_kj": 0.8}, "reproduced in part"),
        ("jain-fdd", "PPO-FDD", {"jain": 0.9}, "reproduced in part"),
        ("constraint-jain", "PPO-TDD", {"jain": 0.9}, "reproduced in part"),
    ],
)
def test_a_verdict_falls_with_the_figures_it_rests_on(claim, series, changes, expected):
    assert answer(paper_like(), claim).verdict in ("reproduced", "reproduced in part")
    assert answer(paper_like(only(series, **changes)), claim).verdict == expected


def test_seeds_that_disagree_leave_an_order_open():
    def change(name, place, seed, metrics):
        if name == "PPO-TDD" and place == 3:
            return {**metrics, "mean_aoi": [(4.0, 10.0, 16.0)[seed]]}
        return metrics

    found = answer(paper_like(change), "aoi-tdd")
    assert found.verdict == "reproduced in part"
    line = next(line for line in found.measured if line.startswith("PPO-TDD below greedy"))
    assert line.split(";")[0].endswith(" ?")
    assert line.count("✓") == 3


def test_one_seed_of_one_episode_is_judged_by_its_value():
    def change(name, place, seed, metrics):
        one = {k: v[:1] for k, v in metrics.items()}
        return one if seed == 0 else None

    found = answer(paper_like(change), "aoi-fdd")
    assert found.verdict == "reproduced"
    assert all("to" not in line.partition(": ")[2] for line in found.measured)


def one_seed(name, place, seed, metrics):
    return {k: v[:1] for k, v in metrics.items()} if seed == 0 else None


@pytest.fixture(scope="module")
def quick():
    return paper_like(one_seed).model_copy(update={"quick": True})


def test_verdicts_of_the_short_form_are_provisional_but_for_what_is_computed(quick):
    found = answers(quick).answers
    assert {a.claim for a in found if not a.provisional} == COMPUTED
    assert all(a.judged == f"{a.verdict}, provisionally" for a in found if a.provisional)
    assert not any(a.provisional for a in answers(paper_like()).answers)


def test_one_training_cannot_tell_what_training_costs(quick):
    for made in (quick, paper_like(one_seed), paper_like().model_copy(update={"quick": True})):
        found = answer(made, "cost-tdd")
        assert found.verdict == "left open"
        assert found.explanation
        assert "✓" not in "".join(found.measured)


def test_page_markdown_and_lead_say_that_verdicts_are_provisional(quick):
    report = build_report(quick)
    assert "claims, provisionally: " in report.lead[1]
    assert "provisional" in " ".join(report.lead[2:-2])
    assert report.lead[-1].startswith("FDD: provisionally (one seed), ")
    text = render_markdown(report, "figures")
    assert "| **reproduced, provisionally** |" in text
    assert "### cost-tdd: left open, provisionally" in text
    page = render_page(report, {figure.key: b"" for figure in report.figures()})
    assert "</span> reproduced, provisionally</span>" in page
    whole = render_markdown(build_report(paper_like()), "figures")
    assert "provisional" not in whole


def test_a_series_that_was_not_run_is_not_counted_as_reproduced():
    found = answer(paper_like(without=("PPO-TDD",)), "aoi-rw")
    assert found.verdict == "reproduced in part"
    assert "PPO-TDD below random-walk by: not measured" in found.measured
    everything = paper_like(without=("PPO-TDD", "PPO-FDD"))
    assert answer(everything, "constraint-jain").verdict == "not measured"


def test_round_robin_is_explained_by_random_walks_final_age():
    found = answer(paper_like(), "aoi-rr")
    # 16.4 against 20 · 1.1, everywhere.
    share = f"{100 * (1 - 16.4 / 22):.0f} %".replace(" ", "\N{NO-BREAK SPACE}")
    assert found.explanation[0].count(share) == 4
    assert "final AoI" in found.explanation[0]


def test_reductions_other_than_claimed_are_explained_by_the_training():
    found = answer(paper_like(only("PPO-TDD", mean_aoi=0.5)), "aoi-tdd").explanation
    # The made-up curves go 20, 10, final age; greedy has 11.7 to 19.9.
    assert "first 15.5 % below greedy" in found[0]
    assert found[0].count("2.00 M steps") + found[0].count("3.00 M steps") == 4
    assert "at its end" in found[1]
    assert len(found) == 2


def test_ages_that_grow_again_in_training_are_told_with_the_fairness():
    def change(name, place, seed, metrics):
        return {**metrics, "mean_aoi": [12.0], "jain": [0.97]} if name == "PPO-TDD" else metrics

    found = answer(paper_like(change), "aoi-tdd").explanation
    assert "AoI from 10.00 to 12.00 as fairness goes from 0.800 to 0.970" in found[-1]


def test_the_node_that_a_policy_leaves_out_is_named():
    def change(name, place, seed, metrics):
        if name == "PPO-TDD" and place == 5 and seed == 1:
            return {**metrics, "age_violations": [51.0]}
        return metrics

    found = answer(paper_like(change), "constraint-age")
    assert found.verdict == "reproduced in part"
    # The made-up episode hears nodes 1, 2, 1: node 3 is the first that is left out.
    assert any("seed 1: node 3 at (3, 1, 1) delivers 0 of 3" in e for e in found.explanation)


def test_cost_compares_time_energy_and_carbon():
    found = answer(paper_like(), "cost-tdd")
    assert found.verdict == "reproduced"
    assert len(found.measured) == 2


def test_a_wrong_digit_in_the_table_of_energies_is_found(monkeypatch):
    rows = link_figures.printed_energies()
    rows[2].true_j[0.5] = "132.6748"
    monkeypatch.setattr(link_figures, "printed_energies", lambda: rows)
    found = answer(paper_like(), "energy-table")
    assert found.verdict == "reproduced in part"
    assert "23 of 24" in found.measured[0]
    table = link_figures.energy_table("iout reproduce")
    assert table.marked == {(5, 3)}
    assert table.rows[5][3] == "132.6747"


def test_verdicts_on_the_link_rest_on_the_physics(monkeypatch):
    def slower(self, distance_m, beta):
        return (1 - beta) * np.ones_like(np.asarray(distance_m))

    monkeypatch.setattr(link_figures.TddLink, "harvested_j", slower)
    assert answer(paper_like(), "beta-energy").verdict == "reproduced in part"
    monkeypatch.setattr(link_figures.TddLink, "approximate_j", lambda self, d: np.asarray(d) * 0)
    assert answer(paper_like(), "energy-constant").verdict == "not reproduced"
