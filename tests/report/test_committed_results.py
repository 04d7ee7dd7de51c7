"""The committed results, and the pages that are made of them."""

import functools
import re
from pathlib import Path

import numpy as np
import pytest

from iout_marl import load_scenario
from iout_marl.bounds import delivery_bound, rounded_down
from iout_marl.report.build import build_report
from iout_marl.report.fronts import front_section
from iout_marl.report.gaps import gaps_of
from iout_marl.report.markdown import render_markdown
from iout_marl.report.measures import metric as metric_text
from iout_marl.report.measures import number
from iout_marl.study import expand, load_study
from iout_marl.study.results import read_results

DOCS = Path(__file__).parents[2] / "docs"

#: By name of the study: the folder of its results, and its page.
COMMITTED = {
    "paper": ("results", "reproduction.md"),
    "multi": ("multi", "multi-auv-results.md"),
    "gap": ("gap", "gap-results.md"),
    "fairness": ("fairness", "fairness-results.md"),
    "bay": ("bay", "bay-results.md"),
    "sea": ("sea", "sea-results.md"),
}
#: Of these only tables are shown, in pages of other names.
TABLED = ("pretrained", "sea-life", "sea-deployments")


@functools.cache
def committed(name):
    """The results in a folder of `docs/`; whoever is given them changes nothing."""
    return read_results(DOCS / name / "results.json")


@pytest.mark.slow
@pytest.mark.parametrize("study", [*COMMITTED, *TABLED])
def test_results_are_of_the_study_as_it_stands(study):
    made = committed(COMMITTED[study][0] if study in COMMITTED else study)
    cells = expand(*load_study(study))
    assert [cell.record.key for cell in made.cells] == [cell.key for cell in cells]
    assert made.failures == ()
    assert not made.quick


@pytest.mark.slow
@pytest.mark.parametrize("study", COMMITTED)
def test_page_is_that_of_the_results(study):
    name, page = COMMITTED[study]
    made = committed(name)
    text = render_markdown(build_report(made), f"{name}/figures")
    assert text == (DOCS / page).read_text(encoding="utf-8")
    pictures = re.findall(rf"\]\(({name}/figures/[^)]+)\)", text)
    assert pictures
    assert all((DOCS / picture).is_file() for picture in pictures)
    assert (DOCS / name / "results.csv").read_text(encoding="utf-8") == made.to_csv()


def team_row(made, auvs, nodes):
    """A row of the page's table: bound, PPO, tour, planner and greedy of a team."""
    bound = delivery_bound(load_scenario(f"multi/m{auvs}-k{nodes}-fdd"))
    played = [
        made.measured(f"{name}, K = {nodes}", auvs, "mean_aoi")
        for name in ("PPO", "tour", "planner", "greedy")
    ]
    cells = [number(m.estimate, 2) if m is not None else "–" for m in played]
    return f"| {nodes} | {auvs} | {bound:.2f} | {' | '.join(cells)} |"


def test_the_table_of_teams_is_of_the_results():
    made = committed("multi")
    text = (DOCS / "multi-auv.md").read_text(encoding="utf-8")
    for nodes in (10, 20, 50):
        for auvs in (1, 2, 3, 4):
            assert team_row(made, auvs, nodes) in text


def test_the_table_of_the_bay_is_of_the_results():
    made = committed("bay")
    text = (DOCS / "sea.md").read_text(encoding="utf-8")
    metrics = ("mean_aoi_s", "asleep_share", "stranded_share", "charging_kj", "battery_share")
    for name in ("random-walk", "round-robin", "greedy", "PPO", "tour", "planner", "return"):
        told = [metric_text(made.measured(name, 2000, metric), metric) for metric in metrics]
        assert f"| {name} | {' | '.join(told)} |" in text


@pytest.mark.parametrize("access", ["orthogonal", "exclusive"])
def test_the_table_of_access_rules_is_of_the_results(access):
    made = committed("multi")
    text = (DOCS / "multi-auv.md").read_text(encoding="utf-8")
    for auvs in (2, 3):
        cells = [
            number(made.measured(f"{name}, K = 10, {access}", auvs, "mean_aoi").estimate, 2)
            for name in ("PPO", "tour", "planner")
        ]
        assert f"| `{access}` | {auvs} | {' | '.join(cells)} |" in text


#: Rows of the table of gaps: what each is called, its place, and the end of its series' names.
GAPS = {
    **{f"`best/k{k}-{m}`": (k, m.upper()) for m in ("fdd", "tdd") for k in (3, 5, 7, 10)},
    **{f"`multi/m{m}-k10-fdd`": (10, f"{m} AUVs, FDD") for m in (2, 3)},
    **{
        f"`random/k{k}-{m}`, 20 layouts": (k, f"random {m.upper()}")
        for m in ("fdd", "tdd")
        for k in (3, 5, 7, 10)
    },
}


def gap_row(made, label):
    """A row of the page's table: bound, planner, PPO and its gaps."""
    place, family = GAPS[label]
    bound, planner, ppo = (
        made.measured(f"{name}, {family}", place, "mean_aoi")
        for name in ("bound", "planner", "PPO")
    )
    gaps = gaps_of(made, f"bound, {family}", f"PPO, {family}", place)
    cells = [label, rounded_down(bound.mean, 3), f"{planner.mean:.2f}"]
    cells += [f"{np.median(ppo.samples):.2f}"]
    cells += [spread.text() for spread in (gaps.above_bound, gaps.above_best_known)]
    return f"| {' | '.join(cells)} |"


@pytest.mark.slow
@pytest.mark.parametrize("label", GAPS)
def test_the_table_of_gaps_is_of_the_results(label):
    made = committed("gap")
    assert gap_row(made, label) in (DOCS / "gap.md").read_text(encoding="utf-8")


#: Worlds of the study of fairness.
FRONTS = [f"best/k{k}-{m}" for m in ("fdd", "tdd") for k in (3, 10)]


def front_row(made, world):
    """A row of the page's table: both ends of the front of a world."""
    section = front_section(made)
    title = f"Pareto front: {world}"
    rows = next(item for item in section.items if item.title == title).rows
    ends = [f"{row[0]} | {row[3]} | {row[2]}" for row in (rows[0], rows[-1])]
    return f"| `{world}` | {' | '.join(ends)} |"


@pytest.mark.slow
@pytest.mark.parametrize("world", FRONTS)
def test_the_table_of_fronts_is_of_the_results(world):
    made = committed("fairness")
    assert front_row(made, world) in (DOCS / "gap.md").read_text(encoding="utf-8")
