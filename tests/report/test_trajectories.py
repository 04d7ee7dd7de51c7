"""Trajectories: one description of the grid, drawn from two sides and in space."""

import csv
import io
import json
from dataclasses import replace

import numpy as np
import pytest
from drawn import layout, traces
from fake_results import episode, record, results
from report_sample import TRAJECTORY

from iout_marl.render import style
from iout_marl.render.scene import Link, Passed
from iout_marl.report import matplotlib_writer
from iout_marl.report.build import build_report
from iout_marl.report.document import to_csv
from iout_marl.report.figure import TrajectoryPlot
from iout_marl.report.generic import MOST_PATHS
from iout_marl.report.matplotlib_writer import draw
from iout_marl.report.plotly_writer import plotly_json
from iout_marl.trajectory import Trajectory

TEAM = Trajectory(
    grid=[6, 5, 3],
    spacing_m=100.0,
    nodes=[[1, 1, 1], [6, 5, 3]],
    path=[[[2, 2, 1], [5, 5, 2]], [[2, 1, 1], [5, 4, 2]], [[2, 2, 1], [5, 5, 2]]],
    charged=[[1, 2], [0, 1]],
    heard=[[0, 2], [1, 2]],
    delivered=[[False, True], [False, True]],
    ages=[[2, 1], [3, 1]],
)
TEAM_FIGURE = replace(TRAJECTORY, key="team", episode=TEAM)


def test_scene_has_every_place_and_all_that_passed():
    scene = TEAM_FIGURE.scene()
    assert scene.grid_shape == (6, 5, 3)
    assert scene.path.tolist() == TEAM.path
    assert scene.auvs.tolist() == TEAM.path[-1]
    assert not scene.links
    assert set(scene.earlier) == {
        Link(Passed.CHARGE, 1, 0, 0),
        Link(Passed.CHARGE, 1, 1, 1),
        Link(Passed.PACKET, 1, 1, 1),
        Link(Passed.CHARGE, 2, 1, 0),
        Link(Passed.LOSS, 2, 0, 0),
        Link(Passed.PACKET, 2, 1, 1),
    }


def test_every_auv_of_a_team_has_a_path_of_its_colour():
    for auv in range(2):
        (path,) = traces(TEAM_FIGURE, name="path", legendgroup=f"path {auv}")
        way = [places[auv] for places in TEAM.path]
        assert [list(cell) for cell in zip(path["x"], path["y"], path["z"], strict=True)] == way
        assert path["line"]["color"] == style.auv_colour(auv)
    assert traces(TEAM_FIGURE, name="path of AUV B")[0]["x"] == [5, 5]
    (lost,) = traces(TEAM_FIGURE, name=Passed.LOSS.value)
    assert lost["x"][:2] == [2, 1]
    assert "AUV A, cell 2, 2, 1" in lost["text"][0]
    assert layout(TEAM_FIGURE)["scene"]["zaxis"]["range"] == [3.5, 0.5]


def test_a_space_of_flat_cells_has_its_proportions_but_keeps_some_depth():
    flat = replace(TEAM_FIGURE, episode=replace(TEAM, spacing_m=[100.0, 60.0, 10.0]))
    ratio = layout(flat)["scene"]["aspectratio"]
    assert ratio == {"x": 1, "y": pytest.approx(0.5), "z": 0.4}
    titles = [text.get_text() for text in matplotlib_writer._draw_trajectory(flat).texts]
    assert "From above, in cells of 100 × 60 × 10 m" in titles
    assert "From the side, z × 4.8" in titles


def test_rows_have_every_slot_of_every_auv():
    head, *rows = csv.reader(io.StringIO(to_csv(TEAM_FIGURE.rows())))
    assert head[:6] == ["slot", "auv", "x_cell", "y_cell", "z_cell", "charged"]
    assert [row[:2] for row in rows] == [["1", "1"], ["1", "2"], ["2", "1"], ["2", "2"]]
    assert rows[1][2:] == ["5", "4", "2", "2", "2", "1", "2", "1"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"path": [[[2, 3, 1], [5, 5, 2]], *TEAM.path[1:]]},
        {"charged": [[2, 2], [0, 1]]},
        {"heard": [[1, 2], [1, 2]]},
        {"delivered": [[False, False], [False, True]]},
        {"nodes": [[1, 1, 2], [6, 5, 3]]},
        {"docks": [[2, 4, 1]]},
    ],
    ids=" ".join,
)
def test_what_differs_in_an_episode_differs_in_picture_and_page(change):
    other = replace(TEAM_FIGURE, episode=replace(TEAM, **change))
    assert draw(other)["png"] != draw(TEAM_FIGURE)["png"]
    assert plotly_json(other) != plotly_json(TEAM_FIGURE)


@pytest.mark.slow
def test_a_way_that_is_taken_again_lies_beside_itself():
    once, often = (replace(TRAJECTORY, episode=Trajectory(**episode(1, [0] * n))) for n in (9, 29))
    assert draw(once)["png"] != draw(often)["png"]


@pytest.mark.slow
@pytest.mark.parametrize("grid", [[1, 1, 1], [40, 2, 1], [2, 3, 50]])
def test_grids_of_any_form_are_drawn(grid):
    still = Trajectory(
        grid, 10.0, [[1, 1, 1]], [[[1, 1, 1]]] * 3, [[1]] * 2, [[1]] * 2, [[True]] * 2, [[1]] * 2
    )
    figure = replace(TRAJECTORY, episode=still)
    assert set(draw(figure)) == {"png", "svg"}
    assert json.loads(plotly_json(figure))["data"]


def paths(count):
    """Trajectories of a user's study of so many trained series, at two places on its axis."""
    cells = [
        ("g", name, place, record(policy, place, 0, {}))
        for place in (3, 5)
        for name, policy in [("greedy", "greedy"), *((f"own {i}", "ppo") for i in range(count))]
    ]
    report = build_report(results(cells, report="plain"))
    return [figure for figure in report.figures() if isinstance(figure, TrajectoryPlot)], report


def test_a_users_study_shows_its_paths_as_the_papers_report_does():
    (first, second), _ = paths(2)
    assert [first.key, second.key] == ["path-1", "path-2"]
    assert first.title == "Path of own 0 with 5 nodes"
    assert first.episode == Trajectory(**episode(5, (1, 2, 1)))
    assert "3 packets delivered in 3 slots" in first.caption


def test_of_many_trained_series_some_are_shown_and_it_is_said():
    shown, report = paths(9)
    assert len(shown) == MOST_PATHS
    (section,) = (part for part in report.sections if part.key == "paths")
    assert section.paragraphs == (f"The first {MOST_PATHS} of 9 trained series.",)
    assert not paths(0)[0]


def test_colours_of_slots_go_from_the_first_to_the_last():
    colours = style.slot_colours(5)
    assert np.allclose(colours, [style.rgba(c) for c in style.SLOTS])
    assert style.trail_colours(3, 1).shape == (3, 1, 4)
    assert style.trail_colours(3, 2).shape == (3, 2, 4)
