"""The report of the paper's study, as a whole and written down."""

import re
from collections import Counter
from pathlib import Path

import pytest
from fake_results import paper_like, record, results

from iout_marl.report.build import build_report
from iout_marl.report.claims import answers
from iout_marl.report.content import Answers, Plot, Table, Trajectory
from iout_marl.report.markdown import render_markdown
from iout_marl.report.measures import number
from iout_marl.report.names import BEST
from iout_marl.report.page import render_page
from iout_marl.report.paper import COMPARED
from iout_marl.report.rewards import advice, judgements
from iout_marl.study import expand, load_study
from iout_marl.study.results import read_results

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def report():
    return build_report(paper_like())


def items(report, kind):
    return [i for section in report.sections for i in section.items if isinstance(i, kind)]


def test_every_figure_and_table_of_the_paper_is_there(report):
    figures = {figure.key for figure in report.figures()}
    assert {"energies", "beta-star", "aoi", "energy", "jain"} <= figures
    assert {f"learning-{what}-{mode}" for what in ("aoi", "reward") for mode in ("tdd", "fdd")} <= (
        figures
    )
    assert {figure.key for figure in items(report, Trajectory)} == {"path-tdd", "path-fdd"}
    tables = {table.key for table in items(report, Table)}
    assert {"energy-table", "cost", "hyperparameters", "constraints", "cells"} <= tables
    assert len(items(report, Answers)) == 1


def test_bars_show_means_and_intervals_of_every_series(report):
    bars = next(f for f in report.figures() if f.key == "aoi")
    assert [line.name for line in bars.lines] == [
        *("random-walk", "round-robin", "greedy", "PPO-TDD", "PPO-FDD")
    ]
    for line in bars.lines:
        assert line.x == (3, 5, 7, 10)
        assert all(a < y < b for a, y, b in zip(line.low, line.y, line.high, strict=True))


def test_captions_say_seeds_episodes_and_what_the_interval_is_of(report):
    caption = next(f for f in report.figures() if f.key == "aoi").caption
    assert "1 run, 3 episodes; 95 % interval of the mean over episodes" in caption
    assert "3 trainings, 1 episode each; 95 % interval of the mean over seeds" in caption
    for item in (*items(report, Plot), *items(report, Table), *items(report, Trajectory)):
        assert item.caption
        assert item.command.startswith("iout ")


def test_facts_name_machine_versions_date_and_command(report):
    facts = dict(report.facts)
    assert facts["Machine"] == "A processor, 2 cores, Linux"
    assert facts["Versions"] == "Python 3.11.7"
    assert facts["Date"] == "2026-01-02"
    assert facts["Command"] == "`iout reproduce`"


def test_cost_stands_beside_the_papers(report):
    table = next(t for t in items(report, Table) if t.key == "cost")
    first = table.rows[0]
    assert first[:2] == ("3 nodes TDD", "58 min")
    assert first[3] == f"{58 * 60 / 21:,.0f}"
    assert len(table.rows) == 8


def test_a_report_of_what_little_there_is_can_be_written():
    one = record("ppo", 3, 0, {"mean_aoi": 5.0})
    for made in (results([]), results([("tdd", "PPO-TDD", 3, one)])):
        for kind in ("paper", "plain"):
            built = build_report(made.model_copy(update={"report": kind}))
            assert "<html" in render_page(built)
            assert built.title in render_markdown(built, "figures")


def test_advice_follows_the_figures():
    better = judgements(paper_like())
    assert better[0].startswith("TDD: train on mean AoI alone with the better β rule")
    assert "and no constraint of the paper is broken more" in better[0]

    def unfair(name, place, seed, metrics):
        return {**metrics, "jain": [0.6]} if name == "Mean-AoI FDD" else metrics

    assert judgements(paper_like(unfair))[1].endswith("at a price in fairness.")

    def late(name, place, seed, metrics):
        return {**metrics, "age_violations": [7.0]} if name == "Mean-AoI FDD" else metrics

    assert judgements(paper_like(late))[1].endswith("at a price in ages above A_max.")

    def stale(name, place, seed, metrics):
        worse = {**metrics, "mean_aoi": [50.0 + seed]}
        return worse if name == "Mean-AoI FDD" else metrics

    assert judgements(paper_like(stale))[1].startswith("FDD: keep the paper's reward")
    assert all(len(line) > 100 for line in advice(paper_like()))


def test_markdown_keeps_its_tables_whatever_stands_in_a_cell():
    table = Table(
        "t", "T", "c", "iout", ("a|b", "c"), (("x|y", "<b>"), ("1", "2*")), marked={(1, 1)}
    )
    report = build_report(results([]))
    section = type(report.sections[0])("s", "S", items=(table,))
    text = render_markdown(type(report)("R", (), (), (section,)), "figures")
    rows = [line for line in text.splitlines() if line.startswith("|")][2:]
    assert all(len(re.findall(r"(?<!\\)\|", row)) == 3 for row in rows)
    assert "**2\\*" in rows[-1]


def test_the_committed_results_are_of_the_study_as_it_stands():
    made = read_results(ROOT / "docs" / "results" / "results.json")
    cells = expand(*load_study("paper"))
    assert [cell.record.key for cell in made.cells] == [cell.key for cell in cells]


def test_the_reproduction_page_is_that_of_the_committed_results():
    folder = ROOT / "docs" / "results"
    made = read_results(folder / "results.json")
    assert made.failures == ()
    assert not made.quick
    text = render_markdown(build_report(made), "results/figures")
    assert text == (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")
    pictures = re.findall(r"\]\((results/figures/[^)]+)\)", text)
    assert pictures
    assert all((ROOT / "docs" / picture).is_file() for picture in pictures)
    assert (folder / "results.csv").read_text(encoding="utf-8") == made.to_csv()


def test_the_readmes_table_is_of_the_committed_results():
    made = read_results(ROOT / "docs" / "results" / "results.json")
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    for series in (*COMPARED, *BEST, "greedy (FDD)"):
        found = [made.measured(series, place, "mean_aoi") for place in made.places()]
        cells = [number(measured.estimate, 2) for measured in found]
        assert f"| {series} | {' | '.join(cells)} |" in text
    counts = Counter(answer.verdict for answer in answers(made).answers)
    told = re.search(r"(\d+) claims hold, (\d+) in part, (\d+) not", text)
    assert [int(n) for n in told.groups()] == [
        counts[verdict] for verdict in ("reproduced", "reproduced in part", "not reproduced")
    ]
