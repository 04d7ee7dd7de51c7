"""`evaluate --nodes`: every node and every AUV by itself, which add up to the whole."""

import json

import numpy as np
import pytest
from batteries import BATTERY, DOCKS

from iout_marl import World, evaluate, load_scenario, record_episode
from iout_marl.breakdown import AUV_COLUMNS, NODE_COLUMNS, STORE_COLUMNS, VEHICLE_COLUMNS
from iout_marl.cli_tables import show_breakdown
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline

FLAT = {"grid.spacing_m": [90, 120, 30], "grid.own_cell_distance": "mean", "auvs.motion": "hover"}
SCENARIOS = ["paper/k5-fdd", "best/k5-tdd", "multi/m3-k10-fdd"]


@pytest.mark.parametrize("scenario", [*SCENARIOS, "flat cells"])
def test_columns_are_sums_over_the_slots_of_each_episode(scenario):
    changed = ("paper/k5-fdd", FLAT) if scenario == "flat cells" else (scenario, None)
    loaded = load_scenario(*changed)
    found = evaluate(loaded, "random-walk", 4, 7, breakdown=True).breakdown
    world = World(loaded, 4)
    nodes, auvs = (4, world.num_nodes), (4, world.num_auvs)
    ages, peak = np.zeros(nodes), np.zeros(nodes)
    harvested, spent = np.zeros(nodes), np.zeros(nodes)
    way, moves, packets, given = (np.zeros(auvs) for _ in range(4))
    before = None
    cells = world.grid.coordinate_table()
    for state, events in play(world, make_baseline("random-walk"), 7):
        if events is not None:
            ages += state.age
            peak = np.maximum(peak, state.age)
            steps = (cells[state.cell] - cells[before]) * np.array(loaded.grid.spacing_m)
            step = np.linalg.norm(steps, axis=-1)
            way += step
            moves += step > 0
            for e, m in np.ndindex(*auvs):
                harvested[e, events.charged[e, m]] += events.harvested_j[e, m]
                spent[e, events.heard[e, m]] += events.spent_j[e, m]
                packets[e, m] += events.delivered[e, m]
                given[e, m] += events.harvested_j[e, m]
        before = state.cell
    mean, slot_s = ages / world.num_slots, loaded.slot_s
    of_nodes = (
        *(state.deliveries, mean, mean * slot_s, peak, peak * slot_s),
        *(harvested, spent, state.energy_j),
    )
    of_auvs = (way, moves, moves * slot_s, packets, given)
    for columns, expected, values in (
        (NODE_COLUMNS, of_nodes, found.nodes),
        (AUV_COLUMNS, of_auvs, found.auvs),
    ):
        assert list(values) == [column.name for column in columns]
        for column, numbers in zip(columns, expected, strict=True):
            assert values[column.name] == pytest.approx(numbers, rel=1e-12, abs=1e-9), column.name


@pytest.mark.parametrize("scenario", SCENARIOS)
def test_nodes_add_up_to_the_network(scenario):
    result = evaluate(scenario, "greedy", 3, breakdown=True)
    samples, nodes, auvs = result.samples, result.breakdown.nodes, result.breakdown.auvs
    assert nodes["mean_aoi_slots"].mean(axis=1) == pytest.approx(samples["mean_aoi"])
    assert nodes["peak_aoi_slots"].max(axis=1) == pytest.approx(samples["peak_aoi"])
    assert nodes["harvested_j"].sum(axis=1) == pytest.approx(samples["harvested_kj"] * 1e3)
    assert nodes["spent_j"].sum(axis=1) == pytest.approx(samples["spent_kj"] * 1e3)
    assert auvs["delivered_j"].sum(axis=1) == pytest.approx(nodes["harvested_j"].sum(axis=1))
    assert auvs["packets"].sum(axis=1) == pytest.approx(nodes["deliveries"].sum(axis=1))
    left = nodes["harvested_j"] - nodes["spent_j"]
    assert nodes["left_j"] == pytest.approx(left, abs=1e-6)


CAPACITOR = {
    "kind": "capacitor", "capacity_j": 300.0, "initial_j": 40.0, "leakage_w": 0.2, "idle_w": 0.5
}  # fmt: skip


def test_what_stores_lose_is_told_where_they_have_limits():
    limited = load_scenario("multi/m3-k10-fdd", {"storage": CAPACITOR})
    result = evaluate(limited, "greedy", 3, breakdown=True)
    nodes = result.breakdown.nodes
    columns = [column.name for column in (*NODE_COLUMNS, *STORE_COLUMNS)]
    assert list(nodes) == [column.name for column in result.breakdown.node_columns] == columns
    for name in ("spilled_j", "leaked_j", "idle_j"):
        assert nodes[name].sum(axis=1) == pytest.approx(result.samples[name])
        assert nodes[name].sum() > 0
    days = limited.num_slots * limited.slot_s / 86400
    for name in ("harvested_j", "spent_j"):
        assert nodes[f"{name}_per_day"] * days == pytest.approx(nodes[name])
    share = nodes["asleep_slots"].mean(axis=1) / limited.num_slots
    assert share == pytest.approx(result.samples["asleep_share"])
    lost_j = nodes["spilled_j"] + nodes["leaked_j"] + nodes["idle_j"]
    left_j = 40 + nodes["harvested_j"] - nodes["spent_j"] - lost_j
    assert nodes["left_j"] == pytest.approx(left_j, abs=1e-6)


def test_the_command_has_columns_for_stores(iout, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    words = [
        word for key, value in CAPACITOR.items() for word in ("--set", f"storage.{key}={value}")
    ]
    out = iout(
        "evaluate", "paper/k3-fdd", "--policy", "greedy", "--nodes", "--episodes", 1, *words
    )[1]
    assert "spilled J" in out
    assert "asleep" in out
    assert "survival" in out
    assert "asleep" not in iout("evaluate", "paper/k3-fdd", "--nodes", "--episodes", 1)[1]


def test_what_vehicles_spend_is_told_where_they_have_batteries():
    limited = load_scenario("multi/m3-k10-fdd", {"vehicle": {**BATTERY, **DOCKS}})
    result = evaluate(limited, "greedy", 3, breakdown=True)
    auvs = result.breakdown.auvs
    columns = [column.name for column in (*AUV_COLUMNS, *VEHICLE_COLUMNS)]
    assert list(auvs) == [column.name for column in result.breakdown.auv_columns] == columns
    for name in ("propulsion", "hotel", "charging", "docked"):
        assert auvs[f"{name}_j"].sum(axis=1) == pytest.approx(result.samples[f"{name}_kj"] * 1e3)
    assert auvs["distance_m"].sum(axis=1) == pytest.approx(result.samples["distance_m"])
    spent_j = auvs["propulsion_j"] + auvs["hotel_j"] + auvs["charging_j"]
    left_j = 0.6 * BATTERY["capacity_j"] + auvs["docked_j"] - spent_j
    assert auvs["battery_j"] == pytest.approx(left_j, abs=1e-6)
    share = auvs["stranded_slots"].mean(axis=1) / limited.num_slots
    assert share == pytest.approx(result.samples["stranded_share"])


def test_the_command_has_columns_for_vehicles(iout, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    words = [word for key, value in BATTERY.items() for word in ("--set", f"vehicle.{key}={value}")]
    out = iout(
        "evaluate", "paper/k3-fdd", "--policy", "return", "--nodes", "--episodes", 1, *words
    )[1]
    assert "propulsion J" in out
    assert "stranded slots" in out
    assert "battery left" in out


@pytest.mark.parametrize("columns", [80, 120])
def test_tables_fit_into_a_terminal(monkeypatch, capsys, columns):
    changes = {"storage": CAPACITOR, "vehicle": {**BATTERY, **DOCKS}}
    result = evaluate("multi/m3-k10-fdd", "greedy", 2, overrides=changes, breakdown=True)
    monkeypatch.setattr("iout_marl.terminal.WIDE", columns)
    show_breakdown(result)
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= columns
    # Each number in one line, and of headings at most two: the word and its unit.
    assert not any("…" in line for line in lines)
    rows = [line for line in lines if line.startswith("│")]
    assert len(rows) == 2 * 10 + 2 * 3
    for heading, row in ((13, rows[0]), (11, rows[10]), (8, rows[20]), (12, rows[23])):
        assert len([cell for cell in row.split("│") if cell.strip()]) <= heading
    assert len(lines) <= 1 + len(rows) + 4 * 5


def test_the_way_of_moves_that_are_not_over_counts_with_batteries():
    changes = {"vehicle": BATTERY, "episode.slot_s": 10}
    result = evaluate("paper/k3-fdd", "random-walk", 3, overrides=changes, breakdown=True)
    way = result.breakdown.auvs["distance_m"].sum(axis=1)
    assert way == pytest.approx(result.samples["distance_m"])


def test_nothing_else_changes_and_nothing_is_told_unasked():
    plain, told = (evaluate("paper/k3-fdd", "greedy", 3, breakdown=b) for b in (False, True))
    assert plain.breakdown is None
    more = told.to_json()
    assert {key: more.pop(key) for key in ("slot_s", "nodes", "auvs")}["slot_s"] == 25
    assert more == plain.to_json()


def test_the_way_of_a_single_episode():
    path = np.array(record_episode("paper/k3-fdd", "tour").path)[:, 0]
    way = np.abs(np.diff(path, axis=0)).sum() * 100
    found = evaluate("paper/k3-fdd", "tour", breakdown=True).breakdown.auvs
    assert found["distance_m"].tolist() == [[way]]


@pytest.mark.slow
def test_the_command_has_a_row_for_each(iout, tmp_path):
    target = tmp_path / "f.json"
    words = ("evaluate", "multi/m2-k10-fdd", "--policy", "greedy", "--policy", "tour")
    status, out, _ = iout(*words, "--nodes", "--episodes", 2, "--json", target)
    assert status == 0
    greedy, tour = json.loads(target.read_text())
    for record in (greedy, tour):
        assert [row["node"] for row in record["nodes"]] == list(range(1, 11))
        assert [row["auv"] for row in record["auvs"]] == [1, 2]
        for row in record["nodes"]:
            in_slots = row["mean_aoi_slots"]["mean"]
            assert row["mean_aoi_s"]["mean"] == pytest.approx(in_slots * 25)
    rows = [[c.strip() for c in line.split("│")[1:-1]] for line in out.splitlines() if "│" in line]
    of_greedy = [row for row in rows if len(row) == 1 + len(NODE_COLUMNS)][:10]
    for row, record in zip(of_greedy, greedy["nodes"], strict=True):
        shown = [f"{record[c.name]['mean']:.{c.digits}f}" for c in NODE_COLUMNS]
        assert row == [str(record["node"]), *shown]
    assert "greedy: a slot is 25 s; means over episodes" in out
    # Without the option it is as before.
    assert "node" not in iout(*words, "--episodes", 2)[1]
