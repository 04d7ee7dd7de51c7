"""Figures and tables of any study: metrics over the axis, learning curves, paths, cells."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from iout_marl.bounds import rounded_down
from iout_marl.episode import Episode
from iout_marl.evaluation import Estimate
from iout_marl.report.content import Line, Plot, Table, Trajectory
from iout_marl.report.measures import METRIC_DIGITS, place_text
from iout_marl.report.measures import metric as metric_text
from iout_marl.study.results import Measured, Record, Results

#: Metrics that are drawn and tabled: heading, and what its unit is.
HEADINGS = {
    "mean_aoi": "Mean AoI in slots",
    "final_aoi": "Final AoI in slots",
    "peak_aoi": "Peak AoI in slots",
    "harvested_kj": "Energy harvested in kJ",
    "jain": "Jain's index",
    "uplink_success": "Uplinks that arrive",
    "age_violations": "Ages above A_max",
}
#: What a curve of a training is called.
CURVE_HEADINGS = {
    "aoi/mean": "Mean AoI in slots",
    "reward/total": "Mean reward of a slot",
    "fairness/jain": "Jain's index",
    "energy/harvested_kj": "Energy harvested in kJ",
}

#: What every figure of a training shows.
LEARNING = (
    "Episodes that ended in each rollout, actions sampled from the policy as it learns; mean "
    "over seeds, and the range of the seeds."
)


def protocol(results: Results, series: Sequence[str], *, intervals: bool = True) -> str:
    """Seeds, episodes and what the intervals are of, if any, for the caption of a figure."""
    groups: dict[tuple[bool, int, int], list[str]] = {}
    bounds = list(filter(results.is_bound, series))
    for name in series:
        if name in bounds:
            continue
        records = results.records(name)
        seeds = max(len(results.records(name, place)) for place in results.places(name))
        groups.setdefault((records[0].training is not None, seeds, records[0].episodes), []).append(
            name
        )
    sentences = []
    for (trained, seeds, episodes), names in groups.items():
        who = _listed(names) if len(groups) > 1 else "Every series"
        runs = f"{seeds} {'training' if trained else 'run'}{'s' if seeds > 1 else ''}"
        times = f"{episodes} episode{'s' if episodes > 1 else ''}"
        what = f"{runs}, {times} each" if seeds > 1 else f"{runs}, {times}"
        if seeds > 1:
            interval = "95 % interval of the mean over seeds"
        elif episodes > 1:
            interval = "95 % interval of the mean over episodes"
        else:
            interval = "a single episode, without an interval"
        sentences.append(f"{who}: {what}" + (f"; {interval}." if intervals else "."))
    if bounds:
        sentences.append(f"{_listed(bounds)}: certified, no policy's mean AoI is lower.")
    return " ".join(sentences)


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
    """Bars of a metric, by series, over the axis."""
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
                colour=colour,
            )
        )
    return Plot(
        key=key,
        title=title,
        caption=" ".join(part for part in (remark, protocol(results, shown)) if part),
        command=results.command,
        x_label=results.axis.label,
        y_label=HEADINGS[metric],
        lines=tuple(lines),
        kind="bars",
        categories=True,
    )


def learning_figure(
    results: Results, key: str, title: str, curve: str, series: Sequence[str], remark: str = ""
) -> Plot:
    """A quantity over environment steps, one line for each series and place on the axis."""
    lines: list[Line] = []
    for name in series:
        for place in results.places(name):
            records = [r for r in results.records(name, place) if r.training]
            if records:
                label = _place_label(results, name, place, series)
                lines.append(_learning_line(label, records, curve, colour=len(lines)))
    return Plot(
        key=key,
        title=title,
        caption=f"{remark} {LEARNING}".strip(),
        command=results.command,
        x_label="Environment steps",
        y_label=CURVE_HEADINGS[curve],
        lines=tuple(lines),
    )


def _place_label(results: Results, name: str, place: float, series: Sequence[str]) -> str:
    symbol = {"nodes.count": "K", "auvs.count": "M"}.get(results.axis.key, results.axis.key)
    where = f"{symbol} = {place_text(place)}"
    return where if len(series) == 1 else f"{name}, {where}"


def curves(records: Sequence[Record], curve: str) -> tuple[list[float], npt.NDArray[np.float64]]:
    """Environment steps, and the curve of every training among the records, (seeds, steps)."""
    found = [r.training.curve for r in records if r.training]
    shortest = min((len(c["env_steps"]) for c in found), default=0)
    steps = found[0]["env_steps"][:shortest] if found else []
    return steps, np.array([c[curve][:shortest] for c in found])


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
    records = [r for r in results.records(series, place) if r.episode]
    if not records or records[0].episode is None:
        return None
    record = records[0]
    episode = Episode(**records[0].episode)
    deliveries = sum(slot[0] for slot in episode.delivered)
    return Trajectory(
        key=key,
        title=f"Path of {series} with {record.nodes} nodes",
        caption=(
            f"One episode of the deterministic policy of seed {record.seed} on "
            f"{record.scenario} ({record.scenario_hash}): {deliveries} of "
            f"{len(episode.delivered)} slots deliver a packet; mean AoI "
            f"{record.mean('mean_aoi'):.2f}."
        ),
        command=results.command,
        grid=(episode.grid[0], episode.grid[1], episode.grid[2]),
        spacing_m=episode.spacing_m,
        nodes=tuple((n[0], n[1], n[2]) for n in episode.nodes),
        path=tuple((p[0][0], p[0][1], p[0][2]) for p in episode.path),
        charged=tuple(slot[0] for slot in episode.charged),
        heard=tuple(slot[0] for slot in episode.heard),
        delivered=tuple(slot[0] for slot in episode.delivered),
        ages=tuple(tuple(slot) for slot in episode.ages),
    )


def metrics_table(
    results: Results,
    key: str,
    title: str,
    series: Sequence[str],
    metrics: Sequence[str] = ("mean_aoi", "harvested_kj", "jain", "age_violations"),
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
        columns=("Series", results.axis.label, *(HEADINGS[metric] for metric in metrics)),
        rows=tuple(rows),
        numeric=frozenset(range(1, len(metrics) + 2)),
    )


def _metric_text(results: Results, series: str, place: float, metric: str) -> str:
    measured = results.measured(series, place, metric)
    if measured is not None and results.is_bound(series):
        return rounded_down(measured.mean, METRIC_DIGITS[metric])
    return metric_text(measured, metric)


def seconds(results: Results, series: str, place: float) -> Measured | None:
    """Wall-clock seconds of the trainings of a series at a place."""
    values = tuple(r.training.seconds for r in results.records(series, place) if r.training)
    return Measured(values, "seeds") if values else None
