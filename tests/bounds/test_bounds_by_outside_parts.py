"""Bounds that take a part from outside at its word say so, wherever they are shown."""

import json

import numpy as np
import pytest
from fake_results import record, results
from small_worlds import small_world

from iout_marl import load_scenario, parts
from iout_marl.bounds import bound, verified_age_sum
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.study.cells import Cell
from iout_marl.study.worker import run_cell

SETTINGS = {
    "access": ("exclusive", {"channel.access": "of_the_test"}),
    "motion": ("six", {"auvs.motion": "of_the_test"}),
    "beta rule": ("stored", {"duplex.beta_rule": "of_the_test"}),
    "duplex": ("tdd", {"duplex": {"kind": "of_the_test"}}),
    "placement": ("fixed", {"nodes": {"kind": "of_the_test", "cells": [[1, 1, 1], [3, 3, 1]]}}),
    "storage": ("unlimited", {"storage": "of_the_test"}),
    "vehicle": ("unlimited", {"vehicle": "of_the_test"}),
    "reward": ("mean_age", {"reward": {"kind": "of_the_test"}}),
    "absorption": ("thorp", {"channel.absorption": {"kind": "of_the_test"}}),
}
REGISTRIES = {
    "access": parts.access_rules,
    "motion": parts.motions,
    "beta rule": parts.beta_rules,
    "duplex": parts.duplexes,
    "placement": parts.placements,
    "storage": parts.storages,
    "vehicle": parts.vehicles,
    "reward": parts.rewards,
    "absorption": parts.absorptions,
}


@pytest.fixture
def from_outside():
    """Registers a built-in part once more as one from outside; what names it in a scenario."""
    registered = []

    def register(role):
        kind, settings = SETTINGS[role]
        registry = REGISTRIES[role]
        own = type("OfTheTest", (registry[kind].item,), {"__module__": __name__})
        registry.register("of_the_test", version=1)(own)
        registered.append(registry)
        return settings

    yield register
    for registry in registered:
        registry.unregister("of_the_test")


def world(settings=(), **options):
    return load_scenario(small_world(np.random.default_rng(1), "tdd", slots=3, **options), settings)


@pytest.mark.slow
@pytest.mark.parametrize(
    "role", ["access", "motion", "beta rule", "duplex", "placement", "storage", "vehicle"]
)
def test_one_that_is_relied_on_is_named(from_outside, role):
    found = bound(world(from_outside(role)), seconds=1)
    stated_by = f"as stated by part 'of_the_test' ({role})"
    assert found.stated_by == stated_by
    assert found.validity == f"both bounds hold for every policy; {stated_by}"
    assert found.to_json()["validity"] == found.validity


def test_all_that_are_relied_on_are_named(from_outside):
    settings = from_outside("access") | from_outside("motion")
    assert bound(world(settings), seconds=0).stated_by == (
        "as stated by part 'of_the_test' (access) and part 'of_the_test' (motion)"
    )


@pytest.mark.parametrize("role", ["reward", "absorption"])
def test_no_other_part_is(from_outside, role):
    found = bound(world(from_outside(role)), seconds=0)
    assert found.stated_by == ""
    assert found.validity == "both bounds hold for every policy"
    assert bound(world(), seconds=0).stated_by == ""


@pytest.mark.parametrize("role", ["motion", "beta rule", "placement"])
def test_scheduling_alone_relies_on_no_more_than_the_access_rule(from_outside, role):
    assert bound(world(from_outside(role), auvs=2), seconds=0).stated_by == ""


def test_scheduling_alone_relies_on_the_access_rule(from_outside):
    found = bound(world(from_outside("access"), auvs=2), seconds=0)
    assert found.validity == (
        "the scheduling bound holds; the one by energy and travel is for one AUV; as stated by "
        "part 'of_the_test' (access)"
    )


def test_the_bound_is_that_of_the_same_part_from_inside(from_outside):
    inside = world({"channel.access": "exclusive", "duplex.beta_rule": "stored"}, auvs=2)
    outside = world(from_outside("access") | from_outside("beta rule"), auvs=2)
    assert bound(inside).best == bound(outside).best
    certificate = bound(outside).certificate
    assert verified_age_sum(outside, certificate) == certificate.age_sum


@pytest.mark.slow
def test_the_command_and_its_json_say_so(iout, from_outside):
    (setting,) = (f"{key}={value}" for key, value in from_outside("access").items())
    words = ("bound", "multi/m2-k10-fdd", "--set", "episode.duration_s=100", "--set", setting)
    assert "as stated by part 'of_the_test' (access)" in " ".join(iout(*words)[1].split())
    found = json.loads(iout(*words, "--json", "-")[1])
    assert found["validity"].endswith("; as stated by part 'of_the_test' (access)")


def test_studies_and_their_reports_say_so(from_outside):
    scenario = world(from_outside("access"), auvs=2)
    cell = Cell("group", "bound", 2, scenario, "bound", 0, 1, bound_seconds=0.5)
    search = run_cell(cell, 500).record.search
    assert search == "scheduling, 0.5 s; as stated by part 'of_the_test' (access)"
    bounded = record("bound", 2, 0, {"mean_aoi": 2.0}).model_copy(
        update={"search": search, "samples": {"mean_aoi": [2.0]}}
    )
    played = record("greedy", 2, 0, {"mean_aoi": 3.0})
    cells = [("group", "bound", 2, bounded), ("group", "greedy", 2, played)]
    text = render_markdown(build_report(results(cells, report="plain")), "figures")
    stated_by = "as stated by part 'of_the_test' (access)"
    assert f"certified, no policy's mean AoI is lower, {stated_by}." in text
    assert f"scheduling, 0.5 s; {stated_by}" in text
