"""Any results that validate give a report: page, Markdown, pictures; and nothing is raised."""

import math
import re
from pathlib import Path

import plotly.graph_objects as go
import pytest
from any_results import any_results
from fake_results import record, results

from iout_marl.errors import InputError
from iout_marl.files import parse_json
from iout_marl.report.build import build_report
from iout_marl.report.document import Table
from iout_marl.report.figure import Plot
from iout_marl.report.markdown import render_markdown
from iout_marl.report.matplotlib_writer import draw
from iout_marl.report.page import render_page
from iout_marl.report.plotly_writer import plotly_json
from iout_marl.study.results import Failure, Results, validated


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


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["paper", "plain"])
@pytest.mark.parametrize("part", range(4))
def test_results_at_random(kind, part):
    for seed in range(5 * part, 5 * part + 5):
        made = any_results(seed, report=kind)
        Results.model_validate(made.model_dump())
        written(made)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [14, 30, 52])
def test_pictures_of_results_at_random(seed):
    figures = list(build_report(any_results(seed)).figures())
    for figure in figures[:8]:
        assert set(draw(figure)) == {"png", "svg"}


@pytest.mark.parametrize(
    ("path", "value"),
    [(("axis",), place) for place in (1e300, -1e300, math.inf, math.nan)]
    + [
        (("record", *path), value)
        for path, value in (
            (("nodes",), -1),
            (("episodes",), 0),
            (("maximum_age",), 5e-324),
            (("minimum_jain",), 1.5),
            (("samples", "mean_aoi"), [0.0]),
            (("samples", "jain"), [51.0]),
            (("episode", "path"), [[1]]),
            (("training", "env_steps"), 10**400),
            (("training", "seconds"), 0.0),
            (("training", "settings", "learning_rate"), "x"),
            (("training", "settings", "hidden_units"), [[1], 2]),
            (("training", "curve", "aoi/mean"), [1.0]),
            (("training", "emissions", "energy_kwh"), 1.7e308),
        )
    ],
)
def test_numbers_that_no_study_has_are_refused_in_one_line(path, value):
    data = results([("g", "a", 3, record("ppo", 3, 0, {}))]).model_dump()
    part = data["cells"][0]
    for key in path[:-1]:
        part = part[key]
    part[path[-1]] = value
    with pytest.raises(InputError, match=r"^results.json: cannot be read: ") as caught:
        validated(Results, Path("results.json"), data)
    assert str(caught.value).isprintable()


@pytest.mark.slow
def test_failures_alone_and_nothing_at_all():
    failure = Failure(series="PPO", axis=3, seed=0, error="it | diverged `at` once")
    for kind in ("paper", "plain"):
        made = results([], report=kind)
        written(made)
        report, page, text = written(made.model_copy(update={"failures": (failure,)}))
        assert "it | diverged `at` once" in page
        assert "it \\| diverged \\`at\\` once" in text
        assert "1 failed" in dict(report.facts)["Cells"]


def test_age_0_has_no_gap_in_percent():
    cells = [
        ("g", name, 3, record(policy, 3, 0, {"mean_aoi": 2.0}))
        for name, policy in (("bound", "bound"), ("a", "greedy"), ("b", "ppo"))
    ]
    made = results(cells, report="plain")
    for cell in made.cells[:2]:  # no file of results has this age
        cell.record.samples["mean_aoi"] = [0.0]
    _, _, text = written(made)
    assert "| a | 3 | 0.00 | 0.000 | **0.000** | 0.0\N{NO-BREAK SPACE}% |" in text
    assert "| b | 3 | 2.00 | 0.000 | 0.000 | –\N{NO-BREAK SPACE}% |" in text


@pytest.mark.slow
def test_a_series_of_many_and_many_series_are_drawn_in_parts():
    cells = [
        ("g", f"series {i}", 3 + i % 2, record("greedy", 3, 0, {"mean_aoi": [i + 1, i + 2]}))
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


def test_what_is_0_throughout_has_no_figure():
    cells = [
        ("g", name, place, record("greedy", place, 0, {"harvested_kj": 0.0, "jain": jain}))
        for name, jain in (("one", 0.0), ("other", 0.5))
        for place in (3, 5)
    ]
    made = build_report(results(cells, report="plain"))
    keys = {figure.key for figure in made.figures()}
    assert {"mean_aoi", "jain"} <= keys
    assert "harvested_kj" not in keys
    told = [section.paragraphs for section in made.sections if section.key == "overview"]
    assert told == [("0 throughout, and so without a figure: Energy harvested.",)]
