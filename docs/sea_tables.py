"""The tables of `at-sea.md`, from the committed results of the studies of the sea."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path

from committed import results_of
from markdown_tables import page_of, table

from iout_marl.evaluation import Estimate
from iout_marl.report.measures import metric as metric_text
from iout_marl.report.measures import number
from iout_marl.study.results import Results

HERE = Path(__file__).parent
MODES = ("FDD", "TDD")
#: Policies of the study `sea`, and what the tables call them.
PLAYED = {
    "the paper's policy": "the paper's policy",
    "PPO trained there": "PPO trained there",
    "PPO on mean age": "PPO on mean age",
    "greedy": "greedy",
    "tour": "tour",
    "planner": "planner",
}
LEARNT, PLANNED = ("PPO trained there", "PPO on mean age"), ("tour", "planner")
BASELINES = ("random-walk", "round-robin", "greedy")
#: What the tables of energy have, by heading, with their metric.
ENERGY = {
    "J a node and day": "stored_j_per_day",
    "kJ a joule": "charging_kj_per_j",
    "Wh a packet": "packet_wh",
    "asleep": "asleep_share",
    "too weak": "packets_lost_weak",
    "bit errors": "packets_lost_bits",
    "stranded": "stranded_share",
}
#: The same of deployments.
DEPLOYED = {"AoI in s": "mean_aoi_s", "Jain": "jain", **ENERGY}


def steps_tables() -> str:
    """Mean AoI of every policy in every step, FDD and TDD."""
    return page_of(_steps_blocks())


def _steps_blocks() -> Iterator[str]:
    made = results_of("sea")
    for mode in MODES:
        yield f"**{mode}**, mean AoI in slots of 25 s:"
        rows = [
            (
                made.place_text(place),
                *(
                    metric_text(made.measured(f"{name}, {mode}", place, "mean_aoi"), "mean_aoi")
                    for name in PLAYED
                ),
            )
            for place in made.places()
        ]
        yield table(("Step", *PLAYED.values()), rows)


def conclusions_table() -> str:
    """Of every step: which of the paper's conclusions hold there."""
    made = results_of("sea")
    rows = []
    for place in made.places():
        fdd, tdd = (_best(made, LEARNT, mode, place) for mode in MODES)
        cells = [made.place_text(place), _less(fdd, tdd, *MODES)]
        cells.append(_less(*(_best(made, (*LEARNT, *PLANNED), m, place) for m in MODES), *MODES))
        for mode, learnt in zip(MODES, (fdd, tdd), strict=True):
            cells.append(_less(learnt, _best(made, BASELINES, mode, place), "PPO", "a baseline"))
            cells.append(_less(learnt, _best(made, PLANNED, mode, place), "PPO", "the planner"))
        rows.append(cells)
    headings = (
        *("Step", "Fresher, of PPO", "Fresher, of all"),
        *(f"{what}, {mode}" for mode in MODES for what in ("PPO or baseline", "PPO or planner")),
    )
    return table(headings, rows)


def fairness_table() -> str:
    """Jain's index of every policy in every step."""
    made = results_of("sea")
    rows = [
        (
            made.place_text(place),
            *(
                metric_text(made.measured(f"{name}, {mode}", place, "jain"), "jain")
                for mode in MODES
                for name in (*LEARNT, "planner")
            ),
        )
        for place in made.places()
    ]
    headings = (f"{name}, {mode}" for mode in MODES for name in (*LEARNT, "planner"))
    return table(("Step", *headings), rows)


def _best(made: Results, names: Sequence[str], mode: str, place: float) -> Estimate:
    """The lowest mean AoI of these policies."""
    found = (_estimate(made, f"{name}, {mode}", place) for name in names)
    return min(found, key=lambda estimate: estimate.mean)


def _estimate(made: Results, series: str, place: float) -> Estimate:
    measured = made.measured(series, place, "mean_aoi")
    if measured is None:
        raise ValueError(f"{series}: has no figure at {place}")
    return measured.estimate


def _less(first: Estimate, second: Estimate, one: str, other: str) -> str:
    """Which of both is less, where their intervals do not overlap, and by how much."""
    ranked = sorted(((first, one), (second, other)), key=lambda each: each[0].mean)
    (better, name), (worse, _) = ranked
    highest = better.mean if math.isnan(better.high) else better.high
    lowest = worse.mean if math.isnan(worse.low) else worse.low
    if highest >= lowest:
        return "not told apart"
    return f"{name} by {100 * (worse.mean / better.mean - 1):.0f} %"


def energy_tables() -> str:
    """What the policies trained in every step take of energy, and lose of packets."""
    made, blocks = results_of("sea"), []
    for mode in MODES:
        blocks.append(f"**{mode}**, {LEARNT[1]}:")
        rows = [
            (
                made.place_text(place),
                *(
                    metric_text(made.measured(f"{LEARNT[1]}, {mode}", place, metric), metric)
                    for metric in ENERGY.values()
                ),
            )
            for place in made.places()
        ]
        blocks.append(table(("Step", *ENERGY), rows))
    return page_of(blocks)


def life_table() -> str:
    """Share of the time that nodes sleep, by spacing, power and idle draw."""
    made = results_of("sea-life")
    places = made.places()
    rows = []
    for name in made.series:
        power, _, spacing = name.partition(", cells of ")
        found = [made.measured(name, place, "asleep_share") for place in places]
        rows.append((spacing, power, *(f"{m.mean:.1%}" if m else "–" for m in found)))
    headings = ("Cells", "Source", *(f"{1000 * place:g} mW" for place in places))
    return table(headings, rows)


def deployments_tables() -> str:
    """Every policy in every scenario of the study of deployments."""
    made, blocks = results_of("sea-deployments"), []
    for place in made.places():
        blocks.append(f"**`sea/{made.place_text(place)}`**:")
        shown = [
            heading
            for heading, metric in DEPLOYED.items()
            if any(made.measured(name, place, metric) for name in made.series)
        ]
        played = [name for name in made.series if made.measured(name, place, "mean_aoi")]
        rows = [(name, *_cells(made, name, place, shown)) for name in played]
        blocks.append(table(("Policy", *shown), rows))
    return page_of(blocks)


def _cells(made: Results, series: str, place: float, shown: Sequence[str]) -> Iterator[str]:
    for heading in shown:
        metric = DEPLOYED[heading]
        measured = made.measured(series, place, metric)
        digits = 1 if heading == "AoI in s" else None
        if measured is not None and digits is not None:
            yield number(measured.estimate, digits)
        else:
            yield metric_text(measured, metric)
