"""Why a claim did not hold: measurements, not words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from iout_marl.paper.checks import pairs, symbol
from iout_marl.paper.names import (
    BASELINES,
    BEST_TDD,
    FDD,
    GREEDY,
    LONGER_TDD,
    RANDOM_WALK,
    ROUND_ROBIN,
    TDD,
    in_fdd,
)
from iout_marl.paper.paper_data import mean_distance_from_start
from iout_marl.report.intake import curves
from iout_marl.report.measures import (
    MOST_DIGITS,
    difference,
    fixed,
    metric,
    number,
    percent,
    ratio,
    reduction,
    samples,
)
from iout_marl.report.study_figures import episode_of, seconds
from iout_marl.study.results import Results
from iout_marl.words import counted

Explanation: TypeAlias = Callable[[Results], list[str]]


def none(_: Results) -> list[str]:
    """Nothing was measured beyond the claim itself."""
    return ["No further measurement was made: the figures above are the answer."]


def _each_place(
    results: Results, text: Callable[[float], str | None], series: str | None = None
) -> str:
    """`K = 3: …; K = 5: …`, of a series or all, where there is anything to say."""
    found = ((place, text(place)) for place in results.places(series))
    return "; ".join(f"{symbol(results, place)}: {said}" for place, said in found if said)


def _scored(results: Results, first: str, second: str, scores: tuple[str, str]) -> str:
    """`K = 3: 16 % (10 to 22); …`: the reduction if each series is scored in its own way."""

    def share(place: float) -> str | None:
        a = results.measured(first, place, scores[0])
        b = results.measured(second, place, scores[1])
        return None if a is None or b is None else percent(reduction(a, b))

    return _each_place(results, share)


def _other_scores(
    results: Results, first: str, second: str, choices: Sequence[tuple[str, str, str]]
) -> list[str]:
    lines = []
    for what, *scores in choices:
        text = _scored(results, first, second, (scores[0], scores[1]))
        if text:
            lines.append(f"{what}: {text}.")
    return lines


def round_robin(results: Results) -> list[str]:
    """Random walk by its final AoI, as one of the authors' scripts scores it."""
    unequal = (
        "With random walk scored by its final AoI, as in one of the authors' scripts, and round "
        "robin by its time average, round robin is below it by"
    )
    equal = "With both scored by the final AoI, by"
    return _other_scores(
        results,
        ROUND_ROBIN,
        RANDOM_WALK,
        [(unequal, "mean_aoi", "final_aoi"), (equal, "final_aoi", "final_aoi")],
    )


def greedy(results: Results) -> list[str]:
    """The same reduction in the FDD world and by other scores."""
    lines = _other_scores(
        results,
        GREEDY,
        ROUND_ROBIN,
        [
            ("Scored by the final AoI, greedy is below round robin by", "final_aoi", "final_aoi"),
            ("Scored by the peak AoI, by", "peak_aoi", "peak_aoi"),
        ],
    )
    text = _scored(results, in_fdd(GREEDY), in_fdd(ROUND_ROBIN), ("mean_aoi", "mean_aoi"))
    return [*lines, *([f"In the FDD world, by: {text}."] if text else [])]


def trained_further(results: Results) -> list[str]:
    """When in the training the claimed reduction is reached, and where the training ends."""
    reached, lowest, last = [], [], []
    for place in results.places():
        baseline = results.measured(GREEDY, place, "mean_aoi")
        curve = _mean_curve(results, TDD, place, "aoi/mean")
        if baseline is None or curve is None:
            continue
        step = _first_step(results, TDD, place, "aoi/mean", below=0.845 * baseline.mean)
        where = symbol(results, place)
        reached.append(f"{where}: {step}")
        lowest.append(f"{where}: {_share(min(curve[1]), baseline.mean)} %")
        last.append(f"{where}: {_share(curve[1][-1], baseline.mean)} %")
    return [
        f"In training (actions still sampled), first 15.5 % below greedy: {'; '.join(reached)}.",
        f"Furthest below greedy in training: {'; '.join(lowest)}; at its end: {'; '.join(last)}.",
        *_age_against_fairness(results),
    ]


def _share(value: float, of: float) -> str:
    return fixed(100 * (1 - ratio(value, of)), 0)


def _age_against_fairness(results: Results) -> list[str]:
    """Where a training lets ages grow again, its fairness at the lowest age and at the end."""
    parts = []
    for place in results.places(TDD):
        ages = _mean_curve(results, TDD, place, "aoi/mean")
        fairness = _mean_curve(results, TDD, place, "fairness/jain")
        if ages is None or fairness is None:
            continue
        best = int(np.argmin(ages[1]))
        if best >= len(fairness[1]):
            continue
        if ages[1][-1] > 1.02 * ages[1][best]:
            parts.append(
                f"{symbol(results, place)}: AoI from {fixed(ages[1][best], 2)} to "
                f"{fixed(ages[1][-1], 2)} as fairness goes from {fixed(fairness[1][best], 3)} to "
                f"{fixed(fairness[1][-1], 3)}"
            )
    if not parts:
        return []
    return [f"Ages grow again late in training: {'; '.join(parts)}."]


def _mean_curve(
    results: Results, series: str, place: float, curve: str
) -> tuple[list[float], list[float]] | None:
    """Environment steps, and the mean over seeds of a curve; None where nothing was trained."""
    steps, values = curves(results.records(series, place), curve)
    return (steps, values.mean(axis=0).tolist()) if steps else None


def _first_step(
    results: Results,
    series: str,
    place: float,
    curve: str,
    *,
    below: float = math.inf,
    above: float = -math.inf,
) -> str:
    """Environment steps after which the seeds' mean curve first lies between the bounds."""
    found = _mean_curve(results, series, place, curve)
    if found is None:
        return "not trained"
    for step, value in zip(*found, strict=True):
        if above <= value <= below:
            return f"{fixed(step / 1e6, 2)} M steps"
    return f"not within {fixed(found[0][-1] / 1e6, 1)} M steps"


def _by_place(results: Results, series: str, name: str) -> str:
    return _each_place(
        results, lambda place: metric(results.measured(series, place, name), name), series
    )


def baseline_energy(results: Results) -> list[str]:
    """The same baselines in both worlds."""
    return [
        f"{name}, in the {mode} world, kJ: {_by_place(results, series, 'harvested_kj')}."
        for name in (RANDOM_WALK, ROUND_ROBIN)
        for mode, series in (("TDD", name), ("FDD", in_fdd(name)))
        if results.records(series)
    ]


def tdd_energy(results: Results) -> list[str]:
    """How energy grows with training, and what another reward harvests in the same world."""
    curve = "energy/harvested_kj"

    def last(place: float) -> str | None:
        found = _mean_curve(results, TDD, place, curve)
        return found and fixed(found[1][-1], 2)

    ends = _each_place(results, last, TDD)
    crossing = _each_place(
        results, lambda place: _first_step(results, TDD, place, curve, above=8), TDD
    )
    lines = [
        f"By seed, kJ: {_seeds(results, TDD, 'harvested_kj', 2)}.",
        f"In training, 8 kJ are first passed after {crossing}; it ends with, kJ: {ends}.",
    ]
    if results.records(BEST_TDD):
        lines.append(
            "Energy is a by-product that no term of the reward asks for: trained on mean AoI "
            f"alone (better β rule), kJ: {_by_place(results, BEST_TDD, 'harvested_kj')}."
        )
    return lines


def fdd_energy(results: Results) -> list[str]:
    """By seed, and the baselines in the FDD world."""
    return [
        f"By seed, kJ: {_seeds(results, FDD, 'harvested_kj', 2)}.",
        *(
            f"{in_fdd(name)}, kJ: {_by_place(results, in_fdd(name), 'harvested_kj')}."
            for name in BASELINES
            if results.records(in_fdd(name))
        ),
    ]


def _seeds(results: Results, series: str, name: str, digits: int) -> str:
    def values(place: float) -> str:
        records = [r for r in results.records(series, place) if name in r.samples]
        return ", ".join(fixed(record.mean(name), digits) for record in records)

    return _each_place(results, values, series)


def fairness_order(results: Results) -> list[str]:
    """What the index leaves out: how many packets arrive at all."""
    gaps = [
        f"{symbol(results, place)}: {number(difference(a, b), 3)}"
        for place, a, b in pairs(results, "jain", FDD, TDD)
    ]
    near = f"PPO-FDD's index minus PPO-TDD's: {'; '.join(gaps)}."
    packets = (
        "The index counts shares, not packets. Share of slots that deliver, PPO-TDD: "
        f"{_by_place(results, TDD, 'uplink_success')}; PPO-FDD: "
        f"{_by_place(results, FDD, 'uplink_success')}."
    )
    return [near, packets]


def baseline_fairness(results: Results) -> list[str]:
    """From the first K to the last, and how far away the nodes of each K are."""
    lines = []
    for name in BASELINES:
        places = results.places(name)
        if len(places) > 1:
            a = results.measured(name, places[0], "jain")
            b = results.measured(name, places[-1], "jain")
            if a is not None and b is not None:
                lines.append(
                    f"{name}, from K = {places[0]:g} to {places[-1]:g}, falls by "
                    f"{number(difference(a, b), 3)}."
                )
    distances = _each_place(results, mean_distance_from_start, RANDOM_WALK)
    if distances:
        lines.append(
            "Each K is a layout of its own, not only more nodes: their mean distance from the "
            f"AUV's start is {distances}."
        )
    return lines


def unfair_seeds(results: Results) -> list[str]:
    """Every seed, and the same trained for longer."""
    return [*_by_seed(results, "jain", 3), *_fewest_deliveries(results)]


def late_seeds(results: Results) -> list[str]:
    """The same, and the same world under another reward."""
    lines = [*_by_seed(results, "age_violations", 0), *_fewest_deliveries(results)]
    if results.records(BEST_TDD):
        lines.append(
            "Trained on mean AoI alone (better β rule), TDD, by seed: "
            f"{_seeds(results, BEST_TDD, 'age_violations', 0)}."
        )
    return lines


def _by_seed(results: Results, metric_name: str, digits: int) -> list[str]:
    longer = [LONGER_TDD] if results.records(LONGER_TDD) else []
    return [
        f"{name}, by seed: {_seeds(results, name, metric_name, digits)}."
        for name in (TDD, FDD, *longer)
    ]


def _fewest_deliveries(results: Results) -> list[str]:
    """Which node each violating policy leaves out, from the episodes on record."""
    parts = []
    for name in (TDD, FDD):
        for place in results.places(name):
            for record in results.records(name, place):
                broken = samples([record], "age_violations") + samples([record], "jain_violation")
                episode = episode_of(record)
                if max(broken, default=0) <= 0 or episode is None:
                    continue
                heard = np.array(episode.heard)[np.array(episode.delivered)]
                counts = np.bincount(heard, minlength=len(episode.nodes) + 1)[1:]
                least = int(counts.argmin())
                parts.append(
                    f"{name}, {symbol(results, place)}, seed {record.seed}: node {least + 1} at "
                    f"{tuple(episode.nodes[least])} delivers {counts[least]} of "
                    f"{counted(int(counts.sum()), 'packet')}"
                )
    return [f"Who is left out: {'; '.join(parts)}."] if parts else []


def cost(results: Results) -> list[str]:
    """Steps a second in both modes."""

    def both(place: float) -> str | None:
        rates = [_rate(results, name, place) for name in (TDD, FDD)]
        return " and ".join(filter(None, rates)) if all(rates) else None

    rates = _each_place(results, both)
    lines = [f"Steps a second, TDD and FDD: {rates}. Cells share the cores."]
    steps = {r.training.env_steps for s in (TDD, FDD) for r in results.records(s) if r.training}
    if len(steps) == 1:
        lines.insert(0, f"All trainings of both modes take {steps.pop():,} environment steps.")
    return lines


def _rate(results: Results, series: str, place: float) -> str | None:
    """Environment steps per second of the trainings at a place; None where there are none."""
    time = seconds(results, series, place)
    steps = [r.training.env_steps for r in results.records(series, place) if r.training]
    if time is None or not steps:
        return None
    rate = ratio(steps[0], time.mean)
    return f"{rate:,.0f}" if 0 <= rate < MOST_DIGITS else "–"
