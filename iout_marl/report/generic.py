"""The report of any study, `plain`: series over the axis, trainings, paths, cells."""

from __future__ import annotations

import math
from collections import Counter

from iout_marl.evaluation import METRICS
from iout_marl.metrics import DRAWN, TABLED, described
from iout_marl.render.style import COLOURS
from iout_marl.report.document import Report, Section, Table
from iout_marl.report.figure import Plot
from iout_marl.report.fronts import front_section
from iout_marl.report.gaps import gap_lead, gap_section
from iout_marl.report.markup import as_data
from iout_marl.report.measures import duration, metric_mean
from iout_marl.report.registry import reports
from iout_marl.report.study_figures import (
    learning_figure,
    metric_figure,
    metrics_table,
    trajectory_figure,
)
from iout_marl.study.results import Results
from iout_marl.words import counted

#: Series that a figure has room for, and those whose paths are shown.
MOST_SERIES, MOST_PATHS = 24, 4


@reports.register("plain")
def generic_report(results: Results) -> Report:
    """Every series over the axis."""
    first = described(DRAWN[0])
    best = min(
        (
            (measured.mean, name, place)
            for name in results.series
            if not results.is_bound(name)
            for place in results.places(name)
            if (measured := results.measured(name, place, first.name))
        ),
        default=None,
    )
    lead = [results.description] if results.description else []
    if best is not None:
        lead.append(
            f"The lowest {first.heading}, {metric_mean(best[0], first.name)}, is that of "
            f"{best[1]} ({results.axis.label}: {results.place_text(best[2])})."
        )
    lead += gap_lead(results)
    others = results.metrics[len(METRICS) :]
    # Their names may be no names of files.
    keys = {name: f"metric-{i + 1}" for i, name in enumerate(others)}
    figures = [
        metric_figure(
            results,
            keys.get(name, name) + number,
            as_data(described(name).title) + of_what,
            name,
            names,
        )
        for name in (*DRAWN, *others)
        for number, of_what, names in _families(results.series)
    ]
    zero = [f.title for f in figures if f.lines and not _has_other_than_zero(f)]
    overview = Section(
        key="overview",
        title="Series over the axis",
        paragraphs=(f"0 throughout, and so without a figure: {'; '.join(zero)}.",) if zero else (),
        items=(
            *filter(_has_other_than_zero, figures),
            metrics_table(results, "metrics", "All series", results.series, (*TABLED, *others)),
        ),
    )
    sections = [gap_section(results), front_section(results), overview]
    sections += [
        learning_section(results, results.series),
        paths_section(results),
        cells_section(results),
    ]
    return Report(
        title=results.title,
        lead=tuple(lead),
        facts=facts(results),
        sections=tuple(s for s in sections if s.items),
    )


def _has_other_than_zero(figure: Plot) -> bool:
    return any(y != 0 and not math.isnan(y) for line in figure.lines for y in line.y)


def _families(series: list[str]) -> list[tuple[str, str, list[str]]]:
    """Series that share a figure: all, or, where these are too many to be told apart, those
    whose names continue alike after their first comma, and so many of these as can be.

    Returns:
        for each: what its key ends with, what its title ends with, and the series.
    """
    if len(series) <= len(COLOURS):
        return [("", "", series)]
    families: dict[str, list[str]] = {}
    for name in series:
        families.setdefault(name.partition(", ")[2], []).append(name)
    parts = [
        (rest, names[i : i + MOST_SERIES])
        for rest, names in families.items()
        for i in range(0, len(names), MOST_SERIES)
    ]
    return [
        (f"-{i + 1}", f": {rest}" if rest else "", names) for i, (rest, names) in enumerate(parts)
    ]


def learning_section(results: Results, series: list[str]) -> Section:
    """Curves of all trained series."""
    tag = described(DRAWN[0]).tag
    trained = [n for n in series if any(r.training for r in results.records(n))]
    items = [
        learning_figure(results, f"learning-{i + 1}", f"Learning curves: {name}", tag, name)
        for i, name in enumerate(trained)
    ]
    shown = tuple(figure for figure in items if figure.lines)
    return Section("learning", "Learning curves", items=shown)


def paths_section(results: Results) -> Section:
    """An episode of each trained series, the first few, at its last place on the axis."""
    trained = [n for n in results.series if any(r.episode for r in results.records(n))]
    figures = [
        trajectory_figure(results, f"path-{i + 1}", name, results.places(name)[-1])
        for i, name in enumerate(trained[:MOST_PATHS])
    ]
    left_out = (f"The first {MOST_PATHS} of {len(trained)} trained series.",)
    return Section(
        "paths",
        "Paths of trained AUVs",
        paragraphs=left_out if len(trained) > MOST_PATHS else (),
        items=tuple(figure for figure in figures if figure is not None),
    )


def cells_section(results: Results) -> Section:
    """Scenarios and their hashes; what failed."""
    scenarios: dict[tuple[str, float], tuple[str, ...]] = {}
    seeds: dict[tuple[str, float], list[str]] = {}
    for cell in results.cells:
        record = cell.record
        seeds.setdefault((cell.series, cell.axis), []).append(f"{record.seed}")
        scenarios.setdefault(
            (cell.series, cell.axis),
            (
                record.scenario,
                record.scenario_hash,
                f"{record.episodes}",
                f"{record.training.env_steps:,}" if record.training else "–",
                record.search or (f"trained in {record.trained_in}" if record.trained_in else "–"),
            ),
        )
    items = [
        Table(
            key="cells",
            title="What was run",
            caption="Every setting that affects results is in the hash.",
            command=results.command,
            columns=(
                "Series",
                results.axis.label,
                "Scenario",
                "Hash",
                "Seeds",
                "Episodes",
                "Environment steps",
                "Search",
            ),
            rows=tuple(
                (
                    series,
                    results.place_text(place),
                    *what[:2],
                    ", ".join(seeds[series, place]),
                    *what[2:],
                )
                for (series, place), what in scenarios.items()
            ),
            numeric=frozenset({1, 5, 6}),
        )
    ]
    if results.failures:
        items.append(
            Table(
                key="failures",
                title="Cells that failed",
                caption="The same command tries them again.",
                command=results.command,
                columns=("Series", results.axis.label, "Seed", "Why"),
                rows=tuple(
                    (f.series, results.place_text(f.axis), f"{f.seed}", f.error)
                    for f in results.failures
                ),
                numeric=frozenset({1, 2}),
            )
        )
    return Section("what-was-run", "What was run", items=tuple(items))


def _cores(number: str) -> str:
    return counted(int(number), "core") if number.isdecimal() else f"{number} cores"


def facts(results: Results) -> tuple[tuple[str, str], ...]:
    """Machine, versions, dates, numbers of cells, and the time they took."""
    records = [cell.record for cell in results.cells]
    found = []
    machines = Counter(tuple(sorted(record.machine.items())) for record in records)
    for machine, count in machines.most_common():
        values = dict(machine)
        where = f"{values.pop('processor', '')}, {_cores(values.pop('cores', '?'))}"
        system = values.pop("system", "")
        versions = ", ".join(f"{name} {number}" for name, number in values.items())
        share = f" ({count} of {len(records)} cells)" if len(machines) > 1 else ""
        found += [("Machine", f"{where}, {system}{share}"), ("Versions", versions)]
    dates = sorted({record.date for record in records})
    found.append(("Date", " to ".join(dict.fromkeys((dates[0], dates[-1]))) if dates else "–"))
    trained = [record.training for record in records if record.training]
    total = sum(training.seconds for training in trained)
    kind = "is a training" if len(trained) == 1 else "are trainings"
    cells = f"{len(records)}, of which {len(trained)} {kind}"
    found.append(
        ("Cells", cells + (f"; {len(results.failures)} failed" if results.failures else ""))
    )
    if trained:
        found.append(("Training time", f"{duration(total)} of one thread"))
    found.append(("Command", f"`{results.command}`"))
    return tuple(found)
