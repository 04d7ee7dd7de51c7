"""The report of the paper's study, as a whole and written down."""

import re

import pytest
from fake_results import paper_like, record, results

from iout_marl.paper.rewards import advice, judgements
from iout_marl.report.build import build_report
from iout_marl.report.document import Answers, Table
from iout_marl.report.figure import Plot, TrajectoryPlot
from iout_marl.report.markdown import render_markdown
from iout_marl.report.page import render_page


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
    assert {figure.key for figure in items(report, TrajectoryPlot)} == {"path-tdd", "path-fdd"}
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
    for item in (*items(report, Plot), *items(report, Table), *items(report, TrajectoryPlot)):
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


@pytest.mark.slow
def test_a_report_of_what_little_there_is_can_be_written():
    one = record("ppo", 3, 0, {"mean_aoi": 5.0})
    for made in (results([]), results([("tdd", "PPO-TDD", 3, one)])):
        for kind in ("paper", "plain"):
            built = build_report(made.model_copy(update={"report": kind}))
            assert "<html" in render_page(built)
            assert built.title in render_markdown(built, "figures")


def spoiled(series, places=(3, 5, 7, 10), **metrics):
    """A study in which one series has these metrics at these places."""

    def change(name, place, seed, usual):
        here = name == series and place in places
        return {**usual, **{k: [v + seed / 100] for k, v in metrics.items()}} if here else usual

    return paper_like(change)


@pytest.mark.slow
def test_advice_follows_the_figures():
    better = judgements(paper_like())
    assert better[0].startswith("TDD: train on mean AoI alone with the better β rule")
    assert better[0].endswith("and no constraint of the paper is broken more at any K.")
    assert judgements(spoiled("Mean-AoI FDD", mean_aoi=50.0))[1].startswith(
        "FDD: keep the paper's reward"
    )
    some = judgements(spoiled("Mean-AoI FDD", places=(5, 7), mean_aoi=50.0))[1]
    assert "mean AoI is lower at K\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}3, K" in some
    assert all(len(line) > 100 for line in advice(paper_like()))


def test_advice_names_every_place_at_which_a_constraint_is_broken_more():
    late = judgements(spoiled("Mean-AoI FDD", places=(10,), age_violations=7.0))[1]
    assert "at a price: 21 node-slots above A_max at K\N{NO-BREAK SPACE}=" in late
    unfair = {"jain": 0.8, "jain_violation": 0.98}
    found = judgements(spoiled("Mean-AoI TDD", places=(7,), **unfair))[0]
    assert "fairness below J_min in 3 of 3 trainings at K\N{NO-BREAK SPACE}" in found
    assert "(0 of 3 with the paper's reward)" in found


def test_a_break_at_one_place_is_not_hidden_by_a_worse_one_at_another():
    def change(name, place, seed, usual):
        if (name, place) in (("Mean-AoI TDD", 7), ("PPO-TDD", 10)):
            return {**usual, "jain": [0.8 if place == 7 else 0.7], "jain_violation": [1.0]}
        return usual

    assert (
        "trainings at K\N{NO-BREAK SPACE}=\N{NO-BREAK SPACE}7" in judgements(paper_like(change))[0]
    )


def test_the_lead_says_how_trainings_differ_from_the_papers(report):
    told = next(line for line in report.lead if "not trained by the paper's settings" in line)
    assert "PPO-TDD: γ 0.97 (the paper: 0.93)" in told
    assert "learning rate 0.004 (the paper: 0.0003)" in told


@pytest.mark.slow
def test_tables_show_the_settings_and_limits_that_were_used():
    made = paper_like()
    cells = tuple(
        cell.model_copy(
            update={
                "record": cell.record.model_copy(
                    update={
                        "maximum_age": 30.0,
                        "training": cell.record.training
                        and cell.record.training.model_copy(
                            update={
                                "settings": {
                                    **cell.record.training.settings,
                                    "learning_rate": 0.123,
                                }
                            }
                        ),
                    }
                )
            }
        )
        for cell in made.cells
    )
    tables = {
        table.key: table
        for table in items(build_report(made.model_copy(update={"cells": cells})), Table)
    }
    rows = {row[0]: row[1:] for row in tables["hyperparameters"].rows}
    assert rows["Learning rate α"] == ("0.0003", "0.0005", "0.123", "0.123")
    assert "A_max (30 slots)" in tables["constraints"].caption


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
