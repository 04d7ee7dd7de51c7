"""Axes and looks of figures: where points stand, and how lines are told apart."""

import itertools
import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from drawn import layout, traces
from fake_results import record, results
from report_sample import BARS, LOG, LOG_BARS, NODES, TRAINING

from iout_marl.render import style
from iout_marl.report.build import _looks, build_report
from iout_marl.report.figure import Axis, Line
from iout_marl.report.matplotlib_writer import draw
from iout_marl.report.plot_layout import lay_out, ticks, y_limits
from iout_marl.report.study_figures import metric_figure

# ---- laid out


def test_categories_are_equally_spaced_whatever_their_values():
    assert ticks(BARS) == ([0.0, 1.0, 2.0], ["3", "5", "10"])
    for one in lay_out(BARS):
        assert np.diff(one.x) == pytest.approx(1)
        assert abs(one.x[0]) < 0.4


def test_bars_stand_around_their_tick_whichever_are_there():
    lines = (
        Line("everywhere", (3, 5, 10), (1.0, 2.0, 3.0)),
        Line("last", (10,), (4.0,)),
        Line("unknown at 5", (3, 5), (1.0, math.nan)),
    )
    laid_out = lay_out(replace(BARS, lines=lines))
    at = [one.x for one in laid_out]
    assert at[0][1] == pytest.approx(1)
    assert at[0][0] + at[2][0] == pytest.approx(2 * 0)
    assert at[0][2] + at[1][0] == pytest.approx(2 * 2)
    assert at[0][2] + laid_out[0].width < at[1][0] + 1e-9 + 0.1 * laid_out[0].width


def over(places, *, grouped=False):
    """A figure of a study whose axis has these places."""
    made = {name: record("greedy", 3, 0, {"mean_aoi": [3.0, 4.0]}) for name in ("one", "other")}
    cells = [("g", name, place, one) for name, one in made.items() for place in places]
    made = results(cells, report="plain")
    names = ["one", "other"]
    return metric_figure(made, "key", "Title", "mean_aoi", names, grouped=grouped)


def test_an_axis_of_numbers_is_one():
    plot = over([0.5, 1, 10])
    assert not plot.x.is_categorical
    for trace in traces(plot, mode="lines+markers"):
        assert trace["x"] == [0.5, 1, 10]
    axis = layout(plot)["xaxis"]
    assert "type" not in axis
    assert (axis["tickvals"], axis["ticktext"]) == ([0.5, 1, 10], ["0.5", "1", "10"])
    assert axis["range"][0] < 0.5
    assert axis["range"][1] > 10


def test_an_axis_of_two_decades_is_logarithmic():
    plot = over([0.01, 1, 2000])
    axis = layout(plot)["xaxis"]
    assert axis["type"] == "log"
    assert axis["ticktext"] == ["0.01", "1", "2,000"]
    assert traces(plot)[0]["x"] == [0.01, 1, 2000]
    assert layout(over([1, 100]))["xaxis"]["type"] == "log"
    assert layout(over([1, 99]))["xaxis"].get("type") != "log"


def test_a_logarithmic_axis_with_zero_or_less_shows_it_too():
    plot = over([-100, 0, 0.5, 500])
    x = traces(plot)[0]["x"]
    assert x == sorted(set(x))
    assert x[1] == 0
    assert layout(plot)["xaxis"]["ticktext"] == ["-100", "0", "0.5", "500"]


def test_numbers_are_categories_where_bars_are_grouped_and_single_ones_everywhere():
    for plot in (over([3, 5, 7, 10], grouped=True), over([3])):
        assert plot.x.scale == "categories"


@pytest.mark.slow
@pytest.mark.parametrize(
    "places", [[0, 0.0], [1e50, -1e50], [1, 1 + 1e-12], list(range(300)), [5e-324, 1], [-3, -2]]
)
def test_any_axis_is_drawn(places):
    plot = over(places)
    assert draw(plot)["png"]
    assert len("".join(layout(plot)["xaxis"]["ticktext"])) < 100, "labels have no room"


def test_bars_of_a_group_stand_beside_one_another():
    edges = [(one.x[1] - one.width / 2, one.x[1] + one.width / 2) for one in lay_out(BARS)]
    assert all(left[1] < right[0] for left, right in pairwise(edges))
    assert edges[0][0] > 0.5
    assert edges[-1][1] < 1.5


def test_band_breaks_where_intervals_are_missing():
    fdd, tdd, *_ = lay_out(TRAINING)
    assert fdd.spans() == [list(range(60))]
    assert tdd.spans() == [list(range(20)), list(range(23, 40)), list(range(41, 60))]
    assert fdd.band
    assert not any(one.band for one in lay_out(NODES))


def test_intervals_on_a_logarithmic_axis_stay_above_zero():
    first, dashed, _ = lay_out(LOG)
    assert min(first.low) == 1e-6
    assert first.y == LOG.lines[0].y
    assert math.isnan(dashed.y[2]), "0 has no place on the axis"


def test_bars_on_a_logarithmic_axis_stand_on_a_power_of_ten():
    foot, top = y_limits(LOG_BARS)
    assert foot == pytest.approx(100)
    assert top > 210_000


# ---- colours


def test_a_policy_has_one_colour_throughout_a_report():
    names = [f"{policy}, {rest}" for rest in ("TDD", "FDD") for policy in ("a", "b", "c", "d")]
    names += ["d, alone", "c, alone", "e (TDD)"]
    one = record("greedy", 3, 0, {"mean_aoi": [3.0, 4.0]})
    made = results([("g", name, 3, one) for name in names], report="plain")
    plots = [f for f in build_report(made).figures() if f.key.startswith("mean_aoi")]
    looks = {line.name: line.colour for plot in plots for line in plot.lines}
    assert len(plots) == 4
    assert [looks[name] for name in names] == [0, 1, 2, 3, 0, 1, 2, 3, 3, 2, 4]


def test_series_of_one_policy_in_one_figure_are_told_apart():
    assert _looks([["a", "a (long)", "b"], ["a (FDD)", "b"]]) == {
        "a": 0,
        "a (long)": 1,
        "b": 2,
        "a (FDD)": 0,
    }


def test_series_of_one_figure_have_other_colours_where_these_suffice():
    many = list("abcdefgh")
    looks = _looks([many, ["a", "later"]])
    assert looks == {**{name: i for i, name in enumerate(many)}, "later": 9}


def luminance(colour):
    parts = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    red, green, blue = (p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


@pytest.mark.parametrize("colour", [*style.COLOURS, *style.SLOTS, *style.AUVS])
def test_colours_are_seen_on_light_and_on_dark(colour):
    assert 1.05 / (luminance(colour) + 0.05) >= 2.7
    assert (luminance(colour) + 0.05) / (luminance("#12171d") + 0.05) >= 3


#: Severities of 1 of Machado, Oliveira and Fernandes (2009), on linear RGB.
VISIONS = {
    "usual": np.eye(3),
    "protanopia": [[0.152, 1.053, -0.205], [0.115, 0.786, 0.099], [-0.004, -0.048, 1.052]],
    "deuteranopia": [[0.367, 0.861, -0.228], [0.280, 0.673, 0.047], [-0.012, 0.043, 0.969]],
    "tritanopia": [[1.256, -0.077, -0.179], [-0.078, 0.931, 0.148], [0.005, 0.691, 0.304]],
}


def seen(colour, vision):
    """A colour in CIELAB as an eye sees it."""
    parts = np.array([int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)])
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    linear = np.clip(np.array(VISIONS[vision]) @ linear, 0, 1)
    to_xyz = np.array(
        [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    )
    x, y, z = np.cbrt(to_xyz @ linear / (0.9505, 1, 1.089))
    return np.array([116 * y - 16, 500 * (x - y), 200 * (y - z)])


@pytest.mark.parametrize("vision", VISIONS)
def test_many_series_are_told_apart_whatever_the_eyes_colour_vision(vision):
    lines = tuple(Line(str(i), (1, 2), (1.0, 2.0)) for i in range(40))
    looks = [one.look for one in lay_out(replace(NODES, lines=lines))]
    for first, second in itertools.combinations(looks, 2):
        distance = np.linalg.norm(seen(first.colour, vision) - seen(second.colour, vision))
        assert distance > 10 or (first.mark, first.dash) != (second.mark, second.dash)
    for first, second in itertools.combinations(looks[:24], 2):  # bars have neither of these
        distance = np.linalg.norm(seen(first.colour, vision) - seen(second.colour, vision))
        assert distance > 10 or first.hatch != second.hatch


@pytest.mark.parametrize("scale", ["linear", "categories"])
def test_picture_and_page_have_the_same_looks(scale):
    lines = tuple(Line(str(i), (1, 2), (1.0, 2.0)) for i in range(24))
    plot = replace(NODES, lines=lines, x=Axis("x", scale=scale))
    drawn = traces(plot)
    if scale == "categories":
        looks = {(t["marker"]["color"], str(t["marker"].get("pattern"))) for t in drawn}
    else:
        looks = {(t["line"]["color"], t["line"]["dash"], t["marker"]["symbol"]) for t in drawn}
    assert len(looks) == 24
    assert [t["marker"]["color"] for t in drawn] == [one.look.colour for one in lay_out(plot)]
