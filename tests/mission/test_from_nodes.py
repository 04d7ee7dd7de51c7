"""`iout scenario from-nodes`: nodes that are somewhere become a scenario, or one clear line."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest
from pyproj import Proj

from iout_marl import load_scenario
from iout_marl.mission import Place

LATITUDE, LONGITUDE = 41.18, -8.7
#: Metres to the east and north, and depths.
NODES = [(0, 0, 12), (610, 420, 55.5), (330, 160, 140), (335, 158, 145)]


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def on_earth(latitude=LATITUDE, longitude=LONGITUDE, nodes=NODES):
    plane = Proj(proj="aeqd", lat_0=latitude, lon_0=longitude, ellps="WGS84")
    return [(*plane(east, north, inverse=True)[::-1], depth) for east, north, depth in nodes]


def as_csv(places, header="lat,lon,depth", delimiter=","):
    lines = [header, *(delimiter.join(map(repr, place)) for place in places)]
    return "\n".join(lines) + "\n"


def as_geojson(places, *, by_height=False):
    def feature(latitude, longitude, depth):
        coordinates = [longitude, latitude, -depth] if by_height else [longitude, latitude]
        own = {} if by_height else {"Depth (m)": depth}
        point = {"type": "Point", "coordinates": coordinates}
        return {"type": "Feature", "geometry": point, "properties": own}

    return json.dumps({"type": "FeatureCollection", "features": [feature(*p) for p in places]})


FILES = {
    "lat-lon.csv": as_csv,
    "tolerant.csv": lambda places: (
        "\ufeff# surveyed\n\n" + as_csv(places, " Latitude [deg] ;LNG;Depth_m", ";") + ";;\n"
    ),
    "indented.csv": lambda places: (
        " \t# by hand, on a calm day, twice\n\t#,,,\n" + as_csv(places, "lat;lon;depth", ";")
    ),
    "tabs.csv": lambda places: as_csv(places, "latitude_deg\tLONG\tz (metres)", "\t"),
    "depths.geojson": as_geojson,
    "heights.json": lambda places: as_geojson(places, by_height=True),
}


@pytest.mark.parametrize(
    ("latitude", "longitude"), [(41.18, -8.7), (-54.2, 179.9995), (0, 0), (71, -180)]
)
def test_a_grid_is_laid_around_nodes_anywhere(iout, latitude, longitude):
    Path("n.csv").write_text(as_csv(on_earth(latitude, longitude)))
    status, _, err = iout("scenario", "from-nodes", "n.csv", "--out", "mine")
    assert (status, err) == (0, "")
    made = load_scenario("mine")
    assert made.grid.cells == (7, 5, 2)
    assert made.nodes.cells == ((1, 1, 1), (7, 5, 1), (4, 3, 2), (4, 3, 2))
    assert made.auvs.start_cells == ((5, 5, 2),)


@pytest.mark.parametrize("name", FILES)
def test_files_of_all_kinds_say_the_same(iout, name):
    places = on_earth()
    Path(name).write_text(FILES[name](places), encoding="utf-8")
    words = ("scenario", "from-nodes", name, "--out", "mine.yaml", "--from", "best/k3-tdd")
    status, out, err = iout(*words, "--set", "grid.spacing_m=50", "--set", "auvs.count=2")
    assert (status, err) == (0, "")
    made = load_scenario("mine.yaml")
    assert made.duplex.kind == "tdd"
    assert made.num_auvs == 2
    # The nodes lie where they were, but for what the command says.
    place = Place(made.grid)
    away = place.local(made.nodes.cells) - place.from_geodetic(places)
    moved = np.linalg.norm(away, axis=1)
    assert np.abs(away).max() <= 25.001
    rows = [line.split("│")[1:-1] for line in out.splitlines() if line.startswith("│")]
    assert [float(row[-1]) for row in rows] == pytest.approx(moved, abs=0.051)
    assert f"moved by {moved.mean():.1f} m on average, {moved.max():.1f} m at most" in out


def test_what_lies_in_one_cell_is_said(iout):
    Path("n.csv").write_text(as_csv(on_earth()))
    out = iout("scenario", "from-nodes", "n.csv", "--out", "mine")[1]
    assert "note: nodes 3 and 4 are in one cell, [4, 3, 2]" in out.splitlines()
    words = ("scenario", "from-nodes", "n.csv", "--out", "fine", "--set", "grid.spacing_m=4")
    assert "note" not in iout(*words)[1]


def test_nodes_snap_to_cells_that_are_no_cubes(iout, refused):
    places = on_earth()
    Path("n.csv").write_text(as_csv(places))
    words = ("scenario", "from-nodes", "n.csv", "--out", "mine")
    flat = ("--set", "grid.spacing_m=[100,60,10]", "--set", "grid.own_cell_distance=mean")
    status, _, err = iout(*words, *flat)
    assert (status, err) == (0, "")
    made = load_scenario("mine")
    assert made.grid.edges_m == (100, 60, 10)
    assert made.grid.own_cell_distance == "mean"
    assert made.grid.cells == (7, 8, 14)
    place = Place(made.grid)
    away = place.local(made.nodes.cells) - place.from_geodetic(places)
    assert (np.abs(away) <= np.array([50, 30, 5]) + 0.001).all()
    origin = f"grid.origin={{latitude_deg: {LATITUDE}, longitude_deg: {LONGITUDE}}}"
    again = refused(*words[:-1], "again", *flat, "--set", origin)
    assert "of 10×10×4 cells of 100 × 60 × 10 m; " in again


def test_a_grid_that_has_a_place_keeps_it(iout, refused):
    Path("n.csv").write_text(as_csv(on_earth()))
    origin = (
        f"grid.origin={{latitude_deg: {LATITUDE}, longitude_deg: {LONGITUDE}, bearing_deg: 90}}"
    )
    words = ("scenario", "from-nodes", "n.csv", "--out", "mine", "--set", origin)
    # +x points south: node 2 lies north of the origin.
    assert refused(*words).startswith(
        "n.csv:3: lies outside the grid, in cell [-3, 7, 2] of 10×10×4 cells of 100 m; cell "
    )
    turned = origin.replace("90", "0")
    assert iout(*words[:-1], turned)[0] == 0
    assert load_scenario("mine").grid.cells == (10, 10, 4)
    assert load_scenario("mine").nodes.cells[1] == (7, 5, 2)


@pytest.mark.parametrize("depth", ["z", "Depth"])
def test_metres_need_neither_place_nor_library(iout, monkeypatch, depth):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    Path("n.csv").write_text(f"id,X,Y (m),{depth}\na,-49,0,0\nb,160,249.9,130\n")
    assert iout("scenario", "from-nodes", "n.csv", "--out", "mine")[0] == 0
    made = load_scenario("mine")
    assert made.nodes.cells == ((1, 1, 1), (3, 3, 2))
    assert made.grid.origin is None


def test_starts_outside_a_small_grid_move_to_its_middle(iout):
    Path("n.csv").write_text(as_csv(on_earth(nodes=[(0, 0, 5), (190, 200, 5)])))
    words = ("--set", "auvs={count: 3, motion: hover}")
    status, out, _ = iout("scenario", "from-nodes", "n.csv", "--out", "mine", *words)
    assert status == 0
    moved = "; start cells outside the grid moved to its middle, [2, 2, 1]"
    assert moved in out
    assert moved in Path("mine.yaml").read_text().splitlines()[0]
    made = load_scenario("mine")
    assert made.grid.cells == (3, 3, 1)
    assert (made.auvs.start_cells, made.num_auvs) == (((2, 2, 1),), 3)
    assert made.auvs.motion.kind == "hover"


NEW = "x,y,z\n0,0,0\n100,0,0\n"


@pytest.mark.parametrize(
    ("settings", "expected"),
    [
        (["grid.cells=[2,1,1]"], {"grid": (2, 1, 1), "starts": ((1, 1, 1),)}),
        (["nodes.weights=[1,2]"], {"weights": (1, 2)}),
        (["nodes={kind: fixed, weights: [3, 4]}"], {"weights": (3, 4)}),
        (["nodes.count=1"], {"nodes": 1}),
        (
            ["auvs.start_cells=[[1,1,1],[2,1,1]]", "grid.cells=[2,1,1]"],
            {"starts": ((1, 1, 1), (2, 1, 1)), "auvs": 2},
        ),
        (["auvs.count=2", "grid.cells=[2,1,1]"], {"starts": ((1, 1, 1),), "auvs": 2}),
    ],
    ids=["grid", "weights", "nodes", "count", "starts", "auvs"],
)
@pytest.mark.parametrize("source", ["paper/k3-fdd", "random/k5-fdd"])
def test_settings_are_of_the_new_nodes_and_grid(iout, settings, expected, source):
    Path("n.csv").write_text(NEW)
    words = [word for setting in settings for word in ("--set", setting)]
    line = iout("scenario", "from-nodes", "n.csv", "--out", "mine", "--from", source, *words)
    assert (line[0], line[2]) == (0, "")
    made = load_scenario("mine")
    found = {
        "grid": made.grid.cells,
        "starts": made.auvs.start_cells,
        "weights": made.node_weights,
        "nodes": made.num_nodes,
        "auvs": made.num_auvs,
    }
    assert expected.items() <= found.items()
    assert ("moved to its middle" in line[1]) == (
        "grid.cells=[2,1,1]" in settings and "auvs.start_cells" not in settings[0]
    )


@pytest.mark.parametrize(
    ("setting", "line"),
    [
        ("nodes.cells=[[1,1,1]]", "--set nodes.cells=[[1,1,1]]: nodes lie where the file says"),
        ("nodes.kind=random", "--set nodes.kind=random: nodes lie where the file says"),
        ("nodes.weights=[1,2,3]", "n.csv: nodes.weights: must list one weight for each of the 2"),
        ("nodes=3", "--set nodes=3: nodes: "),
        ("auvs=3", "--set auvs=3: auvs: "),
        ("grid=3", "--set grid=3: grid: "),
        ("grid.cells=[1,1,1]", "n.csv:3: lies outside the grid, in cell [2, 1, 1] of 1×1×1 cells"),
        ("auvs.start_cells=[[11,1,1]]", "--set auvs.start_cells=[[11,1,1]]: auvs.start_cells[0]: "),
    ],
    ids=["cells", "kind", "weights", "no-nodes", "no-auvs", "no-grid", "small-grid", "starts"],
)
def test_settings_that_fit_no_new_nodes_or_grid(refused, setting, line):
    Path("n.csv").write_text(NEW)
    words = ("scenario", "from-nodes", "n.csv", "--out", "mine", "--set", setting)
    assert refused(*words).startswith(line)
    assert not Path("mine.yaml").exists()


def test_weights_of_other_nodes_are_left_behind(iout):
    Path("own.yaml").write_text("extends: paper/k3-fdd\nnodes: {weights: [1, 2, 3]}\n")
    Path("n.csv").write_text("x,y,z\n0,0,0\n100,0,0\n")
    assert iout("scenario", "from-nodes", "n.csv", "--out", "mine", "--from", "own.yaml")[0] == 0
    assert load_scenario("mine").node_weights == (1, 1)


NEEDED = "latitude, longitude and depth, or x, y and z, are needed"
BAD = {
    "empty": ("n.csv", "", "n.csv: is empty; a line of headings is needed"),
    "no-rows": ("n.csv", "x,y,z\n", "n.csv: has no nodes; 1 to 4,000 are allowed"),
    "no-depth": ("n.csv", "lat,lon\n1,2\n", f"n.csv:1: has no column for the depth: {NEEDED}"),
    "typo": (
        "n.csv",
        "# a\nlatt,lon,z\n1,2,3\n",
        f"n.csv:2: has no column for the latitude: {NEEDED}; did you mean 'lat'?",
    ),
    "nothing-known": (
        "n.csv",
        "a,b\n1,2\n",
        f"n.csv:1: has no column for the latitude: {NEEDED}; there are 'a', 'b'",
    ),
    "other-words": (
        "n.csv",
        "breite,laenge,tiefe\n1,2,3\n",
        f"n.csv:1: has no column for the latitude: {NEEDED}; there are 'breite', 'laenge', 'tiefe'",
    ),
    "both-kinds": (
        "n.csv",
        "lat,lon,x,y,z\n1,2,3,4,5\n",
        f"n.csv:1: has columns of both kinds; only {NEEDED}",
    ),
    "twice": (
        "n.csv",
        "x,y,z,Depth\n1,2,3,4\n",
        "n.csv:1: has two columns for the depth: 'z' and 'Depth'",
    ),
    "word": (
        "n.csv",
        "x,y,z\n\n1,2,3\n1,two,3\n",
        "n.csv:4: column 'y': must be a number, not 'two'",
    ),
    "nan": ("n.csv", "x,y,z\n1,nan,3\n", "n.csv:2: column 'y': must be a number, not 'nan'"),
    "empty-cell": ("n.csv", "x,y,z\n1,,3\n", "n.csv:2: column 'y': must be a number, not ''"),
    "short": ("n.csv", "x,y,z\n1,2\n", "n.csv:2: has 2 of 3 columns: no 'z'"),
    "long": ("n.csv", "x,y,z\n1,2,3,4\n", "n.csv:2: has 4 of 3 columns"),
    "quote": ("n.csv", 'x,y,z\n1,2,"3\n', "n.csv:2: is no CSV: unexpected end of data"),
    "latitude": (
        "n.csv",
        "Lat,lon,z\n91,2,3\n",
        "n.csv:2: column 'Lat': must be at most 90 on either side of 0, not 91",
    ),
    "surface": (
        "n.csv",
        "x,y,z\n1,2,-3\n",
        "n.csv:2: column 'z': -3 m is above the surface; depths point down",
    ),
    "outside": (
        "n.csv",
        "x,y,z\n1,2,3\n1000,2,3\n",
        "n.csv:3: lies outside the grid, in cell [11, 1, 1] of 10×10×4 cells of 100 m; --set '",
    ),
    "far": (
        "n.csv",
        "x,y,z\n1e300,2,3\n",
        "n.csv:2: column 'x': must be at most 1e+09 on either side of 0, not 1e+300",
    ),
    "too-large": (
        "n.csv",
        "lat,lon,z\n0,0,3\n9,9,3\n",
        "n.csv: the nodes lie so far apart that a grid around them has 9,937",
    ),
    "no-json": ("n.geojson", "{", "n.geojson: is no JSON: "),
    "no-collection": (
        "n.geojson",
        '{"type": "Point"}',
        "n.geojson: must be a FeatureCollection, whose features are Points",
    ),
    "line": (
        "n.geojson",
        json.dumps(
            {
                "type": "FeatureCollection",
                "features": [{"type": "Feature", "geometry": {"type": "LineString"}}],
            }
        ),
        "n.geojson: feature 1: must be a Point, not 'LineString'",
    ),
    **{
        f"properties-{given}": (
            "n.geojson",
            as_geojson([(1.0, 2.0, 3.0)], by_height=True).replace("{}", given),
            f"n.geojson: feature 1: properties: must be an object or null, not {shown}",
        )
        for given, shown in {"[1]": "[1]", '"z"': "'z'", "7": "7", "[]": "[]"}.items()
    },
    "no-geojson-depth": (
        "n.geojson",
        as_geojson([(1.0, 2.0, 3.0)]).replace("Depth", "Deep"),
        "n.geojson: feature 1: has no depth, neither in its properties nor as minus its height",
    ),
    "height-in-the-air": (
        "n.geojson",
        as_geojson([(1.0, 2.0, -3.0)], by_height=True),
        "n.geojson: feature 1: minus the height: -3 m is above the surface; depths point down",
    ),
    "latin-1": ("n.csv", "x,y,z,ö\n".encode("latin-1"), "n.csv: must be UTF-8 text"),
}


@pytest.mark.parametrize(("name", "text", "line"), BAD.values(), ids=BAD)
def test_bad_files_are_refused_by_line_and_column(refused, name, text, line):
    Path(name).write_bytes(text if isinstance(text, bytes) else text.encode())
    assert refused("scenario", "from-nodes", name, "--out", "mine").startswith(line)
    assert not Path("mine.yaml").exists()


def test_nothing_is_written_over_or_made_of_nothing(refused):
    Path("n.csv").write_text("x,y,z\n1,2,3\n")
    Path("mine.yaml").write_text("mine")
    words = ("scenario", "from-nodes")
    there = "mine.yaml: is there already, and is not written over: name another file"
    assert refused(*words, "n.csv", "--out", "mine") == there
    assert Path("mine.yaml").read_text() == "mine"
    assert refused(*words, "no.csv", "--out", "new") == "no.csv: no such file"
    assert refused(*words, ".", "--out", "new") == ".: cannot be read: it is no regular file"
    assert "no scenario 'nowhere'" in refused(*words, "n.csv", "--out", "n", "--from", "nowhere")
    assert "unknown key" in refused(*words, "n.csv", "--out", "n", "--set", "grid.spacing=4")
    assert "Missing command" in refused("scenario")


def test_places_on_earth_need_the_library(refused, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyproj", None)
    Path("n.csv").write_text(as_csv([(1.0, 2.0, 3.0)]))
    line = refused("scenario", "from-nodes", "n.csv", "--out", "mine")
    assert line.endswith("needs pyproj: pip install -e '.[mission]' in the clone")
    assert not Path("mine.yaml").exists()


def test_names_of_files_are_text(iout):
    Path("a\nb: c.csv").write_text("x,y,z\n1,2,3\n")
    assert iout("scenario", "from-nodes", "a\nb: c.csv", "--out", "mine")[0] == 0
    assert load_scenario("mine").description == "Nodes of a\nb: c.csv"
