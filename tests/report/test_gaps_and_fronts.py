"""Gaps to bounds and to the best known, and fronts of freshness against fairness."""

import itertools
import math

import pytest
from fake_results import record, results
from hypothesis import given
from hypothesis import strategies as st

from iout_marl.report.build import build_report
from iout_marl.report.document import Table
from iout_marl.report.figure import Plot
from iout_marl.report.fronts import Point, front_section, pareto_front
from iout_marl.report.gaps import best_known, gap_lead, gap_section, gaps_of
from iout_marl.report.markdown import render_markdown


def cell(series, policy, place, seed, mean_aoi, world, jain=0.9):
    samples = {"mean_aoi": mean_aoi, "jain": jain}
    made = record(policy, place, seed, samples).model_copy(update={"world_hash": world})
    if policy == "bound":
        made = made.model_copy(update={"samples": {"mean_aoi": [mean_aoi]}})
    return ("group", series, place, made)


#: One world at 3 nodes, with three trainings; two layouts at 5, a training each.
CELLS = [
    cell("bound", "bound", 3, 0, 2.0, "a"),
    cell("planner", "planner", 3, 0, 2.5, "a"),
    cell("PPO", "ppo", 3, 0, 2.4, "a"),
    cell("PPO", "ppo", 3, 1, 3.0, "a"),
    cell("PPO", "ppo", 3, 2, 2.6, "a"),
    cell("bound", "bound", 5, 0, 4.0, "b"),
    cell("bound", "bound", 5, 1, 5.0, "c"),
    cell("planner", "planner", 5, 0, 4.0, "b"),
    cell("planner", "planner", 5, 1, 5.5, "c"),
    cell("PPO", "ppo", 5, 0, 5.0, "b"),
    cell("PPO", "ppo", 5, 1, 6.0, "c"),
    cell("elsewhere", "greedy", 5, 0, 1.0, "d"),
]


@pytest.fixture(scope="module")
def made():
    return results(CELLS, report="plain")


def items(section, kind):
    return [item for item in section.items if isinstance(item, kind)]


def test_best_known_is_the_lowest_of_all_series_in_the_same_world(made):
    assert best_known(made) == {"a": 2.4, "b": 4.0, "c": 5.5, "d": 1.0}


def test_gaps_are_those_of_each_run_in_its_own_world(made):
    alone = gaps_of(made, "bound", "PPO", 3)
    assert alone.above_bound.median == pytest.approx(30)
    assert (alone.above_bound.least, alone.above_bound.largest) == pytest.approx((20, 50))
    assert alone.above_best_known.median == pytest.approx(100 * (2.6 / 2.4 - 1))
    layouts = gaps_of(made, "bound", "PPO", 5)
    assert (layouts.above_bound.least, layouts.above_bound.largest) == pytest.approx((20, 25))
    assert layouts.above_best_known.largest == pytest.approx(25)
    assert gaps_of(made, "bound", "elsewhere", 5) is None


def test_table_and_figure_of_gaps(made):
    section = gap_section(made)
    (table,), (figure,) = items(section, Table), items(section, Plot)
    rows = {(row[0], row[1]): row for row in table.rows}
    assert rows["planner", "3"][3:] == ("2.000", "2.400", "25\u00a0%", "4.2\u00a0%")
    assert rows["PPO", "5"][3:5] == ("4.500", "4.750")
    assert rows["PPO", "5"][5] == "22\u00a0% (20 to 25)"
    assert not any("elsewhere" in row or "bound" in row for row in table.rows)
    best = {table.rows[row][:2] for row, column in table.marked}
    assert best == {("PPO", "3"), ("planner", "5")}
    planner = next(line for line in figure.lines if line.name == "planner")
    assert planner.y == pytest.approx((25, 5))
    assert math.isnan(planner.low[0])
    assert planner.low[1] == pytest.approx(0.1)  # 0 % has no place on the axis
    assert figure.y.limits[0] < 0.1  # where the whisker ends is seen


def test_report_begins_with_how_near_the_trained_come_and_takes_no_bound_for_a_policy(made):
    assert gap_lead(made) == [
        "PPO: 22 to 30\u00a0% above the certified bound, 8.3 to 17\u00a0% above the best known."
    ]
    text = render_markdown(build_report(made), "figures")
    assert "The lowest mean AoI, 1.00, is that of elsewhere" in text
    assert "bound: certified, no policy's mean AoI is lower." in text
    assert "| bound | 3 | 2.00 | – | – | – |" in text


def test_each_series_of_bounds_has_gaps_of_its_own_and_runs_without_one_are_left_out():
    more = [
        cell("low bound", "bound", 3, 0, 1.5, "a"),
        cell("PPO", "ppo", 3, 3, 9.0, "unbounded"),
    ]
    made = results([*CELLS, *more], report="plain")
    assert gaps_of(made, "bound", "PPO", 3).above_bound.median == pytest.approx(30)
    low = gaps_of(made, "low bound", "PPO", 3)
    assert low.above_bound.median == pytest.approx(100 * (2.6 / 1.5 - 1))
    assert (low.runs, low.mean_aoi.mean) == (3, pytest.approx(8 / 3))
    tables = items(gap_section(made), Table)
    assert ["Left out: 1 run in worlds" in table.caption for table in tables] == [True, True]
    assert [row[3] for row in tables[1].rows] == ["1.500", "1.500"]


def test_certified_figures_are_rounded_down_and_small_differences_are_none():
    made = results(
        [
            cell("bound", "bound", 3, 0, 8 / 3, "a"),
            cell("one", "planner", 3, 0, 3.0, "a"),
            cell("other", "planner", 3, 0, 3.000001, "a"),
        ],
        report="plain",
    )
    (table,) = items(gap_section(made), Table)
    assert [row[3] for row in table.rows] == ["2.666", "2.666"]
    assert [row[6] for row in table.rows] == ["0.0\u00a0%", "0.0\u00a0%"]
    assert table.marked == {(0, 4), (1, 4)}
    assert "| bound | 3 | 2.66 |" in render_markdown(build_report(made), "figures")


def test_a_study_of_bounds_alone_has_no_empty_figures():
    report = build_report(results([CELLS[0]], report="plain"))
    assert [figure.key for figure in report.figures()] == ["mean_aoi"]


def test_captions_of_gaps_and_fronts_tell_of_no_interval(made):
    sections = gap_section(made), front_section(made.model_copy(update={"front": True}))
    captions = [item.caption for section in sections for item in section.items]
    assert len(captions) == 2 + 8
    assert not any("95 %" in caption for caption in captions)
    assert "PPO: 3 trainings, 1 episode each." in captions[0]


def test_nothing_is_said_of_gaps_where_there_is_no_bound():
    made = results([c for c in CELLS if c[1] != "bound"], report="plain")
    assert not gap_section(made).items
    assert gap_lead(made) == []
    assert "bound" not in render_markdown(build_report(made), "figures")


points = st.lists(
    st.builds(Point, st.just("s"), st.just(0), *[st.integers(0, 6).map(float)] * 2), min_size=1
)


@given(points)
def test_front_is_what_nothing_dominates(found):
    def dominates(a, b):
        return (a.jain, -a.mean_aoi) != (b.jain, -b.mean_aoi) and (
            a.jain >= b.jain and a.mean_aoi <= b.mean_aoi
        )

    front = pareto_front(found)
    assert set(front) == {p for p in found if not any(dominates(q, p) for q in found)}
    for first, second in itertools.pairwise(front):
        assert first.jain < second.jain
        assert first.mean_aoi < second.mean_aoi


def test_fronts_are_drawn_world_by_world_and_tell_what_their_product_prefers():
    made = results(
        [
            cell("w = 0", "ppo", 3, 0, 4.0, "a", jain=0.9),
            cell("w = 0", "ppo", 3, 1, 4.5, "a", jain=0.8),
            cell("w = 9", "ppo", 3, 0, 5.0, "a", jain=1.0),
            cell("w = 9", "ppo", 3, 1, 30.0, "a", jain=1.0),
            cell("w = 0", "ppo", 5, 0, 7.0, "b", jain=0.9),
        ],
        report="plain",
    )
    assert not front_section(made).items
    section = front_section(made.model_copy(update={"front": True}))
    first, second = items(section, Plot)
    assert [line.name for line in first.lines] == ["Pareto front", "w = 0", "w = 9"]
    assert (first.lines[0].x, first.lines[0].y) == ((0.9, 1.0), (4.0, 5.0))
    assert [line.name for line in second.lines] == ["Pareto front", "w = 0"]
    table = items(section, Table)[0]
    assert table.rows == (
        ("w = 0", "0", "0.9000", "4.00", "0.4000"),
        ("w = 9", "0", "1.0000", "5.00", "0.0000"),
    )
    told = section.paragraphs[1]
    assert section.paragraphs[2].startswith(
        "paper/k5: the least (1 − J) · mean AoI is that of the freshest, a run of w = 0"
    )
    assert "mean AoI is that of a run of w = 9 (mean AoI 5.00, J 1.0000" in told
    assert "2 runs have a Jain's index of 1.000; their mean AoI goes from 5.00 to 30.00" in told
