"""The report of the paper's study."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import get_args

from iout_marl.paper.claims import answers
from iout_marl.paper.link_figures import beta_star_figure, energies_figure, energy_table
from iout_marl.paper.names import BASELINES, BEST, BEST_FDD, BEST_TDD, FDD, TDD, in_fdd
from iout_marl.paper.rewards import advice, judgements, terms_table
from iout_marl.paper.tables import (
    constraint_table,
    cost_table,
    hyperparameter_table,
    paper_settings,
    setting,
    trained_settings,
)
from iout_marl.report.document import Answers, Report, Section, Verdict
from iout_marl.report.figure import Plot
from iout_marl.report.gaps import gap_section
from iout_marl.report.generic import cells_section, facts
from iout_marl.report.study_figures import (
    learning_figure,
    metric_figure,
    metrics_table,
    trajectory_figure,
)
from iout_marl.study.results import Results

#: The paper's comparison: its baselines in the TDD world, and both trained policies.
COMPARED = (*BASELINES, TDD, FDD)
#: Everything in the FDD world, for a comparison on equal terms.
EQUAL_TERMS = (*(in_fdd(name) for name in BASELINES), FDD)

#: In the paper numbers of nodes are categories, each with a group of bars.
metric_bars = partial(metric_figure, grouped=True)

BEYOND = (
    "The paper's reward weighs the age by 1 − J: the fairer a policy, the less its reward "
    "depends on age. Here the same worlds are trained on the mean age alone and, in TDD, with a "
    "β rule that counts stored energy too."
)


def paper_report(results: Results) -> Report:
    """Claims, figures and tables of the paper, and what lies beyond it."""
    claims = answers(results)
    sections = (
        Section("answers", "The paper's claims, one by one", items=(claims,)),
        _link(results),
        _performance(results),
        gap_section(results, grouped=True),
        _learning(results),
        _paths(results),
        _cost(results),
        _beyond(results),
        cells_section(results),
    )
    return Report(
        title=f"Reproduction: {results.title}",
        lead=_lead(results, claims),
        facts=facts(results),
        sections=tuple(section for section in sections if section.items),
    )


def _lead(results: Results, claims: Answers) -> tuple[str, ...]:
    counts = [(v, claims.count(v)) for v in get_args(Verdict)]
    verdicts = ", ".join(f"{n} {v}" for v, n in counts if n)
    provisionally = ", provisionally" if claims.provisional else ""
    lead = [
        results.description,
        f"Of the paper's {len(claims.answers)} claims{provisionally}: {verdicts}.",
    ]
    lead += _other_settings(results)
    if results.quick:
        lead.append(
            "This is the study's short form (`--quick`): fewer K, one seed, shorter trainings. "
            "Without a second seed no interval of a trained policy can be given, and orders are "
            "judged by single values: verdicts on what was measured are provisional, and that on "
            "the cost of training is left open, since times of one training beside other work "
            "tell little."
        )
    return (*(text for text in lead if text), *judgements(results))


def _other_settings(results: Results) -> list[str]:
    """That policies were trained otherwise than the paper's, where they were."""
    found = []
    for mode, name in (("tdd", TDD), ("fdd", FDD)):
        own, paper = trained_settings(results, mode), paper_settings(mode)
        differing = {"discount": "γ", "learning_rate": "learning rate", "steps": "steps"}
        parts = [
            f"{label} {setting(own, key)} (the paper: {setting(paper, key)})"
            for key, label in differing.items()
            if key in own and own[key] != paper[key]
        ]
        if parts:
            found.append(f"{name}: {', '.join(parts)}")
    if not found:
        return []
    return [f"Policies are not trained by the paper's settings. {'. '.join(found)}."]


def _link(results: Results) -> Section:
    command = results.command
    return Section(
        "link",
        "Charging and uplink by distance",
        items=(energies_figure(command), beta_star_figure(command), energy_table(command)),
    )


def _performance(results: Results) -> Section:
    ours = "PPO-FDD plays in the FDD world, all others in the TDD world, as in the paper."
    equal = "All four play in the FDD world."
    series = [name for name in COMPARED if results.records(name)]
    fdd = [name for name in EQUAL_TERMS if results.records(name)]
    figures: list[Plot] = [
        metric_bars(results, "aoi", "Average Age of Information", "mean_aoi", series, ours),
        metric_bars(results, "energy", "Total energy harvested", "harvested_kj", series, ours),
        metric_bars(results, "jain", "Average Jain's fairness index", "jain", series, ours),
        metric_bars(results, "aoi-fdd", "Average AoI on equal terms: FDD", "mean_aoi", fdd, equal),
    ]
    tables = (
        metrics_table(results, "performance-table", "Performance in numbers", [*series, *fdd[:-1]]),
        constraint_table(results, [*series, *fdd[:-1], *BEST]),
    )
    return Section(
        "performance",
        "Age, energy and fairness",
        items=(*(f for f in figures if f.lines), *tables),
    )


def _learning(results: Results) -> Section:
    items = [
        learning_figure(
            results, f"learning-{kind}-{mode}", f"Learning curves: {title}, {name}", curve, name
        )
        for mode, name in (("tdd", TDD), ("fdd", FDD))
        for kind, curve, title in (
            ("aoi", "aoi/mean", "mean AoI"),
            ("reward", "reward/total", "reward"),
        )
        if results.records(name)
    ]
    shown = tuple(figure for figure in items if figure.lines)
    return Section("learning", "Learning curves", items=shown)


def _paths(results: Results) -> Section:
    figures = [
        trajectory_figure(results, f"path-{mode}", name, results.places(name)[-1])
        for mode, name in (("tdd", TDD), ("fdd", FDD))
        if results.places(name)
    ]
    return Section(
        "paths", "Paths of trained AUVs", items=tuple(f for f in figures if f is not None)
    )


def _cost(results: Results) -> Section:
    cost = cost_table(results)
    return Section(
        "cost-of-training",
        "Cost of training",
        items=(*((cost,) if cost.rows else ()), hyperparameter_table(results)),
    )


def _beyond(results: Results) -> Section:
    pairs: Sequence[tuple[str, str, str]] = (("tdd", TDD, BEST_TDD), ("fdd", FDD, BEST_FDD))
    figures = [
        metric_bars(
            results,
            f"reward-{mode}",
            f"The paper's reward and mean AoI alone: {mode.upper()}",
            "mean_aoi",
            [paper, best],
            f"{best}: the reward is the mean age alone"
            + (", and slots are split by the better β rule." if mode == "tdd" else "."),
        )
        for mode, paper, best in pairs
        if results.records(paper) and results.records(best)
    ]
    everything = [name for _, *names in pairs for name in names if results.records(name)]
    terms = terms_table(results)
    return Section(
        "beyond",
        "Beyond the paper: which reward to use",
        paragraphs=(BEYOND, *advice(results)),
        items=(
            *figures,
            *(
                (metrics_table(results, "rewards", "Both rewards in numbers", everything),)
                if figures
                else ()
            ),
            *((terms,) if terms else ()),
        ),
    )
