"""A user's text is shown as it is, whatever it says and wherever it stands."""

import csv
import io
import re
from pathlib import Path

import pytest
from any_results import NASTY, REFUSED
from fake_results import record, results
from markdown_it import MarkdownIt
from watched import Watched

from iout_marl.errors import InputError
from iout_marl.render.labels import displayable
from iout_marl.report.build import build_report
from iout_marl.report.document import Table, to_csv
from iout_marl.report.markdown import render_markdown
from iout_marl.report.markup import (
    as_data,
    html_text,
    markdown_text,
    plain_text,
    plotly_template,
    plotly_text,
)
from iout_marl.report.page import render_page
from iout_marl.report.plot_layout import LONGEST_NAME
from iout_marl.report.writer import write_report
from iout_marl.study.results import Failure, Results, validated

NAMES = [name for name in NASTY if name.strip()]
#: The functions that clean a text take these too.
each_text = pytest.mark.parametrize("text", [*NAMES, *REFUSED], ids=lambda text: repr(text[:20]))


def as_shown(text):
    """A text as a reader sees it: blanks in a row are one."""
    return " ".join(displayable(text).split())


def named(names=NAMES):
    """Results in which these stand wherever a user may write."""
    cells = []
    for i, name in enumerate(names):
        one = record("greedy", 3 + i % 4, 0, {"mean_aoi": [4.0 + i, 5.0 + i]})
        changes = {"scenario": name, "machine": {"processor": name}, "search": name, "date": name}
        cells.append((name, name, 3 + i % 4, one.model_copy(update=changes)))
    made = results(cells, report="plain")
    made = made.model_copy(
        update={
            "title": " ".join(names[:-2]),
            "description": "\n".join(names[:-2]),
            "command": names[0],
            "axis": made.axis.model_copy(update={"key": names[1], "label": names[1]}),
            "failures": tuple(Failure(series=n, axis=3, seed=0, error=n) for n in names),
        }
    )
    return Results.model_validate(made.model_dump())


@pytest.fixture(scope="module")
def report():
    return build_report(named())


def tables(report):
    return [i for section in report.sections for i in section.items if isinstance(i, Table)]


@pytest.mark.parametrize("text", REFUSED, ids=lambda text: repr(text[:20]))
def test_what_cannot_be_shown_is_refused_in_one_line(text):
    data = named(["a", "b", "c"]).model_dump() | {"title": text}
    with pytest.raises(InputError, match=r"^results.json: cannot be read: title: must ") as caught:
        validated(Results, Path("results.json"), data)
    assert str(caught.value).isprintable()


MARKDOWN = MarkdownIt("commonmark").enable(["table", "strikethrough"])


def read(source):
    """The text of each inline part of Markdown; fails where anything is marked up in it."""
    found = []
    for token in MARKDOWN.parse(source):
        assert token.type != "html_block"
        if token.type == "inline":
            assert {part.type for part in token.children} <= {"text", "text_special"}
            found.append("".join(part.content for part in token.children))
    return found


@pytest.mark.slow
@each_text
@pytest.mark.parametrize("form", ["{}\n", "# {}\n", "- {}\n", "1: {}\n\nx\n", "|a|\n|---|\n|{}|\n"])
def test_markdown_shows_it_and_no_more(text, form):
    cell = read(form.format(markdown_text(as_data(text))))[1 if form.startswith("|") else 0]
    assert as_shown(cell.removeprefix("1: ")) == as_shown(text)


def test_pages_of_markdown_keep_their_tables(report):
    lines = render_markdown(report, "my runs/(a)").splitlines()
    rows = [line for line in lines if line.startswith("| ") and "---" not in line]
    assert {len(re.findall(r"(?<!\\)\|", row)) for row in rows} <= {3, 5, 7, 9}
    assert "](my%20runs/%28a%29/mean_aoi-1.png)" in "\n".join(lines)
    failed = [line for line in lines if line.startswith("| ")][-len(NAMES) :]
    for name, line in zip(NAMES, failed, strict=True):
        (*_, error) = read(f"|a|b|c|d|\n|---|---|---|---|\n{line}\n")
        assert as_shown(error) == as_shown(name)


@each_text
def test_html_and_plotly_get_no_tag_and_no_code_of_it(text):
    for made in (str(html_text(as_data(text))), plotly_text(as_data(text))):
        assert not set("<>\n\0\ufdd0") & set(made)
    assert "%{" not in plotly_template(as_data(text))
    assert plain_text(as_data(text)).isprintable() or not text.isprintable()


def test_what_turns_the_direction_of_writing_ends_with_the_name():
    assert displayable("a \u202eb \u2066c") == "a \u202eb \u2066c\u2069\u202c"
    assert displayable("\u2066a\u2069") == "\u2066a\u2069"


def test_csv_has_it_in_one_cell(report):
    found = set()
    for figure in report.figures():
        rows = list(csv.reader(io.StringIO(to_csv(figure.rows()))))
        assert {len(row) for row in rows} == {5}
        found |= {row[0] for row in rows[1:]}
    assert found == {displayable(name) for name in NAMES}


def test_names_that_look_alike_once_cleaned_stay_two():
    made = build_report(named(["a\ufdd0b", "a\ufdd1b", "a\U0001fffeb"]))
    rows = next(table for table in tables(made) if table.key == "metrics").rows
    assert [row[0] for row in rows] == ["a\ufffdb", "a\ufffdb (2)", "a\ufffdb (3)"]


@pytest.mark.slow
def test_page_shows_it_and_runs_nothing(report, browser, tmp_path):
    write_report(report, tmp_path)
    watched = Watched(browser, (tmp_path / "report.html").as_uri())
    page = watched.page
    page.evaluate("window.reportReady")
    cells = page.evaluate(
        "[...document.querySelectorAll('tbody')].map((b) => [...b.querySelectorAll('th, td')]"
        ".map((cell) => cell.textContent))"
    )
    for table, shown in zip(tables(report), cells, strict=True):
        said = [plain_text(cell) for row in table.rows for cell in row]
        assert [as_shown(cell) for cell in shown] == [as_shown(cell) for cell in said]
    entries = page.evaluate(
        "[...document.querySelectorAll('.legendtext')].map((t) => t.textContent)"
    )
    names = [line.name for figure in report.figures() for line in figure.lines]
    expected = [plain_text(name, LONGEST_NAME) for name in names]
    assert ["".join(entry.split()) for entry in entries] == ["".join(n.split()) for n in expected]
    assert as_shown(page.locator("h1").inner_text()) == as_shown(plain_text(report.title))
    assert as_shown(page.title()) == as_shown(plain_text(report.title))
    assert page.locator("main script:not(.plot-data), main svg img, iframe").count() == 0
    page.set_viewport_size({"width": 390, "height": 844})
    page.wait_for_timeout(500)
    assert page.evaluate("document.documentElement.scrollWidth") == 390
    ends = page.evaluate(
        "[...document.querySelectorAll('.legendtext, .xtitle')]"
        ".map((text) => text.getBoundingClientRect().right)"
    )
    assert max(ends) <= 390
    assert watched.complaints == []
    watched.context.close()


@pytest.mark.slow
def test_text_that_points_tell_of_is_no_template(report, browser, tmp_path):
    path = tmp_path / "report.html"
    path.write_text(render_page(build_report(named(["%{x} <b>&lt;", "other"]))), encoding="utf-8")
    watched = Watched(browser, path.as_uri())
    watched.page.evaluate("window.reportReady")
    watched.page.evaluate(
        "Plotly.Fx.hover(document.querySelector('.js-plotly-plot'),"
        "[{curveNumber: 0, pointNumber: 0}])"
    )
    told = watched.page.locator(".hoverlayer .hovertext").first
    told.wait_for(state="attached")
    assert "%{x} <b>&lt;" in told.text_content().replace("\N{WORD JOINER}", "")
    assert watched.complaints == []
    watched.context.close()
