"""Beyond the paper: which reward a practitioner should use, with numbers."""

from __future__ import annotations

from dataclasses import dataclass

from iout_marl.evaluation import Estimate
from iout_marl.report.checks import Check, symbol
from iout_marl.report.content import Table
from iout_marl.report.measures import metric as metric_text
from iout_marl.report.measures import percent, reduction
from iout_marl.report.names import BEST_FDD, BEST_TDD, FDD, TDD
from iout_marl.study.results import Results

#: Mode, the paper's reward, the mean-AoI reward, and groups with single changes of it.
MODES = (
    ("TDD", TDD, BEST_TDD, ("terms-tdd", "parts-tdd")),
    ("FDD", FDD, BEST_FDD, ("terms-fdd",)),
)
METRICS = ("mean_aoi", "harvested_kj", "jain", "age_violations")
HEADINGS = ("Mean AoI", "Harvested kJ", "Jain's index", "Node-slots above A_max")


def terms_table(results: Results) -> Table | None:
    """The paper's reward without each of its terms, beside the whole one."""
    rows: list[tuple[str, ...]] = []
    marked = set()
    for mode, whole, best, groups in MODES:
        changed = [name for group in groups for name in results.group_series(group)]
        places = sorted({place for name in changed for place in results.places(name)})
        for place in places:
            base = results.measured(whole, place, "mean_aoi")
            for name in (whole, *changed, best):
                own = results.measured(name, place, "mean_aoi")
                if own is None:
                    continue
                change = ""
                if base is not None and name != whole:
                    share = reduction(own, base)
                    change = percent(share)
                    if _above_zero(share):
                        marked.add((len(rows), 3))
                label = "the paper's reward" if name == whole else _label(name, mode)
                values = [metric_text(results.measured(name, place, m), m) for m in METRICS]
                rows.append((f"{mode}: {label}", f"{place:g}", values[0], change, *values[1:]))
    if not rows:
        return None
    return Table(
        key="reward-terms",
        title="The paper's reward without each of its terms",
        caption=(
            "One change at a time, everything else as in the paper's reward; three trainings "
            "each unless the study says otherwise, mean and 95 % interval over seeds. The "
            "reduction of mean AoI is against the paper's whole reward; where its whole interval "
            "lies above 0 it stands out."
        ),
        command=results.command,
        columns=("Reward", results.axis.label, HEADINGS[0], "Reduction of AoI", *HEADINGS[1:]),
        rows=tuple(rows),
        numeric=frozenset(range(1, 7)),
        marked=frozenset(marked),
    )


def _label(name: str, mode: str) -> str:
    if name in (BEST_TDD, BEST_FDD):
        return "mean AoI alone" + (" and the better β rule" if mode == "TDD" else "")
    return name.removeprefix(f"{mode} ")


@dataclass(frozen=True)
class Comparison:
    """The mean-AoI reward against the paper's, in one mode.

    Attributes:
        mode: TDD or FDD.
        reductions: of mean AoI at each place, with intervals, as text.
        smallest, largest: of them, in percent.
        fresher: at how many places the whole interval lies above 0.
        places: how many places there are.
        fairness: lowest Jain's index over seeds: of the paper's reward, and of mean AoI.
        late: node-slots above A_max over all seeds, of each.
    """

    mode: str
    reductions: str
    smallest: float
    largest: float
    fresher: int
    places: int
    fairness: tuple[float, float]
    late: tuple[float, float]


def compare(results: Results) -> list[Comparison]:
    """The mean-AoI reward against the paper's."""
    found = []
    for mode, paper, best, _ in MODES:
        parts, shares = [], []
        for place in results.places():
            a, b = (results.measured(name, place, "mean_aoi") for name in (best, paper))
            if a is None or b is None:
                continue
            share = reduction(a, b)
            shares.append(share)
            parts.append(f"{symbol(results, place)}: {percent(share)}")
        if not parts:
            continue
        found.append(
            Comparison(
                mode,
                "; ".join(parts),
                100 * min(share.mean for share in shares),
                100 * max(share.mean for share in shares),
                sum(map(_above_zero, shares)),
                len(shares),
                (_lowest_jain(results, paper), _lowest_jain(results, best)),
                (_total(results, paper), _total(results, best)),
            )
        )
    return found


def _above_zero(share: Estimate) -> bool:
    return Check.positive("", share).holds


def _lowest_jain(results: Results, series: str) -> float:
    return min(v for r in results.records(series) for v in r.samples["jain"])


def _total(results: Results, series: str) -> float:
    return float(sum(r.mean("age_violations") for r in results.records(series)))


def _judgement(c: Comparison, minimum_jain: float) -> str:
    """Which reward to use: the fresher one, unless it breaks the paper's constraints more."""
    what = "mean AoI alone" + (" with the better β rule" if c.mode == "TDD" else "")
    fair = c.fairness[1] >= min(minimum_jain, c.fairness[0])
    timely = c.late[1] <= c.late[0]
    if not c.fresher:
        return f"keep the paper's reward: {what} is nowhere measurably fresher"
    where = "at every K" if c.fresher == c.places else f"at {c.fresher} of {c.places} K"
    by = f"by {c.smallest:.0f} to {c.largest:.0f} %" if c.places > 1 else f"by {c.largest:.0f} %"
    verb = "train on" if c.fresher == c.places else "where it is fresher, train on"
    fresh = f"{verb} {what}: mean AoI is lower {where}, {by}"
    if fair and timely:
        return f"{fresh}, and no constraint of the paper is broken more"
    price = " and ".join(([] if fair else ["fairness"]) + ([] if timely else ["ages above A_max"]))
    return f"{fresh}, at a price in {price}"


def judgements(results: Results, minimum_jain: float = 0.85) -> list[str]:
    """The advice in a sentence for each mode."""
    return [f"{c.mode}: {_judgement(c, minimum_jain)}." for c in compare(results)]


def advice(results: Results, minimum_jain: float = 0.85) -> list[str]:
    """The advice with its numbers."""
    return [
        f"{c.mode}: {_judgement(c, minimum_jain)}. Reduction of mean AoI against the paper's "
        f"reward: {c.reductions}. Lowest Jain's index of any seed: {c.fairness[1]:.3f}, with the "
        f"paper's reward {c.fairness[0]:.3f} (J_min is {minimum_jain:g}); node-slots above "
        f"A_max over all seeds: {c.late[1]:.0f}, with the paper's {c.late[0]:.0f}."
        for c in compare(results)
    ]
