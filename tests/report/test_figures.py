"""Figures as files and for the page: the values of the data, and the same bytes every time."""

import csv
import io
import json
import math
import re
import xml.etree.ElementTree as ET
from dataclasses import replace
from html import escape

import numpy as np
import plotly.graph_objects as go
import pytest
from drawn import layout, traces
from PIL import Image
from report_sample import BARS, FIGURES, LOG, NODES, SAMPLE, TRAINING, TRAJECTORY

from iout_marl.errors import InputError
from iout_marl.files import parse_json
from iout_marl.render.scene import Passed
from iout_marl.report import palette
from iout_marl.report.document import Report, Section, to_csv
from iout_marl.report.figure import Axis, Line
from iout_marl.report.matplotlib_writer import draw
from iout_marl.report.page import render_page
from iout_marl.report.plotly_writer import plotly_json
from iout_marl.report.writer import write_report

each_figure = pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.key)


@pytest.fixture(scope="module")
def pictures():
    return {figure.key: draw(figure) for figure in FIGURES}


# ---- static


@pytest.mark.slow
@each_figure
def test_pictures_are_whole(figure, pictures):
    image = Image.open(io.BytesIO(pictures[figure.key]["png"]))
    assert image.width > 1000
    pixels = np.asarray(image.convert("RGB"))
    assert (pixels[0] == 255).all(), "something runs over the edge"
    assert (pixels < 250).any(axis=2).mean() > 0.01, "nothing is drawn"
    root = ET.fromstring(pictures[figure.key]["svg"])
    assert root.tag == "{http://www.w3.org/2000/svg}svg"


@pytest.mark.slow
@each_figure
def test_same_data_give_same_bytes(figure, pictures):
    again = draw(figure)
    assert again == pictures[figure.key]
    assert not re.search(rb"<dc:date>|20\d\d-\d\d-\d\d", again["svg"])


@pytest.mark.slow
def test_other_data_give_other_pictures(pictures):
    moved = replace(NODES, lines=(replace(NODES.lines[0], y=(9, 10, 11, 12)), *NODES.lines[1:]))
    assert draw(moved)["png"] != pictures[NODES.key]["png"]


def test_pictures_leave_settings_of_matplotlib_alone():
    import matplotlib as mpl

    before = dict(mpl.rcParams)
    draw(BARS)
    assert dict(mpl.rcParams) == before


def test_dollar_signs_are_no_formulas():
    draw(replace(BARS, x=Axis("price in $", scale="categories"), y=Axis(r"a $\broken formula")))


@pytest.mark.slow
@pytest.mark.parametrize("scale", ["linear", "log", "categories"])
def test_plot_of_one_point_or_none_is_drawn(scale):
    for lines in ((), (Line("alone", (3,), (1.0,)),), (Line("unknown", (3,), (math.nan,)),)):
        for log in (False, True):
            y = Axis("y", scale="log" if log else "linear")
            plot = replace(BARS, lines=lines, x=Axis("x", scale=scale), y=y)
            assert draw(plot)["png"]
            json.loads(plotly_json(plot))


# ---- interactive


@each_figure
def test_plotly_knows_every_word(figure):
    assert go.Figure(json.loads(plotly_json(figure))).data


def test_numbers_that_are_none_are_null():
    lines = (Line("a", (1, 2), (math.nan, math.inf), (math.nan, -math.inf), (1.0, math.inf)),)
    for plot in (replace(BARS, lines=lines), replace(TRAINING, lines=lines)):
        text = plotly_json(plot)
        parse_json(text)
        assert "null" in text


def test_lines_have_the_values_of_the_data():
    for line in TRAINING.lines:
        name = escape(line.name, quote=False)  # Plotly reads markup
        (trace,) = traces(TRAINING, name=name, mode="lines+markers")
        assert trace["x"] == pytest.approx(line.x)
        assert trace["y"] == pytest.approx(line.y)
        assert trace["line"]["dash"] == ("dash" if line.dashed else "solid")


def test_error_bars_end_where_intervals_do():
    for line in NODES.lines:
        (trace,) = traces(NODES, name=line.name)
        bars = trace["error_y"]
        for i in range(3):
            assert line.y[i] + bars["array"][i] == pytest.approx(line.high[i])
            assert line.y[i] - bars["arrayminus"][i] == pytest.approx(line.low[i])
        assert bars["array"][3] == bars["arrayminus"][3] == "none"


def test_pointing_tells_value_and_interval():
    (trace,) = traces(NODES, name="PPO, FDD")
    assert trace["customdata"][0] == ["3", "8  [7.1, 8.9]"]
    assert trace["customdata"][3] == ["10", "14.3"]
    assert "number of nodes K" in trace["hovertemplate"]


def test_logarithmic_axes_are_so_in_both_directions():
    axes = layout(LOG)
    assert axes["xaxis"]["type"] == axes["yaxis"]["type"] == "log"
    assert axes["xaxis"]["range"] == pytest.approx([0, math.log10(2000)])
    assert "type" not in layout(NODES)["yaxis"]
    assert layout(NODES)["yaxis"]["range"] == [0, 40]


def test_lines_of_one_name_share_colour_and_entry_of_the_legend():
    first, second = traces(LOG, name="measured in a basin")
    assert first["line"]["color"] == second["line"]["color"] == palette.colour(4)
    assert first["legendgroup"] == second["legendgroup"]
    assert [first["showlegend"], second["showlegend"]] == [True, False]


@each_figure
def test_ground_is_the_pages(figure):
    assert layout(figure)["paper_bgcolor"] == "rgba(0,0,0,0)"
    assert len(json.dumps(layout(figure)["template"])) < 200, "defaults of Plotly have colours"


def test_trajectory_has_path_nodes_and_what_was_charged_and_heard():
    (path,) = traces(TRAJECTORY, mode="lines", showlegend=False)
    episode = TRAJECTORY.episode
    way = [cell for (cell,) in episode.path]
    assert list(zip(path["x"], path["y"], path["z"], strict=True)) == way
    assert path["line"]["color"] == list(range(121))
    (nodes,) = traces(TRAJECTORY, name="nodes")
    assert list(zip(nodes["x"], nodes["y"], nodes["z"], strict=True)) == list(episode.nodes)
    assert nodes["text"] == ["1", "2", "3", "4"]

    heard = [(node, ok) for (node,), (ok,) in zip(episode.heard, episode.delivered, strict=True)]
    slots = list(zip(way[1:], heard, strict=True))
    for what, arrived in ((Passed.PACKET, True), (Passed.LOSS, False)):
        (links,) = traces(TRAJECTORY, name=what.value)
        places = list(zip(links["x"], links["y"], links["z"], strict=True))
        found = set(zip(places[::3], places[1::3], strict=True))
        assert found == {
            (cell, episode.nodes[node - 1]) for cell, (node, ok) in slots if node and ok == arrived
        }
        assert links["line"]["color"] == palette.LINKS[what]
    (charging,) = traces(TRAJECTORY, name=Passed.CHARGE.value)
    assert charging["line"]["color"] == palette.LINKS[Passed.CHARGE]


def test_pointing_at_a_cell_tells_slot_doings_and_ages():
    (cells,) = traces(TRAJECTORY, name="path of the AUV")
    told = "\n".join(cells["text"])
    episode = TRAJECTORY.episode
    slot = next(i for i, (node,) in enumerate(episode.heard) if node)
    ages = " ".join(map(str, episode.ages[slot]))
    arrived = "delivered" if episode.delivered[slot][0] else "lost"
    doing = f"hears node {episode.heard[slot][0]}: packet {arrived}"
    assert f"<b>slot {slot + 1}</b>: {doing}<br>   ages {ages}" in told


def test_depth_grows_downwards():
    assert layout(TRAJECTORY)["scene"]["zaxis"]["range"] == [5.5, 0.5]


# ---- files


@pytest.mark.slow
def test_report_is_written_with_every_figure(tmp_path, pictures):
    write_report(SAMPLE, tmp_path / "new" / "folder")
    folder = tmp_path / "new" / "folder"
    names = {f"{figure.key}.{ending}" for figure in FIGURES for ending in ("png", "svg", "csv")}
    assert {path.name for path in (folder / "figures").iterdir()} == names
    assert {path.name for path in folder.iterdir()} == {"figures", "report.html"}
    page = (folder / "report.html").read_text(encoding="utf-8")
    for name in names:
        assert f'href="figures/{name}"' in page
    for figure in FIGURES:
        assert (folder / "figures" / f"{figure.key}.svg").read_bytes() == pictures[figure.key][
            "svg"
        ]


@each_figure
def test_csv_has_the_values_of_the_data(figure):
    head, *rows = csv.reader(io.StringIO(to_csv(figure.rows())))
    if figure is TRAJECTORY:
        assert len(rows) == 120
        assert tuple(map(int, rows[7][2:5])) == figure.episode.path[8][0]
        assert list(map(int, rows[7][8:])) == figure.episode.ages[7]
        return
    assert head == ["series", figure.x.label, figure.y.label, "ci95_low", "ci95_high"]
    expected = [
        (line.name, x, y) for line in figure.lines for x, y in zip(line.x, line.y, strict=True)
    ]
    assert [(name, float(x), float(y)) for name, x, y, _, _ in rows] == expected


def test_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    report = Report("Empty", (), (), ())
    with pytest.raises(InputError, match=r"file/figures: cannot be made: Not a directory$"):
        write_report(report, tmp_path / "file")


@pytest.mark.slow
@pytest.mark.posix
def test_a_report_that_cannot_be_written_leaves_the_earlier_one(tmp_path):
    import resource  # Windows has none

    small = Report("Small", (), (), (Section("s", "S", (), (BARS,)),))
    write_report(small, tmp_path)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, limits[1]))  # as of a disk that is full
    try:
        with pytest.raises(
            InputError, match=r"report\.html: cannot be written: .*; the one before"
        ):
            write_report(SAMPLE, tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert before == {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}


# ---- page


def test_page_of_no_figure_has_no_plotly():
    assert len(render_page(Report("Empty", ("Nothing.",), (), ()))) < 40_000


def test_texts_are_escaped_and_backticks_are_code():
    paragraph = "`a < b` & <script>alert(1)</script> ` alone"
    report = Report("<T>", (), (("`k`", "<v>"),), (Section("s", "A & `b`", (paragraph,)),))
    page = render_page(report)
    assert "<code>a &lt; b</code> &amp; &lt;script&gt;alert(1)&lt;/script&gt; ` alone" in page
    assert "<h1>&lt;T&gt;</h1>" in page
    assert "A &amp; <code>b</code></a></h2>" in page
    assert "<dt><code>k</code></dt><dd>&lt;v&gt;</dd>" in page


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        (("a", "a"), "'a' is the key of 2 parts"),
        (("a", "A"), "'a' is the key of 2 parts"),
        (("a b",), "'a b' is no key"),
    ],
)
def test_keys_must_be_names_and_unique(keys, message):
    report = Report("T", (), (), tuple(Section(key, key) for key in keys))
    with pytest.raises(ValueError, match=message):
        render_page(report)
