"""The paper's tables: cost of training, hyperparameters, constraints."""

from __future__ import annotations

from typing import Any

import numpy as np

from iout_marl.paper.names import FDD, TDD
from iout_marl.paper.paper_data import printed_costs
from iout_marl.report.document import Table
from iout_marl.report.markup import as_data
from iout_marl.report.measures import (
    MOST_DIGITS,
    duration,
    fixed,
    number,
    ratio,
    samples,
)
from iout_marl.report.study_figures import seconds
from iout_marl.scenario import load_scenario
from iout_marl.study.results import Measured, Results

#: Trained series of the paper, by duplex mode.
BY_MODE = {"tdd": TDD, "fdd": FDD}
MODES = ("tdd", "fdd")
#: Rows of the table of hyperparameters: heading, field, and what the paper prints.
HYPERPARAMETERS = (
    ("Discount factor γ", "discount"),
    ("Learning rate α", "learning_rate"),
    ("Learning-rate schedule", "learning_rate_schedule"),
    ("Entropy coefficient c₂", "entropy_coefficient"),
    ("Environments", "environments"),
    ("Steps per update (n_steps)", "rollout_slots"),
    ("Epochs", "epochs"),
    ("Minibatches", "minibatches"),
    ("GAE λ", "gae_lambda"),
    ("Clip range", "clip"),
    ("Hidden units", "hidden_units"),
    ("Activation", "activation"),
    ("Environment steps", "steps"),
)
#: Those that the paper itself prints; the others are of the library that it used.
PRINTED = ("discount", "learning_rate", "entropy_coefficient", "rollout_slots")


def energy_kwh(results: Results, series: str, place: float) -> Measured | None:
    """Electric energy of the trainings of a series, where it was measured."""
    return _emissions(results, series, place, "energy_kwh")


def co2_kg(results: Results, series: str, place: float) -> Measured | None:
    """CO₂ of the trainings of a series, where it was measured."""
    return _emissions(results, series, place, "co2_kg")


def _emissions(results: Results, series: str, place: float, name: str) -> Measured | None:
    found = [
        r.training.emissions
        for r in results.records(series, place)
        if r.training and r.training.emissions
    ]
    values = tuple(float(getattr(emissions, name)) for emissions in found)
    return Measured(values, "seeds") if values else None


def cost_table(results: Results) -> Table:
    """Time, energy and CO₂ of a training beside the paper's."""
    rows = []
    for (nodes, mode), printed in printed_costs().items():
        time = seconds(results, BY_MODE[mode], nodes)
        if time is None:
            continue
        energy = energy_kwh(results, BY_MODE[mode], nodes)
        co2 = co2_kg(results, BY_MODE[mode], nodes)
        rows.append(
            (
                f"{nodes} nodes {mode.upper()}",
                duration(60 * printed.minutes),
                number(time.estimate, 1, "s"),
                _times(60 * printed.minutes, time.mean),
                f"{1000 * printed.energy_kwh:.1f}",
                _milli(energy),
                f"{1000 * printed.co2_kg:.1f}",
                _milli(co2),
            )
        )
    used = {
        r.training.emissions.codecarbon
        for cell in results.cells
        for r in [cell.record]
        if r.training and r.training.emissions
    }
    if used:
        how = (
            f"Energy and CO₂ as codecarbon {as_data(', '.join(sorted(used)))} estimates them of "
            "the training's own process: from the processor's counters where it can read them, "
            "else from its nominal power and load, which follows the time."
        )
        how += f" Carbon intensity: {results.carbon_g_per_kwh:g} g/kWh, the paper's own."
    else:
        how = "Energy and CO₂ were not measured: codecarbon (extra `emissions`) was not installed."
    return Table(
        key="cost",
        title="What a training takes, beside the paper's",
        caption=(
            "Seconds of one training on one thread, as many side by side as there are cores; "
            f"mean and 95 % interval over seeds. {how} The trainings differ in their settings, "
            "see the next table. The paper measured with eco2ai on a "
            "Ryzen 7 5800H with a GTX 1650."
        ),
        command=results.command,
        columns=(
            "PPO model",
            "Paper",
            "Here",
            "Times faster",
            "Paper, Wh",
            "Here, Wh",
            "Paper, g CO₂",
            "Here, g CO₂",
        ),
        rows=tuple(rows),
        numeric=frozenset(range(1, 8)),
    )


def _times(paper_s: float, here_s: float) -> str:
    times = ratio(paper_s, here_s)
    return f"{times:,.0f}" if 0 <= times < MOST_DIGITS else fixed(times, 0)


def _milli(measured: Measured | None) -> str:
    """In thousandths of its unit."""
    if measured is None:
        return "–"
    return number(Measured(tuple(1000 * v for v in measured.samples), measured.over).estimate, 3)


def hyperparameter_table(results: Results) -> Table:
    """The paper's settings beside those of this study's trainings."""
    paper = [paper_settings(mode) for mode in MODES]
    own = [trained_settings(results, mode) for mode in MODES]
    rows = [
        (
            heading + ("" if field in PRINTED else " *"),
            *(setting(s, field) for s in (*paper, *own)),
        )
        for heading, field in HYPERPARAMETERS
    ]
    return Table(
        key="hyperparameters",
        title="Hyperparameters, the paper's and those used here",
        caption=(
            "The paper's as printed; with *, those of the library that it used (training preset "
            f"`paper`). Here: those of {BY_MODE['tdd']} and {BY_MODE['fdd']} at the largest K."
        ),
        command="iout show paper/k10-tdd --set training.preset=paper",
        columns=("Hyperparameter", "Paper, TDD", "Paper, FDD", "Here, TDD", "Here, FDD"),
        rows=tuple(rows),
        numeric=frozenset(range(1, 5)),
    )


def paper_settings(mode: str) -> dict[str, Any]:
    """The paper's settings of a training with ten nodes."""
    scenario = load_scenario(f"paper/k10-{mode}", {"training.preset": "paper"})
    return scenario.training.model_dump(mode="json")


def trained_settings(results: Results, mode: str) -> dict[str, Any]:
    """The settings of this study's trainings, at the largest K; empty where there is none."""
    records = [r for r in results.records(BY_MODE[mode]) if r.training]
    return records[-1].training.settings if records and records[-1].training else {}


def setting(settings: dict[str, Any], field: str) -> str:
    """A setting as text; a dash where it is none that this software knows."""
    value = settings.get(field)
    if isinstance(value, list) and all(isinstance(part, int | float | str) for part in value):
        return as_data(" × ".join(map(str, value)))
    if isinstance(value, int | float) and not isinstance(value, bool):
        return f"{value:,}"
    return as_data(value) if isinstance(value, str) else "–"


def constraint_table(results: Results, series: list[str]) -> Table:
    """How often the constraints of the paper's problem P1 are broken."""
    rows, marked = [], set()
    for place in results.places():
        for name in series:
            records = results.records(name, place)
            if not samples(records, "jain"):
                continue
            jain, unfair, late = (
                np.array(samples(records, metric))
                for metric in ("jain", "jain_violation", "age_violations")
            )
            rows.append(
                (
                    name,
                    results.place_text(place),
                    fixed(jain.min(), 3),
                    f"{fixed(100 * unfair.mean(), 0)} %",
                    f"{100 * (late > 0).mean():.0f} %",
                    fixed(late.mean(), 1),
                )
            )
            marked |= {(len(rows) - 1, 3)} if unfair.any() else set()
            marked |= {(len(rows) - 1, 4)} if late.any() else set()
    return Table(
        key="constraints",
        title="Constraints of P1: fairness and age",
        caption=(
            "Over all episodes and seeds. A node-slot counts where an age would pass A_max "
            f"({_limits(results, 'maximum_age')} slots), at which it stops; an episode is unfair "
            f"where it ends below J_min ({_limits(results, 'minimum_jain')})."
        ),
        command=results.command,
        columns=(
            "Series",
            results.axis.label,
            "Lowest Jain's index",
            "Unfair episodes",
            "Episodes with an age above A_max",
            "Node-slots above A_max, mean",
        ),
        rows=tuple(rows),
        numeric=frozenset(range(1, 6)),
        marked=frozenset(marked),
    )


def _limits(results: Results, name: str) -> str:
    return " or ".join(f"{v:g}" for v in sorted({getattr(c.record, name) for c in results.cells}))
