"""A study names its report: one of this package, or one that a user has registered."""

import json
from pathlib import Path

import pytest
from fake_results import paper_like, record, results
from tiny_study import STUDY, write_study

from iout_marl import InputError
from iout_marl.errors import printable
from iout_marl.registry import registry_of
from iout_marl.report import Report, reports
from iout_marl.report.build import build_report
from iout_marl.study import load_study
from iout_marl.study.results import read_results

MY_REPORTS = """
from iout_marl.report import Axis, Line, Plot, Report, Section, Table, reports

@reports.register("short")
def short_report(results):
    figure = Plot(
        "aoi", "Mean AoI", "Of every cell.", results.command, Axis("cell"), Axis("slots"),
        (Line("cells", (1.0, 2.0), (3.0, 4.0)),),
    )
    section = Section("s", "S", items=(figure,))
    return Report(f"In short: {results.title}", ("A lead.",), (), (section,))
"""
ONE = [("g", "greedy", 3, record("greedy", 3, 0, {}))]


pytestmark = pytest.mark.usefixtures("forgotten_parts")


def test_this_package_has_the_papers_report_and_one_for_all_others():
    assert set(reports.kinds) == {"plain", "paper"}
    assert registry_of("report") is reports
    assert build_report(paper_like()).title.startswith("Reproduction: ")
    assert not build_report(results(ONE, report="plain")).title.startswith("Reproduction: ")


@pytest.mark.slow
def test_a_users_report_is_written_from_the_study_that_names_it(iout, tmp_path):
    (tmp_path / "my_reports.py").write_text(MY_REPORTS)
    mine = str(tmp_path / "my_reports.py")
    played = {"baseline": STUDY["groups"]["baseline"]}
    path = write_study(tmp_path / "tiny.yaml", report="short", groups=played)
    out = tmp_path / "out"
    words = ["--study", str(path), "--quick", "--out", str(out), "--jobs", "1", "--import", mine]
    code, _, error = iout("reproduce", *words)
    assert code == 0, error
    assert (out / "report.md").read_text().startswith("# In short: A tiny study\n")
    assert (out / "figures" / "aoi.svg").exists()

    (out / "report.md").unlink()
    code, _, error = iout("report", str(out), "--import", mine)
    assert code == 0, error
    assert (out / "report.md").exists()


def test_an_unknown_report_is_named_in_one_line_with_those_that_are_known(tmp_path):
    path = write_study(tmp_path / "tiny.yaml", report="shor")
    line = 1 + path.read_text().splitlines().index('  "report": "shor"')
    with pytest.raises(InputError) as caught:
        load_study(path)
    told = str(caught.value)
    assert f"tiny.yaml:{line}: report: unknown report 'shor' (known: paper, plain)" in told
    assert "--import" in told

    data = json.loads(results(ONE, report="plain").model_dump_json()) | {"report": "papers"}
    kept = tmp_path / "results.json"
    kept.write_text(json.dumps(data))
    with pytest.raises(InputError, match="report: unknown report 'papers'; did you mean 'paper'"):
        read_results(kept)


def failing(results):
    raise KeyError("no such\nseries")


def returning_a_text(results):
    return results.title


@pytest.mark.parametrize(
    ("own", "why"),
    [
        (failing, f"raises KeyError: .*{Path(__file__).name}:"),
        (returning_a_text, "returns str, not a Report"),
    ],
)
def test_a_users_report_that_fails_is_blamed_in_one_line(own, why):
    reports.register("own")(own)
    with pytest.raises(InputError, match=f"^report 'own': {why}") as caught:
        build_report(results(ONE, report="own"))
    assert str(caught.value) == printable(str(caught.value))


def test_two_reports_of_one_name_are_refused():
    reports.register("own")(failing)
    with pytest.raises(InputError, match=r"report 'own': .* has the name of .*failing"):
        reports.register("own")(returning_a_text)


def test_a_users_report_gets_texts_that_are_data():
    seen = []

    @reports.register("own")
    def own(results):
        seen.append(results.title)
        return Report(results.title, (), (), ())

    build_report(results(ONE, report="own").model_copy(update={"title": "a `b`"}))
    assert "`" not in seen[0]
