"""Figures and tables of any study: metrics over the axis, learning curves, paths, cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

from iout_marl.evaluation import Estimate
from iout_marl.metrics import TABLED, curve_title, described
from iout_marl.report.document import Table
from iout_marl.report.figure import Axis, Line, Plot, TrajectoryPlot
from iout_marl.report.intake import curves
from iout_marl.report.measures import (
    bound_text,
    metric_heading,
    metric_mean,
)
from iout_marl.report.measures import metric as metric_text
from iout_marl.study.results import Measured, Record, Results
from iout_marl.trajectory import Trajectory
from iout_marl.words import counted, listed

#: From this factor between the largest value and the smallest on, an axis is logarithmic.
LOG_FROM = 100

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
        f"{listed(names) if len(groups) > 1 else 'Every series'}: {runs}."
        for runs, names in groups.items()
    ]
    if bounds:
        found = (record.search for name in bounds for record in results.records(name))
        stated = dict.fromkeys(filter(None, (search.partition("; ")[2] for search in found)))
        certified = "certified, no policy's mean AoI is lower"
        sentences.append(f"{listed(bounds)}: {', '.join([certified, *stated])}.")
    return " ".join(sentences)


def _runs(results: Results, series: str, *, intervals: bool) -> str:
    """How many runs a series has, of how many episodes, and what its intervals are of."""
    records = results.records(series)
    seeds = max(len(results.records(series, place)) for place in results.places(series))
    episodes = records[0].episodes
    is_trained = records[0].training or records[0].trained_in
    text = counted(seeds, "training" if is_trained else "run")
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


def metric_figure(
    results: Results,
    key: str,
    title: str,
    metric: str,
    series: Sequence[str],
    remark: str = "",
    *,
    grouped: bool = False,
) -> Plot:
    """A metric, by series, over the axis.

    Args:
        results: of the study.
        key, title: of the figure.
        metric: its name.
        series: names of the series.
        remark: what its caption begins with.
        grouped: whether the values of the axis are categories, each with a group of bars.
    """
    shown = [
        name
        for name in series
        if any(results.measured(name, place, metric) for place in results.places(name))
    ]
    lines = []
    for name in shown:
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
            )
        )
    return Plot(
        key=key,
        title=title,
        caption=" ".join(part for part in (remark, protocol(results, shown)) if part),
        command=results.command,
        x=axis_of(results, lines, grouped=grouped),
        y=Axis(metric_heading(metric)),
        lines=tuple(lines),
    )


def axis_of(results: Results, lines: Sequence[Line], *, grouped: bool = False) -> Axis:
    """The study's axis under these lines, one of numbers with a tick at each of them.

    It is logarithmic where they span two powers of ten. Where bars are grouped, and of a single
    value, they are categories.
    """
    if results.axis.variants:
        return Axis(results.axis.label, scale="categories", names=results.axis.variants)
    places = {x for line in lines for x in line.x}
    if grouped or len(places) < 2:
        return Axis(results.axis.label, scale="categories")
    sizes = [abs(place) for place in places if place != 0]
    is_log = max(sizes) / min(sizes) >= LOG_FROM
    return Axis(results.axis.label, "log" if is_log else "linear", ticks_at_values=True)


def learning_figure(results: Results, key: str, title: str, curve: str, series: str) -> Plot:
    """A quantity over environment steps of a series, one line for each place on the axis."""
    lines: list[Line] = []
    for place in results.places(series):
        steps, values = curves(results.records(series, place), curve)
        if steps:
            ends = (values.min(axis=0), values.max(axis=0)) if len(values) > 1 else ((), ())
            points = (steps, values.mean(axis=0), *ends)
            x, y, low, high = (tuple(map(float, numbers)) for numbers in points)
            lines.append(Line(at_place(results, place), x, y, low, high, colour=len(lines)))
    return Plot(
        key=key,
        title=title,
        caption=LEARNING,
        command=results.command,
        x=Axis("Environment steps"),
        y=Axis(curve_title(curve)),
        lines=tuple(lines),
    )


def at_place(results: Results, place: float) -> str:
    """`K = 3`."""
    symbol = {"nodes.count": "K", "auvs.count": "M"}.get(results.axis.key, results.axis.key)
    place_text = results.place_text(place)
    return place_text if results.axis.variants else f"{symbol} = {place_text}"


def trajectory_figure(
    results: Results, key: str, series: str, place: float
) -> TrajectoryPlot | None:
    """An episode of the first seed; None where nothing was trained."""
    found = ((r, e) for r in results.records(series, place) if (e := episode_of(r)))
    record, episode = next(found, (None, None))
    if record is None or episode is None:
        return None
    packets = sum(map(sum, episode.delivered)) + sum(arrived for *_, arrived in episode.polls())
    return TrajectoryPlot(
        key=key,
        title=f"Path{'s' if record.auvs > 1 else ''} of {series} with "
        f"{counted(record.nodes, 'node')}",
        caption=(
            f"One episode of the deterministic policy of seed {record.seed} on "
            f"{record.scenario} ({record.scenario_hash}): {counted(packets, 'packet')} delivered "
            f"in {counted(len(episode.delivered), 'slot')}; mean AoI "
            f"{metric_mean(record.mean('mean_aoi'), 'mean_aoi')}."
        ),
        command=results.command,
        episode=episode,
    )


def episode_of(record: Record) -> Trajectory | None:
    """The episode of a record, which was checked when it was read; None where it has none."""
    if record.episode is None:
        return None
    kept: dict[str, Any] = {
        field.name: record.episode.get(field.name) for field in fields(Trajectory)
    }
    return Trajectory(**kept)


def metrics_table(
    results: Results,
    key: str,
    title: str,
    series: Sequence[str],
    metrics: Sequence[str] = TABLED,
) -> Table:
    """Metrics with their intervals, a row for each series and place on the axis."""
    shown = [name for name in series if results.records(name)]
    rows = [
        (
            name,
            results.place_text(place),
            *(_metric_text(results, name, place, metric) for metric in metrics),
        )
        for place in results.places()
        for name in shown
        if results.records(name, place)
    ]
    return Table(
        key=key,
        title=title,
        caption=protocol(results, shown),
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
