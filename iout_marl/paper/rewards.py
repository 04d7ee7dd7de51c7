"""Beyond the paper: which reward a practitioner should use, with numbers."""

from __future__ import annotations

from dataclasses import dataclass

from iout_marl.evaluation import Estimate
from iout_marl.paper.checks import Check, symbol
from iout_marl.paper.names import BEST_FDD, BEST_TDD, FDD, TDD
from iout_marl.report.document import Table
from iout_marl.report.measures import (
    fixed,
    percent,
    reduction,
    samples,
)
from iout_marl.report.measures import metric as metric_text
from iout_marl.report.study_figures import protocol
from iout_marl.study.results import Results
from iout_marl.words import counted

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
    marked, shown = set(), []
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
                    if Check.positive("", share).holds:
                        marked.add((len(rows), 3))
                shown.append(name)
                label = "the paper's reward" if name == whole else _label(name, mode)
                values = [metric_text(results.measured(name, place, m), m) for m in METRICS]
                rows.append(
                    (f"{mode}: {label}", results.place_text(place), values[0], change, *values[1:])
                )
    if not rows:
        return None
    return Table(
        key="reward-terms",
        title="The paper's reward without each of its terms",
        caption=(
            "One change at a time, everything else as in the paper's reward. The reduction of "
            "mean AoI is against the paper's whole reward; where its whole interval lies above 0 "
            f"it stands out. {protocol(results, shown)}"
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
class Place:
    """The mean-AoI reward against the paper's at one place on the axis.

    Attributes:
        where: `K = 3`.
        reduction: of mean AoI, with its interval.
        unfair: trainings that end below J_min: by the paper's reward, and by mean AoI.
        late: node-slots above A_max over all trainings, of each.
        trainings: how many there are of each.
        fairness: lowest Jain's index of each.
    """

    where: str
    reduction: Estimate
    unfair: tuple[int, int]
    late: tuple[float, float]
    trainings: tuple[int, int]
    fairness: tuple[float, float]

    @property
    def is_fresher(self) -> bool:
        """Whether mean AoI is lower by the whole interval."""
        return Check.positive("", self.reduction).holds

    def prices(self) -> list[str]:
        """What the mean-AoI reward breaks more here."""
        found = []
        if self.unfair[1] > self.unfair[0]:
            found.append(
                f"fairness below J_min in {self.unfair[1]} of "
                f"{counted(self.trainings[1], 'training')} at "
                f"{self.where} ({self.unfair[0]} of {self.trainings[0]} with the paper's reward)"
            )
        if self.late[1] > self.late[0]:
            found.append(
                f"{fixed(self.late[1], 0)} node-slots above A_max at {self.where} "
                f"({fixed(self.late[0], 0)} with the paper's reward)"
            )
        return found


def compare(results: Results) -> dict[str, list[Place]]:
    """The mean-AoI reward against the paper's, by mode and place."""
    found: dict[str, list[Place]] = {}
    for mode, paper, best, _ in MODES:
        for place in results.places():
            a, b = (results.measured(name, place, "mean_aoi") for name in (best, paper))
            if a is None or b is None:
                continue
            both = [results.records(name, place) for name in (paper, best)]
            jain = [samples(records, "jain") for records in both]
            if not all(jain):
                continue
            unfair = [sum(max(samples([r], "jain_violation")) > 0 for r in rs) for rs in both]
            late = [sum(r.mean("age_violations") for r in records) for records in both]
            found.setdefault(mode, []).append(
                Place(
                    symbol(results, place),
                    reduction(a, b),
                    (unfair[0], unfair[1]),
                    (late[0], late[1]),
                    (len(both[0]), len(both[1])),
                    (min(jain[0]), min(jain[1])),
                )
            )
    return found


def _judgement(mode: str, places: list[Place]) -> str:
    """Which reward to use, and at what price; of single trainings, provisionally."""
    single = any(min(place.trainings) < 2 for place in places)
    return f"{'provisionally (one seed), ' if single else ''}{_advised(mode, places)}"


def _advised(mode: str, places: list[Place]) -> str:
    what = "mean AoI alone" + (" with the better β rule" if mode == "TDD" else "")
    fresher = [place for place in places if place.is_fresher]
    if not fresher:
        return f"keep the paper's reward: {what} is nowhere measurably fresher"
    shares = [100 * place.reduction.mean for place in fresher]
    everywhere = len(fresher) == len(places)
    where = "at every K" if everywhere else "at " + ", ".join(place.where for place in fresher)
    ends = dict.fromkeys(fixed(end, 0) for end in (min(shares), max(shares)))
    by = f"by {' to '.join(ends)} %"
    fresh = f"train on {what}: mean AoI is lower {where}, {by}"
    prices = [price for place in places for price in place.prices()]
    if not prices:
        return f"{fresh}, and no constraint of the paper is broken more at any K"
    return f"{fresh}, at a price: {'; '.join(prices)}"


def judgements(results: Results) -> list[str]:
    """The advice in a sentence for each mode."""
    return [f"{mode}: {_judgement(mode, places)}." for mode, places in compare(results).items()]


def advice(results: Results) -> list[str]:
    """The advice with its numbers."""
    lines = []
    for mode, places in compare(results).items():
        shares = "; ".join(f"{p.where}: {percent(p.reduction)}" for p in places)
        fairness = "; ".join(
            f"{p.where}: {fixed(p.fairness[1], 3)} ({fixed(p.fairness[0], 3)})" for p in places
        )
        late = "; ".join(
            f"{p.where}: {fixed(p.late[1], 0)} ({fixed(p.late[0], 0)})" for p in places
        )
        lines.append(
            f"{mode}: {_judgement(mode, places)}. Reduction of mean AoI against the paper's "
            f"reward: {shares}. Lowest Jain's index of any training, in brackets with the "
            f"paper's reward: {fairness}. Node-slots above A_max likewise: {late}."
        )
    return lines
