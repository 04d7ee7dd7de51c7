"""The paper's claims, answered one by one from what was measured.

Each claim is taken apart into statements that are true or false of one figure. Of an
order (A below B) the statement holds if the whole 95 % interval of the difference lies on
its side; of a size, if the mean lies within it, where "about" leaves a fifth of room.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import pairwise

from iout_marl.paper import explanations
from iout_marl.paper.checks import (
    ABOUT,
    Check,
    Finding,
    about,
    at_each_place,
    higher,
    less,
    lower,
    paired,
    pairs,
    symbol,
    verdict,
    within,
)
from iout_marl.paper.link_figures import (
    beta_star_curves,
    energy_cells,
    harvest_and_requirement,
    normalised_square_error,
)
from iout_marl.paper.names import BASELINES, FDD, GREEDY, RANDOM_WALK, ROUND_ROBIN, TDD, in_fdd
from iout_marl.paper.paper_data import claims
from iout_marl.paper.tables import energy_kwh
from iout_marl.report.document import Answer, Answers
from iout_marl.report.measures import difference, fixed, number, reduction, samples
from iout_marl.report.study_figures import seconds
from iout_marl.study.results import Measured, Results

Findings = list[Finding]
#: The paper's "small number of nodes": those below 7.
SMALL = 7


def _small(results: Results) -> list[float]:
    return [place for place in results.places() if place < SMALL]


def _large(results: Results) -> list[float]:
    return [place for place in results.places() if place >= SMALL]


def _mean_reduction(
    results: Results, first: str, second: str, places: list[float], target: float, what: str
) -> Finding:
    """The reduction of mean AoI, averaged over places, is about the target."""
    measured = pairs(results, "mean_aoi", first, second, places)
    if not measured:
        return Finding(what, ())
    share = sum(reduction(a, b).mean for _, a, b in measured) / len(measured)
    where = ", ".join(f"{place:g}" for place in places)
    text = f"{fixed(100 * share, 1)} % over K = {where}"
    return Finding(what, (Check(text, about(share, target)),))


def _random_walk_highest(results: Results) -> Findings:
    others = (ROUND_ROBIN, GREEDY, TDD, FDD)
    return [lower(results, "mean_aoi", name, RANDOM_WALK) for name in others]


def _round_robin(results: Results) -> Findings:
    large = pairs(results, "mean_aoi", ROUND_ROBIN, RANDOM_WALK, _large(results))
    largest = max((reduction(a, b).mean for _, a, b in large), default=None)
    most = () if largest is None else (Check(f"{fixed(100 * largest, 1)} %", about(largest, 0.25)),)
    return [
        lower(results, "mean_aoi", ROUND_ROBIN, RANDOM_WALK),
        _mean_reduction(
            results, ROUND_ROBIN, RANDOM_WALK, _small(results), 0.16, "about 16 % at small K"
        ),
        Finding("up to about 25 % at K = 7 and 10, the largest", most),
    ]


def _greedy(results: Results) -> Findings:
    small = _small(results)
    return [
        lower(results, "mean_aoi", GREEDY, ROUND_ROBIN, small),
        _mean_reduction(results, GREEDY, ROUND_ROBIN, small, 0.30, "about 30 % at small K"),
    ]


def _tdd_below_greedy(results: Results) -> Findings:
    return [
        lower(results, "mean_aoi", TDD, GREEDY),
        _mean_reduction(results, TDD, GREEDY, results.places(), 0.155, "about 15.5 %, the mean"),
    ]


def _fdd_lowest(results: Results) -> Findings:
    equal_terms = map(in_fdd, BASELINES)
    return [lower(results, "mean_aoi", FDD, name) for name in (*BASELINES, TDD, *equal_terms)]


def _baseline_energy(results: Results) -> Findings:
    same = tuple(
        Check(
            f"{symbol(results, place)}: {number(difference(a, b), 2, 'kJ')}", about(a.mean, b.mean)
        )
        for place, a, b in pairs(results, "harvested_kj", RANDOM_WALK, ROUND_ROBIN)
    )
    return [
        Finding(f"{RANDOM_WALK} within a fifth of {ROUND_ROBIN}", same),
        *(
            within(results, "harvested_kj", name, (0, 7), "at most 7 kJ", 2, "kJ")
            for name in (RANDOM_WALK, ROUND_ROBIN)
        ),
    ]


def _tdd_energy(results: Results) -> Findings:
    return [
        *(higher(results, "harvested_kj", TDD, name, 2, "kJ") for name in BASELINES),
        within(results, "harvested_kj", TDD, (8, 9.2), "from 8 to 9.2 kJ", 2),
    ]


def _fdd_energy(results: Results) -> Findings:
    others = (*BASELINES, TDD, *map(in_fdd, BASELINES))
    seven = [place for place in results.places(FDD) if place == 7]
    near = (11.7 * (1 - ABOUT), 11.7 * (1 + ABOUT))
    means = {
        place: measured.mean
        for place in results.places(FDD)
        if (measured := results.measured(FDD, place, "harvested_kj"))
    }
    highest = []
    if seven and len(means) > 1:
        most = max(means, key=lambda place: means[place])
        text = f"{fixed(means[7], 2)} kJ, and {fixed(means[most], 2)} kJ at {symbol(results, most)}"
        highest.append(Check(text, most == 7))
    return [
        *(higher(results, "harvested_kj", FDD, name, 2, "kJ") for name in others),
        within(results, "harvested_kj", FDD, (10.5, math.inf), "above 10.5 kJ", 2),
        within(results, "harvested_kj", FDD, near, "about 11.7 kJ", 2, places=seven),
        Finding("“up to 11.7 kJ”, the most of all K, at K = 7", tuple(highest)),
    ]


def _fdd_fairness(results: Results) -> Findings:
    return [
        *(higher(results, "jain", FDD, name, 3) for name in (TDD, *BASELINES)),
        *(higher(results, "jain", TDD, name, 3) for name in BASELINES),
    ]


def _baseline_fairness(results: Results) -> Findings:
    findings = []
    for name in BASELINES:
        checks = []
        for few, many in pairwise(results.places(name)):
            a, b = (results.measured(name, place, "jain") for place in (few, many))
            if a is None or b is None:  # as of a bound that is called like a baseline
                continue
            fall = difference(a, b)
            checks.append(Check.positive(f"K = {few:g} → {many:g}: {number(fall, 3)}", fall))
        findings.append(Finding(f"{name} falls by", tuple(checks)))
    return findings


def _worst(
    results: Results,
    metric: str,
    pick: Callable[[list[float]], float],
    holds: Callable[[float], bool],
    digits: int,
) -> Findings:
    """The worst value of a metric over all episodes and seeds satisfies a condition."""
    findings = []
    for name in (TDD, FDD):

        def check(place: float, name: str = name) -> Check | None:
            values = samples(results.records(name, place), metric)
            if not values:
                return None
            worst = pick(values)
            return Check(f"{symbol(results, place)}: {fixed(worst, digits)}", holds(worst))

        findings.append(at_each_place(results, f"{name}, the worst seed", check))
    return findings


def _fair_enough(results: Results) -> Findings:
    return _worst(results, "jain", min, lambda jain: jain >= 0.85, 3)


def _young_enough(results: Results) -> Findings:
    findings = _worst(results, "age_violations", max, lambda count: count == 0, 0)
    return [Finding(f"node-slots above A_max, {f.what}", f.checks) for f in findings]


def _energy_table(_: Results) -> Findings:
    cells = energy_cells()
    agreeing = sum(cell.agrees for cell in cells)
    exact = Check(f"{agreeing} of {len(cells)}", agreeing == len(cells))
    some = (Check("some do", agreeing > 0),) if 0 < agreeing < len(cells) else ()
    return [Finding("cells that agree in every printed digit", (exact, *some))]


def _energy_constant(_: Results) -> Findings:
    checks = [
        Check(f"{error:.1e} for β = {beta}", math.floor(math.log10(error)) <= -5)
        for beta, error in normalised_square_error().items()
    ]
    return [Finding("normalised mean square error, of the order of 1e-5 or less", tuple(checks))]


def _beta_energy(_: Results) -> Findings:
    rises, falls, change = harvest_and_requirement()
    return [
        Finding("harvested energy rises with β, 1 to 600 m", (Check(_yes(rises), rises),)),
        Finding("and falls with distance, 1 to 600 m", (Check(_yes(falls), falls),)),
        Finding(
            "required energy changes over β = 0.1 … 0.9 by at most",
            (Check(f"{100 * change:.2f} %", change < 0.01),),
        ),
    ]


def _beta_star(_: Results) -> Findings:
    curves = beta_star_curves()
    rising = tuple(Check(f"{c.frequency_khz:g} kHz", c.rises) for c in curves)
    nearer = tuple(
        Check(
            f"{b.frequency_khz:g} kHz: {b.distance_m[-1]:.0f} m, after {a.distance_m[-1]:.0f} m",
            bool(b.distance_m[-1] < a.distance_m[-1]),
        )
        for a, b in pairwise(curves)
    )
    return [
        Finding("β* rises strictly with distance", rising),
        Finding("β* reaches 0.9 nearer than at the frequency before", nearer),
    ]


def _yes(true: bool) -> str:  # noqa: FBT001
    return "yes" if true else "no"


def _cost(results: Results) -> Findings:
    """Open where one training of each is all there is: time is measured beside other work."""

    def finding(measure: Callable[[Results, str, float], Measured | None], what: str) -> Finding:
        found = less(results, what, paired(results, partial(measure, results), TDD, FDD))
        checks = (
            replace(check, holds=False, open=True) if results.quick or check.single else check
            for check in found.checks
        )
        return Finding(found.what, tuple(checks))

    energy = "with less energy and so less CO₂ (as codecarbon estimates them), by"
    return [
        finding(seconds, "TDD trains in less time, by"),
        finding(energy_kwh, energy),
    ]


#: How each claim is checked, and what explains it where it does not hold.
CHECKS: dict[str, tuple[Callable[[Results], Findings], explanations.Explanation]] = {
    "aoi-rw": (_random_walk_highest, explanations.none),
    "aoi-rr": (_round_robin, explanations.round_robin),
    "aoi-ga": (_greedy, explanations.greedy),
    "aoi-tdd": (_tdd_below_greedy, explanations.trained_further),
    "aoi-fdd": (_fdd_lowest, explanations.none),
    "energy-baselines": (_baseline_energy, explanations.baseline_energy),
    "energy-tdd": (_tdd_energy, explanations.tdd_energy),
    "energy-fdd": (_fdd_energy, explanations.fdd_energy),
    "jain-fdd": (_fdd_fairness, explanations.fairness_order),
    "jain-baselines": (_baseline_fairness, explanations.baseline_fairness),
    "constraint-jain": (_fair_enough, explanations.unfair_seeds),
    "constraint-age": (_young_enough, explanations.late_seeds),
    "energy-table": (_energy_table, explanations.none),
    "energy-constant": (_energy_constant, explanations.none),
    "beta-energy": (_beta_energy, explanations.none),
    "beta-star": (_beta_star, explanations.none),
    "cost-tdd": (_cost, explanations.cost),
}

#: Claims that are computed from the link's equations, without chance.
COMPUTED = {"energy-table", "energy-constant", "beta-energy", "beta-star"}

CAPTION = (
    "Each claim is taken apart into statements about single figures: ✓ holds, ✗ does not, ? the "
    "interval leaves it open. Of an order, a statement holds if the whole 95 % interval of the "
    "difference lies on its side; of a size, if the mean does, where “about” leaves a fifth of "
    "room. All hold: reproduced; some, or some could not be measured: in part; none, but some are "
    "open: left open; else: not reproduced. The verdicts are computed. Baselines play in the TDD "
    "world, as in the paper, unless (FDD) says otherwise."
)


FEW_RUNS = (
    "Provisionally: from so few runs that more may say otherwise; orders of single values are "
    "taken as they are, but for times, which one training beside other work cannot tell."
)


def answers(results: Results) -> Answers:
    """Every claim of the paper, answered."""
    found = []
    for claim in claims():
        check, explain = CHECKS[claim.key]
        findings = check(results)
        judged = verdict(findings)
        explained = judged not in ("reproduced", "not measured")
        single = any(check.single for finding in findings for check in finding.checks)
        found.append(
            Answer(
                claim=claim.key,
                source=claim.source,
                text=claim.text,
                value=claim.value,
                verdict=judged,
                measured=tuple(map(str, findings)),
                explanation=tuple(explain(results)) if explained else (),
                provisional=claim.key not in COMPUTED
                and judged != "not measured"
                and (results.quick or single),
            )
        )
    made = Answers("claims", CAPTION, results.command, tuple(found))
    return replace(made, caption=f"{CAPTION} {FEW_RUNS}") if made.provisional else made
