"""Figures and tables of any study: metrics over the axis, learning curves, paths, cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from iout_marl.evaluation import Estimate
from iout_marl.metrics import TABLED, curve_title, described
from iout_marl.report.content import Line, Plot, Table, Trajectory
from iout_marl.report.intake import curves, walk_of
from iout_marl.report.measures import (
    bound_text,
    counted,
    metric_heading,
    metric_mean,
    place_text,
)
from iout_marl.report.measures import metric as metric_text
from iout_marl.study.results import Measured, Record, Results

#: Places further apart than by this factor have a logarithmic axis.
MOST_LINEAR = 100

#: What every figure of a training shows.
LEARNING = (
    "Episodes that ended in each rollout, actions sampled from the policy as it learns; mean "
    "over seeds, and the range of the seeds."
)


def protocol(results: Results, series: Sequence[str], *, intervals: bool = True) -> str:
    """Seeds, episodes and what the intervals are of, if any, for the caption of a figure."""
    groups: dict[str, list[str]] = {}
    bounds = list(filter(results.is_bound, series))
    for name in series:
        if name not in bounds:
            groups.setdefault(_runs(results, name, intervals=intervals), []).append(name)
    sentences = [
        f"{_listed(names) if len(groups) > 1 else 'Every series'}: {runs}."
        for runs, names in groups.items()
    ]
    if bounds:
        found = (record.search for name in bounds for record in results.records(name))
        stated = dict.fromkeys(filter(None, (search.partition("; ")[2] for search in found)))
        certified = "certified, no policy's mean AoI is lower"
        sentences.append(f"{_listed(bounds)}: {', '.join([certified, *stated])}.")
    return " ".join(sentences)


def _runs(results: Results, series: str, *, intervals: bool) -> str:
    """How many runs a series has, of how many episodes, and what its intervals are of."""
    records = results.records(series)
    seeds = max(len(results.records(series, place)) for place in results.places(series))
    episodes = records[0].episodes
    text = counted(seeds, "training" if records[0].training else "run")
    text += f", {counted(episodes, 'episode')}" + (" each" if seeds > 1 else "")
    if not intervals:
        return text
    if seeds > 1:
        return f"{text}; 95 % interval of the mean over seeds"
    if episodes > 1:
        alike = all(len(set(values)) == 1 for r in records for values in r.samples.values())
        return f"{text}; " + (
            "all alike, without an interval" if alike else "95 % interval of the mean over episodes"
        )
    return f"{text}; a single episode, without an interval"


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def metric_figure(
    results: Results,
    key: str,
    title: str,
    metric: str,
    series: Sequence[str],
    remark: str = "",
) -> Plot:
    """A metric, by series, over the axis."""
    shown = [
        name
        for name in series
        if any(results.measured(name, place, metric) for place in results.places(name))
    ]
    lines = []
    for colour, name in enumerate(shown):
        places = results.places(name)
        found = [results.measured(name, place, metric) for place in places]
        estimates = [m.estimate if m else Estimate(math.nan, math.nan, math.nan) for m in found]
        lines.append(
            Line(
                name,
                tuple(places),
                tuple(e.mean for e in estimates),
                tuple(e.low for e in estimates),
                tuple(e.high for e in estimates),
                dashed=results.is_bound(name),
                colour=colour,
            )
        )
    return Plot(
        key=key,
        title=title,
        caption=" ".join(part for part in (remark, protocol(results, shown)) if part),
        command=results.command,
        x_label=results.axis.label,
        y_label=metric_heading(metric),
        lines=tuple(lines),
        **over_axis(results, lines),
    )


def over_axis(results: Results, lines: Sequence[Line]) -> dict[str, Any]:
    """How a figure over the study's axis is drawn, as arguments of `Plot`.

    In the paper numbers of nodes are categories, each with a group of bars, and so is a single
    place. Elsewhere an axis is one of numbers, by powers of ten where they span more than two.
    """
    places = sorted({x for line in lines for x in line.x})
    if results.report == "paper" or len(places) < 2:
        return {"kind": "bars", "categories": True}
    sizes = [abs(place) for place in places if place != 0]
    return {"places": True, "log_x": max(sizes) / min(sizes) > MOST_LINEAR}


def learning_figure(
    results: Results, key: str, title: str, curve: str, series: Sequence[str], remark: str = ""
) -> Plot:
    """A quantity over environment steps, one line for each series and place on the axis."""
    lines: list[Line] = []
    for name in series:
        for place in results.places(name):
            records = [r for r in results.records(name, place) if r.training]
            if curves(records, curve)[0]:
                label = _place_label(results, name, place, series)
                lines.append(_learning_line(label, records, curve, colour=len(lines)))
    return Plot(
        key=key,
        title=title,
        caption=f"{remark} {LEARNING}".strip(),
        command=results.command,
        x_label="Environment steps",
        y_label=curve_title(curve),
        lines=tuple(lines),
    )


def _place_label(results: Results, name: str, place: float, series: Sequence[str]) -> str:
    symbol = {"nodes.count": "K", "auvs.count": "M"}.get(results.axis.key, results.axis.key)
    where = f"{symbol} = {place_text(place)}"
    return where if len(series) == 1 else f"{name}, {where}"


def _learning_line(label: str, records: Sequence[Record], curve: str, colour: int) -> Line:
    steps, values = curves(records, curve)
    several = len(values) > 1
    return Line(
        label,
        tuple(steps),
        tuple(values.mean(axis=0).tolist()),
        tuple(values.min(axis=0).tolist()) if several else (),
        tuple(values.max(axis=0).tolist()) if several else (),
        colour=colour,
    )


def trajectory_figure(results: Results, key: str, series: str, place: float) -> Trajectory | None:
    """The path of the first AUV of the first seed; None where nothing was trained."""
    walks = ((r, walk_of(r)) for r in results.records(series, place) if r.episode)
    record, walk = next(walks, (None, None))
    if record is None or walk is None:
        return None
    deliveries = sum(slot[0] for slot in walk.delivered)
    return Trajectory(
        key=key,
        title=f"Path of {series} with {counted(record.nodes, 'node')}",
        caption=(
            f"One episode of the deterministic policy of seed {record.seed} on "
            f"{record.scenario} ({record.scenario_hash}): {deliveries} of "
            f"{counted(len(walk.delivered), 'slot')} deliver a packet; mean AoI "
            f"{metric_mean(record.mean('mean_aoi'), 'mean_aoi')}."
        ),
        command=results.command,
        grid=walk.grid,
        spacing_m=walk.spacing_m,
        nodes=walk.nodes,
        path=tuple(slot[0] for slot in walk.path),
        charged=tuple(slot[0] for slot in walk.charged),
        heard=tuple(slot[0] for slot in walk.heard),
        delivered=tuple(slot[0] for slot in walk.delivered),
        ages=walk.ages,
    )


def metrics_table(
    results: Results,
    key: str,
    title: str,
    series: Sequence[str],
    metrics: Sequence[str] = TABLED,
    remark: str = "",
) -> Table:
    """Metrics with their intervals, a row for each series and place on the axis."""
    shown = [name for name in series if results.records(name)]
    rows = [
        (
            name,
            place_text(place),
            *(_metric_text(results, name, place, metric) for metric in metrics),
        )
        for place in results.places()
        for name in shown
        if results.records(name, place)
    ]
    return Table(
        key=key,
        title=title,
        caption=" ".join(part for part in (remark, protocol(results, shown)) if part),
        command=results.command,
        columns=("Series", results.axis.label, *map(metric_heading, metrics)),
        rows=tuple(rows),
        numeric=frozenset(range(1, len(metrics) + 2)),
    )


def _metric_text(results: Results, series: str, place: float, metric: str) -> str:
    measured = results.measured(series, place, metric)
    if measured is not None and results.is_bound(series):
        return bound_text(measured.mean, described(metric).digits)
    return metric_text(measured, metric)


def seconds(results: Results, series: str, place: float) -> Measured | None:
    """Wall-clock seconds of the trainings of a series at a place."""
    values = tuple(r.training.seconds for r in results.records(series, place) if r.training)
    return Measured(values, "seeds") if values else None
