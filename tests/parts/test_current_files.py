"""Currents from files: how they are read, and what is said of those that do not fit."""

import numpy as np
import pytest
from batteries import BATTERY
from current_files import ORIGIN, csv_file, uneven

from iout_marl import InputError, World, load_scenario
from iout_marl.core.geography import Place
from iout_marl.parts.current.records import read_record
from iout_marl.scenario import bundled_root
from iout_marl.scenario.data_files import DataFile

VEHICLE = {**BATTERY, "max_speed_m_per_s": 6.0}
AXES = ([0.0, 9000.0], [0.0, 900.0], [-50.0, 950.0], [-50.0, 950.0])


def calm(t, z, x, y):
    return 0.2, 0.1


def in_scenario(file, **changes):
    current = {"kind": "file", "file": file, **changes.pop("current", {})}
    base = {"vehicle": VEHICLE, "grid.origin": ORIGIN, "current": current}
    return load_scenario("paper/k3-fdd", {**base, **changes})


def frames(scenario):
    return scenario.current.part.frames(scenario)


def model(tmp_path, names=("uo", "vo"), axes=("time", "depth", "latitude", "longitude"), **changes):
    """A NetCDF file as an ocean model writes it, about the origin of the tests' grids."""
    xr = pytest.importorskip("xarray")
    pytest.importorskip("h5netcdf")
    pytest.importorskip("pyproj")
    times, depths_m = np.arange(4.0), changes.get("depths_m", np.array([0.5, 60.0, 900.0]))
    north = 60.2 + changes.get("north", np.linspace(-0.012, 0.012, 9))
    east = 5.1 + changes.get("east", np.linspace(-0.012, 0.03, 15))
    shape = (len(times), len(depths_m), len(north), len(east))
    u = 0.2 + 0.1 * np.arange(4)[:, None, None, None] + np.zeros(shape)
    v = -0.3 + 10 * (north - 60.2)[:, None] + np.zeros(shape)
    u, v = (changes.get("factor", 1) * each for each in (u, v))
    if (land := changes.get("land")) is not None:
        u[..., land, :], v[..., land, :] = np.nan, np.nan
    data = xr.Dataset(
        {names[0]: (axes, u), names[1]: (axes, v)},
        {
            axes[0]: (axes[0], times, {"units": "hours since 2024-06-01"}),
            axes[1]: depths_m,
            axes[2]: north,
            axes[3]: east % 360 if changes.get("from_zero") else east,
        },
    )
    data = data.isel({axes[2]: slice(None, None, -1)}) if changes.get("from_north") else data
    path = tmp_path / "model.nc"
    data.to_netcdf(path, engine=changes.get("engine", "h5netcdf"))
    return DataFile.read(str(path))


HYCOM = {"names": ("water_u", "water_v"), "axes": ("time", "depth", "lat", "lon")}


@pytest.mark.slow
@pytest.mark.parametrize(
    "changes",
    [
        {},
        HYCOM,
        {"names": ("u", "v")},
        {"from_north": True},
        {"from_zero": True},
        {"engine": "scipy"},
    ],
    ids=["copernicus", "hycom", "generic", "from-north", "from-zero", "netcdf3"],
)
def test_netcdf_of_models(tmp_path, changes):
    scenario = in_scenario(model(tmp_path, **changes), **{"episode.duration_s": 5000})
    found, place = frames(scenario), Place(scenario.grid)
    cells = np.stack(np.unravel_index(np.arange(len(found.field(0))), scenario.grid.cells), -1) + 1
    latitude = place.geodetic(place.local(cells))[:, 0]
    for slot in (0, 150):
        hours = (slot + 0.5) * scenario.slot_s / 3600
        east, north = 0.2 + 0.1 * hours, -0.3 + 10 * (latitude - 60.2)
        bearing = np.radians(ORIGIN["bearing_deg"])
        expected = np.stack(
            [
                east * np.cos(bearing) - north * np.sin(bearing),
                east * np.sin(bearing) + north * np.cos(bearing),
            ],
            axis=-1,
        )
        assert found.field(slot) == pytest.approx(expected, abs=1e-6)


def test_the_bay_has_a_file_that_comes_with_the_package(tmp_path):
    pytest.importorskip("h5netcdf")
    vehicle = {"vehicle.max_speed_m_per_s": 2.5, "observation.entries": ["battery", "current"]}
    current = {"kind": "file", "file": "bay_currents.nc", "repeats": True}
    scenario = load_scenario("sea/bay", {"current": current, **vehicle})
    assert (bundled_root() / "data" / "bay_currents.nc").stat().st_size < 50_000
    assert 0.25 < frames(scenario).strongest_m_per_s() < 0.5
    # Its end is its beginning.
    record = read_record(scenario.current.file)
    first, last = record.velocity_m_per_s[0], record.velocity_m_per_s[-1]
    assert first == pytest.approx(last, abs=2e-4)
    world = World(scenario)
    state = world.reset()
    assert np.isfinite(world.observe(state)).all()


def test_a_file_that_repeats_goes_on():
    file = csv_file([0.0, 300.0, 1000.0], [0.0, 900.0], [-50.0, 950.0], [-50.0, 950.0], uneven)
    found = frames(in_scenario(file, current={"repeats": True}))
    # Slots of 25 s: 40 of them are the cycle.
    assert found.field(3) == pytest.approx(found.field(43), abs=1e-9)
    assert np.abs(found.field(3) - found.field(23)).max() > 1e-3


def test_a_file_of_one_field_is_steady():
    assert frames(in_scenario(csv_file([0.0], *AXES[1:], uneven))).is_steady


def test_a_file_without_depths_is_the_same_at_all():
    text = csv_file([0.0], [0.0], *AXES[2:], uneven).contents.decode()
    lines = [",".join(line.split(",")[2:]) for line in text.split("\n")]
    found = frames(in_scenario(DataFile("flat.csv", "\n".join(lines).encode()))).field(0)
    layers = found.reshape(-1, load_scenario("paper/k3-fdd").grid.cells[2], 2)
    assert (layers == layers[:, :1]).all()
    assert np.ptp(found[:, 0]) > 0.1


def test_land_where_no_cell_needs_it_does_no_harm(tmp_path):
    assert np.isfinite(frames(in_scenario(model(tmp_path, land=0))).velocity_m_per_s).all()


REFUSED = {
    "does not cover the grid towards +x: it ends at x 700, cells reach to 900, 200 m farther": (
        csv_file(*AXES[:2], [-50.0, 700.0], AXES[3], calm)
    ),
    "does not cover the grid towards −y: it ends at y 10, cells reach to 0, 10 m farther": (
        csv_file(*AXES[:3], [10.0, 950.0], calm)
    ),
    "depths reach down to 0.9 m (are these km?), but cells of the grid to": (
        csv_file(AXES[0], [0.0, 0.9], *AXES[2:], calm)
    ),
    "covers 0.2778 h, but the episode takes it to": csv_file([0.0, 1000.0], *AXES[1:], calm),
    "velocities of up to 20 m/s are implausible: usual are 0 to 5 m/s (are these cm/s?)": (
        csv_file(*AXES, lambda *_: (20.0, 10.0))
    ),
    "velocities of up to 900 m/s are implausible: usual are 0 to 5 m/s (are these mm/s?)": (
        csv_file(*AXES, lambda *_: (900.0, 10.0))
    ),
    "(NaN, as on land) at ": csv_file(
        *AXES, lambda t, z, x, y: (float("nan") if x > 900 and y < 0 else 0.1, 0.1)
    ),
    "holds no velocity: all are NaN": csv_file(*AXES, lambda *_: (float("nan"), 0.1)),
    "has no column water_u or uo or u; did you mean 'uu'?": DataFile(
        "a.csv", b"x_m,y_m,uu,v\n0,0,1,1\n"
    ),
    "has no column y_m or y; it has x_m, u, v": DataFile("a.csv", b"x_m,u,v\n0,1,1\n"),
    "must have one line for each of 2 × 2 = 4 combinations of y_m, x_m; it has 2": DataFile(
        "a.csv", b"x_m,y_m,u,v\n0,0,1,1\n1,1,1,1\n"
    ),
    "is neither a CSV file, by its name, nor NetCDF, by its contents": DataFile("a.nc", b"GRIB"),
}


@pytest.mark.parametrize("message", REFUSED)
def test_refused_in_a_line(message):
    with pytest.raises(InputError) as refused:
        in_scenario(REFUSED[message])
    assert message in str(refused.value)
    assert "current.file" in str(refused.value)
    assert "\n" not in str(refused.value)


MODELS = {
    "does not cover the grid towards east: it ends at longitude 5.103, ": {
        "east": np.linspace(-0.012, 0.003, 9)
    },
    "does not cover the grid towards south": {"north": np.linspace(0.001, 0.02, 9)},
    "(are these km?)": {"depths_m": np.array([0.0, 0.4])},
    "are these cm/s?": {"factor": 100},
    "has no velocity (NaN, as on land) at ": {"land": slice(4, None)},
    "has no variable water_u or uo or u; did you mean": {"names": ("u0", "v0")},
    "dimension 'level', which no current has": {"axes": ("time", "level", "latitude", "longitude")},
}


@pytest.mark.slow
@pytest.mark.parametrize("message", MODELS)
def test_netcdf_refused_in_a_line(tmp_path, message):
    file = model(tmp_path, **MODELS[message])
    with pytest.raises(InputError) as refused:
        in_scenario(file, **{"episode.duration_s": 5000})
    assert message in str(refused.value)
    assert "\n" not in str(refused.value)


def test_damaged_netcdf_is_refused_in_a_line(tmp_path):
    contents = model(tmp_path).contents
    for damaged in (contents[:300], contents[:1000] + bytes(500), b"CDF\x01" + bytes(40)):
        with pytest.raises(InputError, match=r"is no NetCDF file, or a|has no variable") as refused:
            in_scenario(DataFile("model.nc", damaged))
        assert "\n" not in str(refused.value)


def test_needs_a_place_on_earth():
    file = csv_file(*AXES, calm)
    with pytest.raises(InputError, match=r"'file' needs grid\.origin"):
        in_scenario(file, **{"grid.origin": None})


def test_needs_packages_for_netcdf(monkeypatch):
    from iout_marl import extras

    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    bay = DataFile.read("bay_currents.nc")
    read_record.cache_clear()
    with pytest.raises(InputError, match=r"needs xarray: pip install -e '\.\[currents\]'"):
        read_record(bay)


def test_values_at_points_of_the_file_are_those_of_the_file():
    file = csv_file(
        [0.0, 9000.0],
        [4.0, 104.0, 900.0],
        [0.0, 100.0, 950.0],
        [0.0, 200.0, 950.0],
        uneven,
    )
    scenario = in_scenario(file, **{"grid.origin": {**ORIGIN, "bearing_deg": 0.0}})
    found, cells = frames(scenario), scenario.grid.cells
    for x, y, z in ((0, 0, 0), (1, 2, 1)):
        code = np.ravel_multi_index((x, y, z), cells)
        weight = found.weight[7]
        first, second = (uneven(t, 4.0 + 100 * z, 100.0 * x, 100.0 * y) for t in (0.0, 9000.0))
        expected = (1 - weight) * np.array(first) + weight * np.array(second)
        assert found.field(7)[code] == pytest.approx(expected)
