"""Any results that validate give a report: page, Markdown, pictures; and nothing is raised."""

import re

import plotly.graph_objects as go
import pytest
from any_results import any_results
from fake_results import record, results

from iout_marl.files import parse_json
from iout_marl.report.build import build_report
from iout_marl.report.content import Plot, Table
from iout_marl.report.interactive import plotly_json
from iout_marl.report.markdown import render_markdown
from iout_marl.report.page import render_page
from iout_marl.report.static import draw
from iout_marl.study.results import Failure, Results


def written(made):
    """The report of results, all of it but for the pictures."""
    report = build_report(made)
    for figure in report.figures():
        go.Figure(parse_json(plotly_json(figure)))
    page = render_page(report, {figure.key: b"" for figure in report.figures()})
    text = render_markdown(report, "figures")
    for shown in (re.sub(r"(?s)<script.*?</script>", "", page), text):
        assert not re.search(r"(?<![\w.])-?(nan|inf)\b|-0\.0+(?!\d)", shown)
    return report, page, text


@pytest.mark.parametrize("kind", ["paper", "plain"])
@pytest.mark.parametrize("part", range(4))
def test_results_at_random(kind, part):
    for seed in range(5 * part, 5 * part + 5):
        made = any_results(seed, report=kind)
        Results.model_validate(made.model_dump())
        written(made)


@pytest.mark.parametrize("seed", [14, 30, 52])
def test_pictures_of_results_at_random(seed):
    figures = list(build_report(any_results(seed)).figures())
    for figure in figures[:8]:
        assert set(draw(figure)) == {"png", "svg"}


def test_failures_alone_and_nothing_at_all():
    failure = Failure(series="PPO", axis=3, seed=0, error="it | diverged\n`at` once")
    for kind in ("paper", "plain"):
        made = results([], report=kind)
        written(made)
        report, page, text = written(made.model_copy(update={"failures": (failure,)}))
        assert "it | diverged `at` once" in page
        assert "it \\| diverged \\`at\\` once" in text
        assert "1 failed" in dict(report.facts)["Cells"]


def test_age_0_has_no_gap_in_percent():
    cells = [
        ("g", name, 3, record(policy, 3, 0, {"mean_aoi": aoi}))
        for name, policy, aoi in (("bound", "bound", 0.0), ("a", "greedy", 0.0), ("b", "ppo", 2.0))
    ]
    cells[0] = (*cells[0][:3], cells[0][3].model_copy(update={"samples": {"mean_aoi": [0.0]}}))
    _, _, text = written(results(cells, report="plain"))
    assert "| a | 3 | 0.00 | 0.000 | **0.000** | 0.0\N{NO-BREAK SPACE}% |" in text
    assert "| b | 3 | 2.00 | 0.000 | 0.000 | –\N{NO-BREAK SPACE}% |" in text


def test_a_series_of_many_and_many_series_are_drawn_in_parts():
    cells = [
        ("g", f"series {i}", 3 + i % 2, record("greedy", 3, 0, {"mean_aoi": [i, i + 1]}))
        for i in range(100)
    ]
    report, _, _ = written(results(cells, report="plain"))
    plots = [f for f in report.figures() if isinstance(f, Plot) and f.key.startswith("mean_aoi")]
    assert [len(plot.lines) for plot in plots] == [24, 24, 24, 24, 4]
    one = Plot(**{**vars(plots[0]), "lines": tuple(line for p in plots for line in p.lines)})
    assert draw(one)["png"]


def test_what_was_played_without_chance_is_told_without_an_interval():
    cells = [
        ("g", "once", 3, record("greedy", 3, 0, {"mean_aoi": [4.0]})),
        ("g", "alike", 3, record("greedy", 3, 0, {"mean_aoi": [5.0, 5.0, 5.0]})),
    ]
    report, _, _ = written(results(cells, report="plain"))
    items = [item for section in report.sections for item in section.items]
    table = next(i for i in items if isinstance(i, Table) and i.key == "metrics")
    assert [row[2] for row in table.rows] == ["4.00", "5.00"]
    assert "once: 1 run, 1 episode; a single episode, without an interval." in table.caption
    assert "alike: 1 run, 3 episodes; all alike, without an interval." in table.caption
