"""A certificate is data from anywhere: what is wrong with it is said by name, in one line."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_worlds import least_age_sum, small_world

from iout_marl import load_scenario
from iout_marl.bounds import (
    Certificate,
    branch_and_bound_check,
    certificate,
    check_game,
    lagrangian_check,
    scheduling,
    verified_age_sum,
)
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.errors import InputError
from iout_marl.files import parse_json, to_json
from iout_marl.world import pin_layout

FIXTURES = Path(__file__).parent / "fixtures"
KINDS = ("scheduling", "branch-and-bound", "lagrangian")
DEEP = json.loads("[" * 900 + "]" * 900)


def fixture(kind):
    """A scenario, and a certificate of it as the first version with certificates wrote them."""
    record = json.loads((FIXTURES / f"{kind}.json").read_text())
    return load_scenario(record["scenario"], record["changes"]), record["certificate"]


def refusal(call, *arguments):
    """The one line by which something is refused."""
    with pytest.raises(InputError) as refused:
        call(*arguments)
    line = str(refused.value)
    assert line.isprintable()
    assert len(line) < 250
    assert line.startswith("certificate: ")
    return line.removeprefix("certificate: ")


@pytest.mark.parametrize("kind", KINDS)
def test_certificates_written_before_are_read_and_hold(kind):
    scenario, record = fixture(kind)
    read = Certificate.from_json(record)
    assert read.kind == kind == record["kind"]
    assert verified_age_sum(scenario, read) == record["age_sum"]
    assert parse_json(to_json(read.to_json())) == record
    if kind != "scheduling":
        with pytest.raises(InputError, match="scheduling proves no more"):
            verified_age_sum(scenario, Certificate(read.world_hash, read.age_sum))


@pytest.mark.parametrize(
    ("before", "now"), [("opening", "branch-and-bound"), ("sharing", "lagrangian")]
)
def test_kinds_of_the_version_before_are_read_by_their_new_names(before, now):
    _, record = fixture(now)
    assert Certificate.from_json({**record, "kind": before}).kind == now


NO_NUMBERS = [float("nan"), float("inf"), None, "7", True, [1], {}, DEEP, np.bool_(True)]
NOT_WHOLE = [*NO_NUMBERS, -1, 2.5, 66.0, 10**400, -(10**400), 10**5000, np.float64(3)]


@pytest.mark.parametrize("value", NOT_WHOLE, ids=lambda value: str(type(value)))
@pytest.mark.parametrize("name", ["age_sum", "oldest"])
def test_what_is_no_whole_number_in_range_is_refused_by_name(name, value):
    scenario, record = fixture("lagrangian")
    assert name in refusal(Certificate.from_json, record | {name: value})
    by_hand = replace(Certificate.from_json(record), **{name: value})
    assert name in refusal(verified_age_sum, scenario, by_hand)


@pytest.mark.slow
@pytest.mark.parametrize("value", [*NO_NUMBERS, 1e301, -1e-9, 10**400, np.float32(-1)], ids=str)
@pytest.mark.parametrize("name", ["levels_j", "naming", "reach_m", "presence"])
def test_what_is_no_number_in_range_is_refused_by_name(name, value):
    scenario, record = fixture("lagrangian")
    if name == "presence" and not isinstance(value, (list, dict, str)) and value is not None:
        value = -1e300
    changed = json.loads(json.dumps(record))
    if name == "reach_m":
        changed[name] = value
    elif name == "presence":
        changed[name][1][0][2] = value
    else:
        changed[name][3] = value
    assert name in refusal(Certificate.from_json, changed)
    read = Certificate.from_json(record)
    if name == "levels_j":
        by_hand = replace(read, levels_j=tuple(changed[name]))
    else:
        by_hand = replace(read, prices=replace(read.prices, **{name: changed[name]}))
    assert name in refusal(verified_age_sum, scenario, by_hand)


MALFORMED = [
    (["levels_j"], [], "levels_j: must be a list of length 1 to 1,024, not of length 0"),
    (["levels_j"], list(range(2000)), "levels_j: must be a list of length 1 to 1,024"),
    (["levels_j"], [[0, 1]], "levels_j[0]: must be a number from 0 to 1e+300, not a value of type"),
    (["levels_j"], [0, 2, 1], "levels_j[2]: must be more than the one before, 2.0, not 1.0"),
    (["levels_j"], [0, 0], "levels_j[1]: must be more than the one before"),
    (["levels_j"], "0", "levels_j: must be a list of length 1 to 1,024, not '0'"),
    (["levels_j"], None, "levels_j: is missing, which lagrangian needs"),
    (["slots"], [0, 19.0], "slots[1]: must be a whole number"),
    (["slots"], [], "slots: must be a list"),
    (["slots", 0], 1, "slots[0]: must be 0, not 1"),
    (["slots", 2], 2, "slots[2]: must be more than the one before, 2, not 2"),
    (["slots", -1], 25, "slots: must end at the last slot, 19, not 25"),
    (["naming"], [1.0], "naming: must be a list of length"),
    (["presence"], [[[1.0]]], "presence[0][0]: must be a list of length"),
    (["presence", 1], [], "presence[1]: must be a list of length 3, not of length 0"),
    (["presence"], DEEP, "presence[0][0]: must be a list of length"),
    (["reach_m"], 0, "reach_m: must be a number from 1e-06 to 1e+15, not 0"),
    (["reach_m"], 5e-324, "reach_m: must be a number from 1e-06 to 1e+15, not 5e-324"),
    (["oldest"], 1, "oldest: must be a whole number from 2"),
    (["oldest"], 51, "oldest: must be a whole number from 2 to 50, not 51"),
    (["age_sum"], 3001, "age_sum: must be a whole number from 0 to 3,000, not 3,001"),
    (["world_hash"], "0" * 12, "is of world 000000000000, not of"),
    (["world_hash"], "..", "world_hash: must be 12 hexadecimal digits, not '..'"),
    (["world_hash"], 12, "world_hash: must be 12 hexadecimal digits, not 12"),
    (
        ["kind"],
        "shearing",
        "kind: must be one of scheduling, branch-and-bound, lagrangian, not 'shearing'",
    ),
    (["kind"], ["lagrangian"], "kind: must be one of"),
    (["kind"], "branch-and-bound", "'oldest': is no field of branch-and-bound"),
    (["levles_j"], [0], "'levles_j': is no field of lagrangian; did you mean 'levels_j'?"),
    (["two\nlines" * 9], 0, "is no field of lagrangian"),
    ([3], 0, "3: is no field of lagrangian"),
]


@pytest.mark.parametrize(("path", "value", "line"), MALFORMED, ids=lambda each: str(each)[:40])
def test_malformed_fields(path, value, line):
    scenario, record = fixture("lagrangian")
    *way, last = path
    place = record
    for step in way:
        place = place[step]
    place[last] = value
    assert line in refusal(lambda: verified_age_sum(scenario, Certificate.from_json(record)))


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_is_needed(kind):
    _, record = fixture(kind)
    for name in set(record) - {"kind"}:
        without = {key: value for key, value in record.items() if key != name}
        assert refusal(Certificate.from_json, without) == f"{name}: is missing, which {kind} needs"


@pytest.mark.parametrize("nothing", [None, [], "x", 3, DEEP, float("nan")], ids=repr)
def test_what_is_no_certificate_at_all(nothing):
    assert "must be a mapping" in refusal(Certificate.from_json, nothing)
    assert "must be a Certificate" in refusal(
        verified_age_sum, fixture("branch-and-bound")[0], nothing
    )


def test_parts_of_a_certificate_that_do_not_belong_together():
    scenario, record = fixture("lagrangian")
    read = Certificate.from_json(record)
    for changes, line in (
        ({"prices": None}, "oldest: is there where prices are"),
        ({"oldest": None}, "oldest: is there where prices are"),
        ({"levels_j": None}, "levels_j: is missing"),
        ({"prices": "many"}, "prices: must be Prices, not 'many'"),
    ):
        assert line in refusal(verified_age_sum, scenario, replace(read, **changes))


def test_nodes_begin_empty_however_low_a_ladder_begins():
    scenario = small_world(np.random.default_rng(4), "fdd", "six", 2, 5)
    below = tuple(-1e6 + 1000.0 * i for i in range(40))
    line = refusal(verified_age_sum, scenario, Certificate(scenario.world_hash, 400, below))
    assert line.startswith("levels_j[0]: must be a number from 0")


def test_energy_and_travel_prove_nothing_where_nodes_may_lie_elsewhere():
    nodes = {"kind": "random", "count": 2, "redraw": "run"}
    settings = {"grid.cells": [3, 3, 1], "episode.duration_s": 100, "nodes": nodes}
    scenario = load_scenario("paper/k3-fdd", {**settings, "auvs.start_cells": [[1, 1, 1]]})
    layout = pin_layout(scenario, 0)
    levels_j = tuple(FiniteGame.from_scenario(layout).levels_j[:-1].tolist())
    claim = Certificate(scenario.world_hash, 100, levels_j)
    assert "fixed nodes only" in refusal(verified_age_sum, scenario, claim)


def test_a_lagrangian_certificate_is_for_tdd_and_for_as_many_nodes():
    _, record = fixture("lagrangian")
    for name, changes, line in (
        (
            "best/k3-fdd",
            {},
            "kind: the Lagrangian bound is for scenarios where an AUV names one node",
        ),
        ("best/k5-tdd", {"episode.duration_s": 500}, "presence: is for 3 nodes, but there are 5"),
    ):
        scenario = load_scenario(name, changes)
        read = Certificate.from_json(record | {"world_hash": scenario.world_hash})
        assert line in refusal(verified_age_sum, scenario, read)


def test_ages_that_cannot_be_added_up(monkeypatch):
    scenario, record = fixture("branch-and-bound")
    read = Certificate.from_json(record)
    monkeypatch.setattr(branch_and_bound_check, "MOST_COUNTED", 899)
    assert "32 bits" in refusal(verified_age_sum, scenario, read)
    for limited in (certificate, scheduling):
        monkeypatch.setattr(limited, "MOST_AGE_SUM", 899)
    assert "64 bits" in refusal(verified_age_sum, scenario, read)
    with pytest.raises(InputError, match=r"age\.maximum: 6 slots .* 64 bits"):
        scheduling.least_age_sum(scenario)


@pytest.mark.parametrize("weight", [0.0, 2.0**40])
def test_prices_so_high_that_64_bits_cannot_add_them_up(weight):
    scenario, record = fixture("lagrangian")
    record["age_sum"] += 1
    record["naming"][1] = 2.0**38
    record["presence"][0][1][1] = weight
    line = refusal(verified_age_sum, scenario, Certificate.from_json(record))
    assert ("64 bits" in line) == (weight > 0)


@pytest.mark.parametrize(
    ("kind", "module", "limit"),
    [
        ("branch-and-bound", check_game, "MOST_ENTRIES"),
        ("branch-and-bound", check_game, "MOST_OUTCOMES"),
        ("branch-and-bound", branch_and_bound_check, "MOST_AT_ONCE"),
        ("branch-and-bound", branch_and_bound_check, "MOST_IN_ALL"),
        ("lagrangian", lagrangian_check, "MOST_KEPT"),
        ("lagrangian", lagrangian_check, "MOST_PAYMENTS"),
        ("lagrangian", lagrangian_check, "MOST_STEPS"),
    ],
)
def test_no_check_is_kept_busy_without_limit(kind, module, limit, monkeypatch):
    scenario, record = fixture(kind)
    monkeypatch.setattr(module, limit, 1000)
    line = refusal(verified_age_sum, scenario, Certificate.from_json(record))
    assert "too many for the check" in line or "than the check lists" in line


def test_how_much_there_is_to_read_is_limited_too(monkeypatch):
    _, record = fixture("lagrangian")
    for limit, line in (("MOST_TIMES", "slots: must be"), ("MOST_WEIGHTS", "presence: must be")):
        with monkeypatch.context() as patch:
            patch.setattr(certificate, limit, 2)
            assert line in refusal(Certificate.from_json, record)


def test_other_ladders_and_number_types_will_do():
    scenario = small_world(np.random.default_rng(2), "tdd", "six", 2, 5)
    least = least_age_sum(scenario)
    for levels_j in (
        [0],
        np.array([0.5, 1e3]),
        (np.float32(0), np.int64(7)),
        [0.0, 1e300],
        [3e299],
    ):
        claim = Certificate(scenario.world_hash, np.int64(1), levels_j)
        assert verified_age_sum(scenario, claim) == 1
        too_much = replace(claim, age_sum=least + 1)
        assert "below" in refusal(verified_age_sum, scenario, too_much)
