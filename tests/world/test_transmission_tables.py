"""Transmission loss from tables: what is read, interpolated and refused, what follows from it."""

import json

import numpy as np
import pytest
from loss_tables import as_npz, by_cells, by_range_and_depth
from tiny_study import TINY

from iout_marl import InputError, Trainer, World, bound, evaluate, load_scenario, parts, physics
from iout_marl.core.grid import Grid
from iout_marl.core.pairs import Pairs
from iout_marl.outlook import energy_outlook
from iout_marl.parts.transmission.range_depth import interpolated
from iout_marl.policies.planned import PlannerPolicy
from iout_marl.testing import check_part

FREQUENCIES_KHZ = [40.0, 30.0]
CELLS = (3, 2, 2)
SMALL = {
    "grid.cells": [3, 2, 2],
    "nodes.cells": [[1, 1, 1], [3, 2, 2], [2, 1, 2]],
    "auvs.start_cells": [[2, 2, 1]],
    "episode.duration_s": 500,
    "channel.kind": "sonar",
    "channel.spreading_factor": 2.0,
    "harvester": {"kind": "aperture", "area_m2": 0.05, "efficiency": 0.6},
    "charging.power_w": 2000,
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 3000.0,
        "packet_bits": 8000.0,
        "bandwidth_hz": 4500.0,
        "electronics_w": 0.8,
        "maximum_source_level_db": 180.0,
    },
}
TDD = {"base": "best/k3-tdd", "duplex.beta_rule": "airtime"}


def by_depth(*files, base="paper/k3-fdd", top_depth_m=10.0, **changes):
    transmission = {"kind": "range_depth", "tables": list(files), "top_depth_m": top_depth_m}
    return load_scenario(base, {**SMALL, "channel.transmission": transmission, **changes})


def by_cell(*files, base="paper/k3-fdd", **changes):
    transmission = {"kind": "cells", "tables": list(files)}
    return load_scenario(base, {**SMALL, "channel.transmission": transmission, **changes})


def refused(make, *files, **changes):
    with pytest.raises(InputError) as caught:
        make(*files, **changes)
    text = str(caught.value)
    assert text.isprintable()
    assert text.startswith("override channel.transmission: channel.transmission.")
    return text.partition(": channel.transmission.")[2]


def both_tables(cells, loss_of, frequencies_khz=FREQUENCIES_KHZ):
    """An npz file for all pairs of cells whose loss a function of frequency and (…, 3) says."""
    places = np.stack(np.meshgrid(*map(np.arange, cells), indexing="ij"), axis=-1)
    auv, node = places[:, :, :, None, None, None], places[None, None, None]
    return as_npz(
        frequency_khz=sorted(frequencies_khz),
        loss_db=np.stack([loss_of(khz, auv, node) for khz in sorted(frequencies_khz)]),
    )


def formula_of(scenario):
    """The loss of the formula in place of which the tables stand."""
    sea, edges = scenario.channel, np.array(scenario.grid.edges_m)

    def loss_of(khz, auv, node):
        metres = np.linalg.norm((auv - node) * edges, axis=-1)
        alpha = scenario.channel.part.alpha_db_per_km(khz)
        return physics.transmission_loss_db(metres, alpha, sea.spreading_factor)

    return loss_of


@pytest.mark.parametrize("mode", [{"base": "paper/k3-fdd"}, TDD], ids=["fdd", "tdd"])
@pytest.mark.parametrize("auvs", [1, 2])
def test_a_table_of_the_formula_gives_the_world_of_the_formula(mode, auvs):
    changes = {**mode, "auvs.count": auvs}
    formula = load_scenario(changes.pop("base"), {**SMALL, **changes})
    assert energy_outlook(formula) is None
    table = both_tables(CELLS, formula_of(formula))
    scenario = by_cell(table, base=mode["base"], **changes)
    assert scenario.hash != formula.hash
    found, wanted = (evaluate(each, "greedy", 3, seed=1) for each in (scenario, formula))
    for name, metric in wanted.metrics.items():
        assert found.metrics[name].mean == pytest.approx(metric.mean, rel=1e-9), name


@pytest.mark.parametrize("from_grid", [Pairs.from_cells, Pairs.from_layers])
@pytest.mark.parametrize("shape", [(3, 2, 4), (1, 1, 1), (1, 5, 2), (4, 1, 1)])
def test_every_pair_of_cells_has_an_index_of_its_own_geometry(shape, from_grid):
    grid = Grid(shape, (30.0, 20.0, 7.0))
    pairs = from_grid(grid)
    cells = grid.all_coordinates()
    codes = grid.encode(cells)
    index = pairs.row[codes][:, None] + pairs.column[codes]
    assert index.min() >= 0
    assert index.max() < len(pairs.way_m)
    assert len(np.unique(index)) == len(pairs.way_m)
    steps = cells[:, None] - cells
    assert np.allclose(pairs.way_m[index], grid.metres(steps))
    assert np.allclose(pairs.range_m[index], np.hypot(30 * steps[..., 0], 20 * steps[..., 1]))
    assert (pairs.auv_cells[index][..., 2] == cells[:, None, 2]).all()
    assert (pairs.node_cells[index][..., 2] == cells[:, 2]).all()
    if from_grid == Pairs.from_cells:
        assert (pairs.auv_cells[index] == cells[:, None]).all()
        assert (pairs.node_cells[index] == cells).all()
        assert len(pairs.way_m) == Pairs.count_of_cells(grid)
    else:
        assert len(pairs.way_m) == Pairs.count_of_layers(grid)


def test_interpolation_is_linear_along_each_axis_and_exact_at_points():
    axes = (np.array([0.0, 1.0, 4.0]), np.array([2.0, 3.0]), np.array([5.0]))
    table = np.arange(6.0).reshape(3, 2, 1) ** 2

    def at(*point):
        return interpolated(axes, table, tuple(np.array([x]) for x in point))[0]

    assert at(1.0, 3.0, 5.0) == 9.0
    assert at(4.0, 2.0, 5.0) == 16.0
    assert at(2.5, 2.0, 5.0) == pytest.approx((4 + 16) / 2)
    assert at(2.5, 2.5, 5.0) == pytest.approx((4 + 16 + 9 + 25) / 4)
    assert at(-1.0, 1.0, 9.0) == 0.0


def test_losses_go_by_range_and_both_depths():
    scenario = by_depth(by_range_and_depth(FREQUENCIES_KHZ))
    world = World(scenario)
    encode = world.grid.encode
    for auv, node, range_m, auv_m, node_m in (
        ((0, 0, 0), (2, 1, 1), 100 * 5**0.5, 10, 110),
        ((0, 0, 1), (2, 1, 0), 100 * 5**0.5, 110, 10),
        ((1, 1, 0), (1, 1, 1), 20, 10, 110),
    ):
        offset = world.link.offset(encode(auv), encode(node))
        loss_db = 20 * np.log10(range_m) + 0.03 * auv_m + 0.01 * node_m
        # The share of the frequency is linear in range, not in its logarithm.
        found = world.link.budget.harvested_after_loss_w(loss_db + 0.01 * 40 * range_m / 100)
        assert world.link.harvested_w[offset] == pytest.approx(float(found), rel=0.15)
    up, down = (
        world.link.harvested_w[world.link.offset(encode(a), encode(b))]
        for a, b in (((0, 0, 0), (2, 1, 1)), ((0, 0, 1), (2, 1, 0)))
    )
    assert up / down == pytest.approx(10 ** (0.1 * 0.02 * 100), rel=1e-9)


def test_depths_are_those_of_the_grids_origin():
    origin = {"latitude_deg": 54.0, "longitude_deg": 10.0, "depth_m": 10.0}
    table = by_range_and_depth(FREQUENCIES_KHZ)
    given = by_depth(table, top_depth_m=None, **{"grid.origin": origin})
    assert np.array_equal(World(given).link.harvested_w, World(by_depth(table)).link.harvested_w)
    assert refused(by_depth, table, top_depth_m=None).startswith(
        "top_depth_m: is needed where there is no grid.origin"
    )


def test_one_file_or_several_csv_or_npz_are_the_same():
    together, apart = (
        by_range_and_depth([40.0, 30.0]),
        [by_range_and_depth([khz], name=f"{khz:g}.csv") for khz in (30.0, 40.0)],
    )
    lines = [line.split(",") for line in together.contents.decode().split()]
    columns = dict(zip(lines[0], np.array(lines[1:], dtype=float).T, strict=True))
    axes = {name: np.unique(values) for name, values in columns.items() if name != "loss_db"}
    loss_db = columns["loss_db"].reshape(2, *(len(axes[n]) for n in list(axes)[1:]))[::-1]
    npz = as_npz(**axes, loss_db=loss_db)
    worlds = [World(by_depth(*files)) for files in ([together], apart, [npz])]
    for world in worlds[1:]:
        assert np.array_equal(world.link.harvested_w, worlds[0].link.harvested_w)
        assert np.array_equal(world.link.slot_uplink_j, worlds[0].link.slot_uplink_j)


def axes_of(**changes):
    axes = {
        "frequency_khz": [30.0, 40.0],
        "range_m": [10.0, 100.0, 500.0],
        "auv_depth_m": [0.0, 200.0],
        "node_depth_m": [0.0, 200.0],
    } | changes
    loss_db = axes.pop("loss_db", np.full([len(v) for v in axes.values()], 40.0))
    return as_npz(**axes, loss_db=loss_db)


@pytest.mark.parametrize(
    ("file", "message"),
    [
        (axes_of(range_m=[10.0, 200.0]), "range_m: ends at 200 m, but cells of the grid lie"),
        (axes_of(range_m=[0.01, 0.3]), "range_m: ends at 0.3 m (are these km?), but"),
        (axes_of(range_m=[80.0, 500.0]), "range_m: begins at 80 m: it must begin within half"),
        (axes_of(range_m=[0.0, 500.0]), "range_m: must be above 0"),
        (axes_of(range_m=[500.0, 10.0]), "range_m: must be a list of numbers, each above the one"),
        (axes_of(auv_depth_m=[0.0, 100.0]), "auv_depth_m: reaches from 0 to 100 m, but the cells"),
        (axes_of(node_depth_m=[20.0, 200.0]), "node_depth_m: reaches from 20 to 200 m"),
        (axes_of(frequency_khz=[30.0]), "no table at 40 kHz: there are those at 30 kHz"),
        (axes_of(loss_db=np.full((2, 3, 2), 40.0)), "loss_db: must have 4 axes, frequency_khz"),
        (
            axes_of(loss_db=np.full((2, 4, 2, 2), 40.0)),
            "loss_db: must be of shape (2, 3, 2, 2), by its axes frequency_khz, range_m, auv",
        ),
        (axes_of(loss_db=np.full((2, 3, 2, 2), -40.0)), "not -40 (losses are positive; are these"),
        (axes_of(loss_db=np.full((2, 3, 2, 2), 4000.0)), "between -20 and 300 dB, not 4000"),
        (axes_of(loss_db=np.full((2, 3, 2, 2), np.nan)), "must be a finite number, not nan"),
        (axes_of(depth_m=[1.0]), "unknown array or column 'depth_m'; did you mean"),
        (as_npz(range_m=[1.0]), "lacks frequency_khz, auv_depth_m, node_depth_m, loss_db"),
        (by_cells(FREQUENCIES_KHZ, CELLS), "cells.csv: unknown array or column 'auv_x'"),
    ],
)
def test_tables_that_do_not_fit_are_refused(file, message):
    told = refused(by_depth, file)
    assert told.startswith("tables: ")
    assert message in told


@pytest.mark.parametrize("make", [by_depth, by_cell])
def test_faults_of_a_file_alone_are_not_put_down_to_the_grid(make):
    whole = by_cells(FREQUENCIES_KHZ, CELLS)
    for contents, what in ((b"", "is empty"), (whole.contents[:99], "is no npz file")):
        file = type(whole)("loss.csv" if not contents else "loss.npz", contents)
        told = refused(make, file)
        assert told.startswith(f"tables: {file.path}: {what}")
        assert "grid.cells" not in told


def test_lists_must_have_every_combination_once():
    whole = by_range_and_depth(FREQUENCIES_KHZ)
    lines = whole.contents.split(b"\n")
    for changed, count in ((lines[:-1], "71"), ([*lines, lines[-1]], "73")):
        file = type(whole)("loss.csv", b"\n".join(changed))
        assert "= 72 combinations of frequency_khz, range_m" in refused(by_depth, file)
        assert f"it has {count}, " in refused(by_depth, file)
    twice = [whole, by_range_and_depth([40.0], name="again.csv")]
    assert "loss.csv and again.csv: two tables at 40 kHz" in refused(by_depth, *twice)


def test_tables_for_other_cells_are_refused():
    assert refused(by_cell, by_cells(FREQUENCIES_KHZ, (3, 3, 2))) == (
        "tables: cells.csv: is of 3 × 3 × 2 cells of AUVs and 3 × 3 × 2 of nodes; the grid has "
        "3 × 2 × 2, of which auv_y must be 1 to 2 (grid.cells: override grid.cells)"
    )
    assert "at most 4,000,000: kind range_depth" in refused(
        by_cell, by_cells(FREQUENCIES_KHZ, CELLS), **{"grid.cells": [50, 50, 2]}
    )
    assert refused(by_cell) == "tables: must list at least 1, not 0"


def test_tables_are_in_the_hash_and_formulas_are_not():
    one, other = (
        by_cell(by_cells(khz, CELLS)) for khz in (FREQUENCIES_KHZ, [*FREQUENCIES_KHZ, 50])
    )
    assert one.hash != other.hash
    plain = load_scenario("paper/k3-fdd", SMALL)
    assert plain.channel.transmission.kind == "formula"
    assert load_scenario(plain, {"channel.transmission": "formula"}).hash == plain.hash


def test_a_file_beside_the_scenario(tmp_path, iout):
    (tmp_path / "loss.csv").write_bytes(by_cells(FREQUENCIES_KHZ, CELLS).contents)
    path = tmp_path / "mine.yaml"
    transmission = {"transmission": {"kind": "cells", "tables": ["loss.csv"]}}
    own = {**{key: value for key, value in SMALL.items() if "." not in key}}
    path.write_text(
        "extends: paper/k3-fdd\n"
        "grid: {cells: [3, 2, 2]}\n"
        "nodes: {cells: [[1, 1, 1], [3, 2, 2], [2, 1, 2]]}\n"
        "auvs: {start_cells: [[2, 2, 1]]}\n"
        f"harvester: {json.dumps(own['harvester'])}\n"
        f"channel: {json.dumps({'kind': 'sonar', **transmission})}\n"
    )
    status, shown, _ = iout("show", path)
    assert status == 0
    assert "loss.csv" in shown
    assert load_scenario(path).hash in shown


@pytest.mark.slow
@pytest.mark.parametrize("make", [by_depth, by_cell])
def test_bounds_hold_and_the_planner_runs(make):
    file = {by_depth: by_range_and_depth, by_cell: lambda f: by_cells(f, CELLS)}[make]
    scenario = make(file(FREQUENCIES_KHZ), **{"episode.duration_s": 250})
    assert energy_outlook(scenario) is None
    played = evaluate(scenario, PlannerPolicy(), 1).metrics["mean_aoi"].mean
    assert bound(scenario, seconds=0.5).best <= played + 1e-9


def thermocline(loss_db):
    """A rule of a user's own: sound loses so much between two layers."""

    @parts.transmissions.register("thermocline", version=1)
    class Thermocline(parts.Transmission):
        """Spherical, and 10 dB across a thermocline between two layers."""

        def pairs(self, grid):
            return Pairs.from_layers(grid)

    Thermocline.loss_db = loss_db


def across_layers(self, scenario, pairs, frequency_khz):
    is_across = pairs.auv_cells[:, 2] != pairs.node_cells[:, 2]
    return 20 * np.log10(np.maximum(pairs.way_m, 1.0)) + 10.0 * is_across


@pytest.mark.slow
def test_a_rule_of_ones_own_keeps_the_contracts(forgotten_parts):
    thermocline(across_layers)
    check_part("transmission", "thermocline", overrides={"channel.kind": "sonar"})


@pytest.mark.parametrize(
    ("loss_db", "message"),
    [
        (lambda *_: 40.0, "loss_db must be a number for each of 60 pairs, not float64 of shape ()"),
        (lambda self, _, pairs, __: pairs.way_m * np.nan, "loss_db is not finite at 30 kHz"),
        (lambda *_: 1 / 0, "raises ZeroDivisionError"),
    ],
    ids=["shape", "nan", "raises"],
)
def test_a_rule_that_states_something_else_is_refused(forgotten_parts, loss_db, message):
    thermocline(loss_db)
    with pytest.raises(InputError) as caught:
        load_scenario("paper/k3-fdd", {**SMALL, "channel.transmission": "thermocline"})
    assert message in str(caught.value)


def test_where_no_sound_arrives_the_outlook_says_so():
    deaf = axes_of(loss_db=np.full((2, 3, 2, 2), 290.0))
    assert "from every cell that AUVs reach each is out of range" in energy_outlook(by_depth(deaf))


@pytest.mark.slow
def test_trainings_run_on_tables(tmp_path):
    table = by_cells(FREQUENCIES_KHZ, (3, 2, 1))
    changes = {**TINY, "channel.transmission": {"kind": "cells", "tables": [table]}}
    trainer = Trainer(load_scenario("paper/k3-fdd", {**SMALL, **changes}))
    trainer.iterate()
    trainer.save(tmp_path / "run")
    assert evaluate(load_scenario(tmp_path / "run/scenario.yaml"), "greedy", 1).metrics
