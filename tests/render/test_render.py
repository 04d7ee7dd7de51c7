"""What text and picture show, and that they keep to themselves."""

import io
import re
import subprocess
import sys
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from rich.cells import cell_len

from iout_marl.policies import make_baseline
from iout_marl.render import Snapshot, as_picture, as_text, print_text, style
from iout_marl.render.labels import age_text, auv_name, energy_text, total_energy_text
from iout_marl.render.layout import (
    axis_top,
    freest,
    most_stretch,
    place_auvs,
    place_nodes,
    round_step,
)
from iout_marl.render.picture import _Bars
from iout_marl.render.projection import FROM_ABOVE, Projection
from iout_marl.render.scene import Link, Passed, Scene
from iout_marl.render.style import FAILED, rgba
from iout_marl.scenario import load_scenario
from iout_marl.world import World, node_codes

THREE_AUVS = {"auvs.start_cells": [[5, 5, 2], [1, 1, 1], [9, 9, 4]]}
RANDOM_NODES = {"nodes.kind": "random", "nodes.count": 40}
CROWD = {
    "grid.cells": [60, 45, 9],
    "nodes.kind": "random",
    "nodes.count": 120,
    "auvs.start_cells": [[i + 1, i + 1, 1] for i in range(30)],
}
ONE_CELL = {
    "grid.cells": [1, 1, 1],
    "nodes.cells": [[1, 1, 1]],
    "nodes.count": 1,
    "auvs.start_cells": [[1, 1, 1]],
    "age.maximum": 1,
}
SITUATIONS = {
    "fdd": ("paper/k10-fdd", {}, 20),
    "tdd": ("paper/k3-tdd", {}, 20),
    "first": ("paper/k3-tdd", {}, 0),
    "three-auvs": ("paper/k10-fdd", THREE_AUVS, 9),
    "40-nodes": ("paper/k10-fdd", RANDOM_NODES, 9),
    "crowd": ("paper/k10-fdd", CROWD, 9),
    "one-cell": ("paper/k3-tdd", ONE_CELL, 3),
    "flat-cells": ("paper/k10-fdd", {"grid.spacing_m": [60, 100, 5]}, 9),
    "sonar": ("paper/k10-fdd", {"channel.kind": "sonar"}, 9),
}
SEA = {
    "auvs": {"start_cells": [[2, 2, 1], [8, 8, 2]], "idle_choices": True},
    "episode.slot_s": 10,
    "vehicle": {
        "kind": "battery",
        "capacity_j": 6e5,
        "drag_area_m2": 3.0,
        "drag_coefficient": 0.006,
        "propulsion_efficiency": 0.7,
        "hotel_w": 200.0,
        "docks": [[2, 2, 1], [5, 8, 2]],
        "dock_power_w": 1000,
    },
    "storage": {"kind": "capacitor", "capacity_j": 300.0, "idle_w": 0.5},
}
SITUATIONS["sea"] = ("paper/k10-fdd", SEA, 4)
some_situation = pytest.mark.parametrize("name", SITUATIONS)


def play(scenario, overrides=(), slots=0, policy="random-walk"):
    """A snapshot after some slots."""
    world = World(load_scenario(scenario, overrides))
    rng = np.random.default_rng(0)
    state, events = world.reset(node_codes(world.scenario, world.grid, [rng])), None
    for _ in range(slots):
        action = make_baseline(policy).act(world, state, rng)
        state, events = world.step(state, action)
    return Snapshot.from_world(world, state, events)


def situation(name):
    return play(*SITUATIONS[name])


@pytest.fixture(scope="module")
def fdd():
    return situation("fdd")


@pytest.fixture(scope="module")
def fdd_picture(fdd):
    return as_picture(fdd)


def rows_of_nodes(text):
    """Rows of the table of nodes by number."""
    _, table = text.split("last slot\n")
    return {int(row.split()[0]): row for row in table.split("\n") if row[:4].strip().isdigit()}


def map_places(text):
    """What stands in the map, place by place."""
    rows = re.findall(r"^y? *\d+ \|(.*)$", text, flags=re.MULTILINE)
    return [place for row in rows for place in row.split() if place != "."]


def test_snapshot_is_that_of_the_environment_asked_for():
    world = World(load_scenario("paper/k3-tdd"), num_envs=2)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * 2))
    state, events = world.step(state, np.array([[[0, 1]], [[3, 2]]]))
    first, second = (Snapshot.from_world(world, state, events, env) for env in range(2))
    assert first.auv_positions.tolist() == [[6, 5, 2]]
    assert second.auv_positions.tolist() == [[5, 4, 2]]
    assert (first.charged.tolist(), second.heard.tolist()) == ([1], [2])
    assert first.node_positions.tolist() == [[1, 1, 1], [8, 5, 2], [5, 10, 3]]
    assert first.beta[0] == events.beta[0, 0]
    assert first.splits_slot
    assert (first.slot, first.num_slots, first.maximum_age) == (1, 100, 50)


def test_snapshot_outlives_the_state():
    world = World(load_scenario("paper/k3-fdd"))
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)]))
    snapshot = Snapshot.from_world(world, state, None)
    state.age[:] = 7
    state.energy_j[:] = 7
    assert snapshot.ages.tolist() == [1, 1, 1]
    assert snapshot.energies_j.tolist() == [0, 0, 0]


def test_nobody_charges_in_a_tdd_slot_that_is_all_uplink():
    tdd = replace(situation("tdd"), beta=np.zeros(1))
    assert tdd.charging() == []
    assert len(replace(tdd, beta=np.ones(1)).charging()) == 1
    assert len(replace(tdd, splits_slot=False).charging()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", ["first", "tdd", "three-auvs", "40-nodes", "crowd", "one-cell"])
def test_picture_is_of_one_size_whatever_it_shows(name):
    picture = as_picture(replace(situation(name), title="costs $5_000 and $\\frac \n"))
    assert picture.shape == (600, 960, 3)
    assert picture.dtype == np.uint8
    assert picture.flags.owndata
    assert picture.std() > 10


NOTHING, EVERYTHING = np.full(10, np.nan), np.full(10, np.inf)
FAR = [0.0, 5e-324, 1e-300, 1e-15, 1.0, 1e9, 1e60, 1e300, np.finfo(float).max, -5.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        {"ages": np.array(FAR), "maximum_age": 1e16, "mean_age": 1e15},
        {"energies_j": np.array(FAR), "reference_energy_j": 1e-300, "total_harvested_j": 1e300},
        {"ages": EVERYTHING, "maximum_age": np.inf, "mean_age": np.inf, "jain": np.nan},
        {"energies_j": NOTHING, "reference_energy_j": np.nan, "total_harvested_j": np.nan},
        {"ages": NOTHING, "energies_j": EVERYTHING, "maximum_age": 0.0},
        {"slot": 10**12, "num_slots": 0},
        {"title": "能量 <b>$x_1$</b> \u202e\\frac{ `q` \0\n" + "x" * 10_000},
        {"title": "\ud800 \x1b[31m"},
        {"title": ""},
    ],
    ids=" ".join,
)
def test_any_figures_and_any_name_are_shown(fdd, change):
    strange = replace(fdd, **change)
    assert as_picture(strange).shape == (600, 960, 3)
    text = as_text(strange)
    assert max(cell_len(line) for line in text.split("\n")) <= 100
    assert not set("\0\x1b\ud800") & set(text)
    assert len(text.split("\n")) == len(as_text(fdd).split("\n"))


@pytest.mark.slow
def test_grids_of_any_form_are_shown():
    flat = {"grid.cells": [500, 2, 1], "nodes.cells": [[400, 2, 1]], "nodes.count": 1}
    many = {"nodes.kind": "random", "nodes.count": 200}
    for overrides in (flat | {"auvs.start_cells": [[500, 1, 1]]}, many):
        snapshot = play("paper/k10-fdd", overrides, 2)
        assert as_picture(snapshot).std() > 5
        assert max(map(len, as_text(snapshot).split("\n"))) <= 100


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "utf-8"])
def test_what_the_terminal_cannot_show_is_replaced(monkeypatch, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding, write_through=True)
    monkeypatch.setattr(sys, "stdout", stream)
    print_text("能 … x")
    shown = stream.buffer.getvalue().decode(encoding).removesuffix("\n")
    assert shown == "能 … x".encode(encoding, "replace").decode(encoding)
    monkeypatch.setattr(sys, "stdout", None)
    print_text("nowhere")


@pytest.mark.slow
def test_picture_of_one_snapshot_is_always_the_same(fdd, fdd_picture):
    np.testing.assert_array_equal(as_picture(fdd), fdd_picture)


def moved(array, index, value):
    array = array.copy()
    array[index] = value
    return array


@pytest.mark.slow
@pytest.mark.parametrize(
    "change",
    [
        lambda s: {"auv_positions": moved(s.auv_positions, 0, (1, 2, 3))},
        lambda s: {"ages": moved(s.ages, 0, s.ages[0] + 3)},
        lambda s: {"energies_j": moved(s.energies_j, 0, s.energies_j[0] + 90)},
        lambda s: {"charged": (s.charged + 1) % s.num_nodes},
        lambda s: {"delivered": ~s.delivered},
        lambda s: {"slot": s.slot + 1},
    ],
    ids=["AUV moved", "age", "energy", "charged", "delivered", "slot"],
)
def test_what_changes_in_the_world_changes_text_and_picture(fdd, fdd_picture, change):
    changed = replace(fdd, **change(fdd))
    assert (as_picture(changed) != fdd_picture).any()
    assert as_text(changed) != as_text(fdd)


@some_situation
def test_text_keeps_to_100_columns(name):
    text = as_text(situation(name))
    assert max(len(line) for line in text.split("\n")) <= 100
    assert "\x1b" not in text


def test_text_keeps_to_100_columns_when_every_auv_serves_one_node():
    crowd = situation("crowd")
    one = np.full(crowd.num_auvs, 3)
    text = as_text(replace(crowd, charged=one, heard=one, title="long " * 40))
    assert max(len(line) for line in text.split("\n")) <= 100


def test_text_has_every_node_on_the_map_and_in_the_table(fdd):
    text = as_text(fdd)
    numbers = [str(k) for k in range(1, 11)]
    # The AUV stands beside the number of a node in its cell.
    assert sorted(place.strip("@") for place in map_places(text)) == sorted([*numbers, ""])
    rows = rows_of_nodes(text)
    assert sorted(rows) == list(range(1, 11))
    for k, row in rows.items():
        cell, age = row.split()[1:3]
        assert cell == ",".join(str(c) for c in fdd.node_positions[k - 1])
        assert int(age) == fdd.ages[k - 1]


def test_map_has_x_to_the_right_and_y_up():
    lines = as_text(situation("first")).split("\n")
    top, bottom = (line for line in lines if re.match(r"y? *(10|1) \|", line))
    assert top.split("|")[1].split().index("3") == 4  # node 3 at (5, 10)
    assert bottom.split("|")[1].split().index("1") == 0  # node 1 at (1, 1)


def test_text_marks_what_was_charged_heard_and_delivered(fdd):
    served = replace(fdd, charged=np.array([3]), heard=np.array([6]), delivered=np.array([False]))
    rows = rows_of_nodes(as_text(served))
    assert rows[4].endswith("  charged")
    assert rows[7].endswith("  heard")
    assert not any(re.search("[a-z]{4}", row) for k, row in rows.items() if k not in (4, 7))
    rows = rows_of_nodes(as_text(replace(served, delivered=np.array([True]))))
    assert rows[7].endswith("  heard  delivered")


def test_text_says_which_auv_it_was():
    three = replace(
        situation("three-auvs"),
        charged=np.array([0, 0, 1]),
        heard=np.array([2, 2, 0]),
        delivered=np.array([False, True, False]),
    )
    text = as_text(three)
    rows = rows_of_nodes(text)
    assert rows[1].endswith("charged A,B  heard C")
    assert rows[2].endswith("charged C")
    assert rows[3].endswith("heard A,B  delivered B")
    assert {"A", "B", "C"} <= set("".join(map_places(text)))


def test_text_and_picture_of_auvs_that_name_nobody(fdd):
    nobody = np.array([fdd.num_nodes])
    text = as_text(replace(fdd, charged=nobody, heard=nobody, delivered=np.array([False])))
    assert not any(re.search("[a-z]{4}", row) for row in rows_of_nodes(text).values())
    assert re.search("charged -    heard -    nobody asked", text)
    heard = replace(fdd, charged=nobody, heard=np.array([2]), delivered=np.array([True]))
    assert heard.charging() == []
    assert heard.hearing() == [(0, 2, True)]
    pictures = [as_picture(s) for s in (heard, replace(heard, heard=nobody))]
    assert (pictures[0] != pictures[1]).any()


def test_text_before_the_first_slot_marks_nothing():
    text = as_text(situation("first"))
    assert "slot 0/100" in text
    assert not re.search("charged|heard|delivered|beta", text)


def test_text_of_tdd_gives_beta():
    assert "beta 0.25" in as_text(replace(situation("tdd"), beta=np.array([0.25])))


def test_text_clips_long_tables_and_scales_large_maps():
    text = as_text(situation("crowd"))
    assert sorted(rows_of_nodes(text)) == list(range(1, 41))
    assert "… and 80 more" in text
    assert "… and 18 more AUVs" in text
    assert "one place is 3 x 3 cells" in text
    assert len(text.split("\n")) < 100


@pytest.mark.slow
def test_importing_the_package_loads_no_matplotlib_and_drawing_leaves_none_changed():
    program = """
import sys
import iout_marl.render
assert "matplotlib" not in sys.modules, "loaded by the import"
import matplotlib
from test_render import play
# As a plain dict: to ask rcParams for the backend is to load pyplot.
before = matplotlib.rcParams.copy()
iout_marl.render.as_picture(play("paper/k3-tdd", slots=3))
assert dict.__eq__(matplotlib.rcParams, before), "rcParams changed"
assert "matplotlib.pyplot" not in sys.modules, "pyplot loaded"
"""
    result = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        cwd=__file__.rpartition("/")[0],
        check=False,
    )
    assert result.returncode == 0, result.stderr


def test_nodes_of_one_cell_stand_beside_one_another_within_it():
    cells = np.array([[1, 1], [4, 4], [4, 4], [4, 4], [7, 2], [7, 2]])
    centres, radii = place_nodes(cells, smallest=0.01)
    assert np.abs(centres - cells).max() + radii[1:].max() <= 0.5
    assert centres[0].tolist() == [1, 1]
    for i in range(len(cells)):
        for j in range(i):
            assert np.linalg.norm(centres[i] - centres[j]) > radii[i] + radii[j]


def test_auvs_of_one_cell_are_told_apart():
    cells = np.array([[2, 2], [2, 2], [3, 3]])
    centres, sizes = place_auvs(cells, np.array([[3, 3]]), up=-1, rows=4)
    assert centres[0].tolist() != centres[1].tolist()
    assert centres[2, 1] < 3  # above the node, where the axis runs downwards
    assert (sizes < 1).all()


@pytest.mark.parametrize("up", [1, -1])
@pytest.mark.parametrize("row", [1, 2, 3])
def test_auv_hides_no_node_of_its_cell(up, row):
    nodes = np.array([[2, row]] * 3)
    (auv,), _ = place_auvs(np.array([[2.0, row]]), nodes, up=up, rows=3)
    centres, radii = place_nodes(nodes, smallest=0.01)
    half_height = 0.12  # of a hull beside nodes
    assert (np.abs(auv[1] - centres[:, 1]) > 0.74 * radii + half_height).all()
    assert 0.5 <= auv[1] <= 3.5 or row == 2


def test_layers_of_a_shallow_sea_are_high_enough_to_be_read():
    assert most_stretch(224, columns=12) == pytest.approx(224 / (12 * 18))
    assert most_stretch(224, columns=100) == 1  # no higher than wide
    assert most_stretch(2000, columns=12) == 3


def beams(scene, what):
    """The beams of what passed, as they are drawn from above."""
    from matplotlib.collections import LineCollection
    from matplotlib.colors import to_rgb
    from matplotlib.figure import Figure

    figure = Figure()
    projection = Projection(figure, FROM_ABOVE, scene.grid_shape, (0, 0, 300, 300))
    projection.draw(scene, np.ones((len(scene.nodes), 4)))
    return [
        lines
        for lines in figure.findobj(LineCollection)
        if lines.get_segments()
        and lines.get_alpha()
        and np.allclose(lines.get_color()[0, :3], to_rgb(style.LINKS[what]))
    ]


def test_what_passes_time_and_again_is_one_beam_and_charging_lies_above_packets():
    path = [[[1 + slot % 2, 1, 1]] for slot in range(9)]
    told = [[1]] * 8, [[2]] * 8, [[True]] * 8
    scene = Scene.from_episode((4, 4, 4), [(4, 4, 4), (1, 4, 1)], path, *told)
    (charging,), (packets,) = (beams(scene, what) for what in (Passed.CHARGE, Passed.PACKET))
    assert len(charging.get_segments()) == len(packets.get_segments()) == 2
    assert charging.get_zorder() > packets.get_zorder()


def test_numbers_of_high_bars_do_not_touch():
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(dpi=style.DPI, figsize=(9.6, 6))
    bars = _Bars(figure, style.ENERGIES, 10, 800.0)
    bars.draw(np.full(10, 1320.0), style.ENERGY, ["1320"] * 10)
    bars.panel.title("Stored energy")
    renderer = FigureCanvasAgg(figure).get_renderer()
    *numbers, title = (text.get_window_extent(renderer) for text in figure.texts)
    assert len(numbers) == 10
    assert all(right.x0 - left.x1 > 2 for left, right in pairwise(numbers))
    assert title.y0 - numbers[0].y1 > 2


def test_label_stands_where_it_hides_least():
    places = [(5.0, 4.5), (5.0, 5.5), (6.0, 5.0)]
    below, above = np.array([[5.0, 4.5]]), np.array([5.0, 9.0])
    assert freest(places, (0.3, 0.2), np.array([[1.0, 1.0]]), [], (10, 10)) == 0
    assert freest(places, (0.3, 0.2), below, [], (10, 10)) == 1
    assert freest(places, (0.3, 0.2), below, [(np.array([5.0, 5.0]), above)], (10, 10)) == 2
    assert freest(places, (0.3, 0.2), below, [], (5, 4)) == 0  # rather than outside the grid


def test_axis_of_energies_holds_the_many_and_cuts_the_few():
    assert axis_top(np.zeros(3), 250) == 600
    assert axis_top(np.array([30.0, 1.0, 3.0]), 250) == 40
    assert axis_top(np.array([9000.0, 90.0, 200.0]), 250) == 600
    assert axis_top(np.array([9000.0, 7000.0, 5000.0]), 250) == 8000


@pytest.mark.parametrize(
    ("energy_j", "text"),
    [(0, "0 J"), (4e-14, "0 J"), (252.5, "252 J"), (999.9, "1 kJ"), (1.25e-8, "12.5 nJ")],
)
def test_energies_have_three_digits_and_a_unit(energy_j, text):
    assert energy_text(energy_j) == text


def test_auvs_are_named_as_columns_of_a_sheet():
    assert [auv_name(i) for i in (0, 25, 26, 52)] == ["A", "Z", "AA", "BA"]


def test_steps_are_round():
    assert [round_step(x) for x in (0.1, 1, 1.5, 3, 7, 14, 450)] == [1, 1, 2, 5, 10, 20, 500]


@pytest.mark.slow
def test_cells_are_drawn_in_proportion():
    """A wide cell is as much wider in the picture; one of cubes is drawn as it always was."""
    from matplotlib.figure import Figure

    def drawn(edges_m, shape=(6, 4, 2)):
        figure = Figure(figsize=(4, 4), dpi=100)
        projection = Projection(figure, FROM_ABOVE, shape, (20, 20, 300, 300), edges_m)
        projection.draw_grid()
        (water,) = [a for a in figure.artists if hasattr(a, "get_facecolor") and not lines(a)]
        transform = water.get_transform()
        (box,) = [path.get_extents(transform) for path in water.get_paths()]
        found = next(lines(artist) for artist in figure.artists if lines(artist))
        return round(box.width / box.height, 6), found

    def lines(artist):
        return [line.tolist() for line in getattr(artist, "get_segments", list)()]

    assert drawn((10.0, 10.0, 1.0))[0] == 1.5
    assert drawn((20.0, 10.0, 1.0))[0] == 3
    assert drawn((10.0, 20.0, 1.0))[0] == 0.75
    assert drawn((500.0, 10.0, 1.0))[0] == 4.5  # no more than three to one
    cubes = [[[x, 0.5], [x, 4.5]] for x in np.arange(7) + 0.5]
    cubes += [[[0.5, y], [6.5, y]] for y in np.arange(5) + 0.5]
    assert drawn((7.0, 7.0, 7.0))[1] == cubes
    wide = drawn((20.0, 10.0, 1.0))[1]
    assert wide[:7] == [[[2 * x + 0.5, 0.5], [2 * x + 0.5, 4.5]] for x in range(7)]


@pytest.mark.slow
def test_pictures_do_not_depend_on_those_before_them(fdd_picture):
    """What stays from one picture to the next is kept."""
    others = ["tdd", "one-cell", "40-nodes", "fdd"]
    *_, again = (as_picture(situation(name)) for name in others)
    np.testing.assert_array_equal(again, fdd_picture)


def test_a_film_may_show_where_auvs_came_from(fdd):
    """A scene with a path has a trail beside all that a slot has."""
    from matplotlib.figure import Figure

    still = Scene.from_snapshot(fdd)
    before = fdd.auv_positions + np.array([[[2, 0, 0]], [[1, 0, 0]], [[0, 0, 0]]])
    moving = replace(still, path=before, earlier=(Link(Passed.LOSS, 1, 0, 3),))
    counts = []
    for scene in (still, moving):
        figure = Figure(figsize=(4, 4), dpi=100)
        projection = Projection(figure, FROM_ABOVE, scene.grid_shape, (20, 20, 360, 360))
        projection.draw(scene, np.ones((fdd.num_nodes, 4)))
        trails = [c for c in figure.artists if len(getattr(c, "get_segments", list)()) == 2]
        counts.append(len(trails))
    assert counts == [0, 1]


@pytest.fixture(scope="module")
def sea():
    return situation("sea")


SEA_CHANGES = {
    "battery": {"battery": np.array([0.1, 0.9])},
    "docks": {"docks": np.array([[7, 2, 1]])},
    "no docks": {"docks": None},
    "progress": {"progress": np.array([0.9, 0.9])},
    "heading": {"headings": np.array([[2, 3, 1], [8, 3, 2]]), "transit_slots": np.array([0, 1])},
    "asleep": {"asleep": np.arange(10) < 5},
    "stranded": {"stranded": np.array([True, False])},
}


@pytest.mark.slow
@pytest.mark.parametrize("change", SEA_CHANGES.values(), ids=SEA_CHANGES)
def test_a_picture_of_the_sea_shows_it(sea, change):
    pictures = [as_picture(replace(sea, **each)).astype(int) for each in ({}, change)]
    assert np.abs(pictures[1] - pictures[0]).max() > 50


def test_who_is_stranded_has_the_colour_of_failure(sea):
    fine, stranded = (
        as_picture(replace(sea, stranded=np.array([s, s]), heard=None)) for s in (False, True)
    )
    counts = [
        (np.abs(each[:520, :500] - 255 * rgba(FAILED)[:3]).max(axis=-1) < 6).sum()
        for each in (fine, stranded)
    ]
    assert counts[1] > counts[0] + 100


def test_the_text_says_where_an_auv_is_and_goes_to(sea):
    moving = replace(
        sea,
        headings=np.array([[2, 2, 1], [8, 7, 2]]),
        transit_slots=np.array([0, 2]),
        auv_positions=np.array([[2, 2, 1], [8, 8, 2]]),
        stranded=np.array([False, True]),
    )
    a, b = (line for line in as_text(moving).split("\n") if line.startswith("AUV"))
    assert "in dock" in a
    assert " to " not in a
    assert "to 8,7,2 in 2 slots" in b
    assert b.endswith("stranded")
    one = replace(moving, transit_slots=np.array([0, 1]))
    assert "to 8,7,2 in 1 slot " in as_text(one)


@pytest.mark.parametrize(
    ("slots", "text"), [(0.04, "0.0"), (1, "1"), (2.46, "2.5"), (31.7, "32"), (1e6, "1e+06")]
)
def test_ages(slots, text):
    assert age_text(slots) == text


@pytest.mark.parametrize(
    ("joules", "text"), [(0, "0.00 kJ"), (0.117, "117 mJ"), (5.5, "5.5 J"), (12, "0.01 kJ")]
)
def test_totals_of_energy(joules, text):
    assert total_energy_text(joules) == text
