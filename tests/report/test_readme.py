"""Figures of the README are those of committed results and of the benchmarks' page."""

import re
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from iout_marl.paper.claims import answers
from iout_marl.report.gaps import gaps_of
from iout_marl.report.measures import number
from iout_marl.study.results import read_results

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BENCHMARKS = (ROOT / "benchmarks" / "README.md").read_text(encoding="utf-8")
SERIES = (
    *("random-walk", "greedy (FDD)"),
    *("PPO-TDD", "Mean-AoI TDD", "PPO-FDD", "Mean-AoI FDD"),
)


@pytest.fixture(scope="module")
def paper():
    return read_results(ROOT / "docs" / "results" / "results.json")


@pytest.mark.slow
def test_the_table_of_results(paper):
    rows = []
    for series in SERIES:
        measured = (paper.measured(series, k, "mean_aoi").estimate for k in (3, 5, 7, 10))
        rows.append(f"| {' | '.join([series, *(number(figure, 2) for figure in measured)])} |")
    assert re.findall(r"^\| .*\d \(.*\|$", README, re.MULTILINE) == rows


@pytest.mark.slow
def test_the_count_of_claims(paper):
    counts = Counter(answer.verdict for answer in answers(paper).answers)
    verdicts = ("reproduced", "reproduced in part", "left open", "not reproduced")
    found = [counts[verdict] for verdict in verdicts]
    assert (
        f"paper's {sum(found)} claims {found[0]} hold, {found[1]} in part, {found[2]} are left "
        f"open, {found[3]} do not"
    ) in README.replace("\n", " ")


@pytest.mark.slow
def test_the_gaps_to_the_bound():
    gap = read_results(ROOT / "docs" / "gap" / "results.json")

    def above_bound(place, family):
        """In percent: the median over trainings."""
        found = gaps_of(gap, f"bound, {family}", f"PPO, {family}", place)
        return re.match(r"[\d.]+", found.above_bound.text()).group()

    single = [above_bound(k, "FDD") for k in (5, 7, 10)]
    teams = [above_bound(10, f"{auvs} AUVs, FDD") for auvs in (2, 3)]
    text = README.replace("\n", " ")
    assert "{}, {} and {} % of the certified bound at K = 5, 7 and 10".format(*single) in text
    assert "teams of two and three within {} and {} %".format(*teams) in text


def test_the_figures_of_speed():
    text = README.replace("\n", " ")
    target, world, ours, theirs = re.search(
        r"mean AoI ([\d.]+) on `(\S+)` takes ([\d.]+) s on one core, "
        r"Stable-Baselines3 at its best ([\d.]+) s",
        text,
    ).groups()
    table = BENCHMARKS.split(f"{world}: seconds to a mean AoI of {target},")[1].split("```")[0]
    medians = {
        line[:36].strip(): float(line[36:].split()[1])
        for line in table.splitlines()
        if re.match(r".{36}\s+\d+ +[\d.]+ ", line)
    }
    others = [seconds for name, seconds in medians.items() if name != "this trainer"]
    assert medians["this trainer"] == float(ours)
    assert np.min(others) == float(theirs)
    count, *slots = re.search(
        r"([\d,]+) environments play ([\d,]+) slots a second, compiled ([\d,]+) ", text
    ).groups()
    row = rf"^paper/k10-fdd, World x {count.replace(',', '')} +{slots[0]} +{slots[1]} "
    assert re.search(row, BENCHMARKS, re.MULTILINE)
