"""No kind is asked for by its name: a part registered again under another name does all the same.

Episodes, masks, observations, plans, bounds, trainings, pictures and reports are equal to the last
bit; only the hash differs.
"""

import dataclasses
import re

import numpy as np
import pytest
from loss_tables import on_disk
from rich.console import Console
from test_contracts import CELLS, OVERRIDES
from test_contracts import SETTINGS as CONTRACTS
from tiny_study import SameProcess, write_study

from iout_marl import InputError, Trainer, bounds, evaluate, load_scenario, record_episode
from iout_marl.bounds.check_game import finite_game, is_covered
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.outlook import energy_outlook
from iout_marl.parts import Part
from iout_marl.policies import search
from iout_marl.policies.planned import PlannerPolicy
from iout_marl.policies.search import Budget
from iout_marl.registry import registries, registry_of
from iout_marl.render import Snapshot, as_text
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.study import expand, load_study, run_study
from iout_marl.study.run import StudyFolder
from iout_marl.testing.parts import ALONE, MODEMS, SMALL, TEAM, WITH_MODEMS
from iout_marl.testing.recorded import actions_for, chance_for, episode, first_state
from iout_marl.world import Events, State, World

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::iout_marl.errors.Note")]

AGAIN = "again_"
#: What was found of scenarios whose parts are named as usual.
KNOWN = {}
#: Episodes that are planned, and how many are played side by side for that: kinds are all the same
#: to how long a search is.
SHORT = {"episode.duration_s": 150}
FEW = {"FIRST_SEARCH": (24, 1), "ROUND_SEARCH": (48, 3)}
#: Roles whose kinds have the settings that their contracts are tested with.
ROLES = ("current", "harvester", "hearing", "transmission", "uplink", "fading", "wind", "loss")
#: All that is not a default: what a scenario says beneath holds for its own kind alone.
SETTINGS = {
    ("placement", "fixed"): {"cells": CELLS},
    ("placement", "random"): {"count": 4},
    ("duplex", "tdd"): {"beta_rule": "stored"},
    ("optimizer", "torch"): {"name": "AdamW"},
    **{key: of[0] for key, of in CONTRACTS.items() if key[0] in ROLES},
    ("vehicle", "battery"): CONTRACTS["vehicle", "battery"][0],
    ("storage", "capacitor"): {"capacity_j": 400.0, "leakage_w": 0.2, "idle_w": 0.5},
}
KEYS = {
    "absorption": "channel.absorption",
    "access": "channel.access",
    "beta rule": "duplex.beta_rule",
    "channel": "channel",
    "current": "current",
    "duplex": "duplex",
    "fading": "channel.fading",
    "harvester": "harvester",
    "hearing": "hearing",
    "loss": "uplink.loss",
    "motion": "auvs.motion",
    "network": "training.network",
    "observation": "observation",
    "observation entry": "observation.entries",
    "optimizer": "training.optimizer",
    "placement": "nodes",
    "reward": "reward",
    "transmission": "channel.transmission",
    "uplink": "uplink",
    "storage": "storage",
    "vehicle": "vehicle",
    "wind": "channel.wind",
}
#: What bounds by energy and travel take at its word.
OF_ENERGY = (
    *("duplex", "beta rule", "motion", "placement", "storage", "vehicle", "fading", "current"),
)
#: What parts of a sea that changes need, to have something to do.
IN_A_SEA = {role: {**MODEMS, **WITH_MODEMS[role]} for role in ("fading", "wind", "loss")}
#: The worlds, with penalties in time division that are none of frequency division.
PENALTIES = {
    "paper/k5-fdd": {},
    "paper/k5-tdd": {"reward.only_charging_penalty": 3.0},
    "best/k5-tdd": {},
}
#: Each of them, teams and a single AUV: which of both a world has is no matter of its penalties.
WORLDS = (("paper/k5-fdd", TEAM), ("paper/k5-tdd", ALONE), ("best/k5-tdd", TEAM))
#: The two worlds in time division differ in rewards, observations and the rule for β: policies see
#: neither of the first two, and where the third one is tested it is the same in both. What rewards
#: and observations are is in episodes already.
TWO_WORLDS = (("best/k5-tdd", TEAM), ("paper/k5-fdd", ALONE))
#: Trainings are of teams, which have critics of their own.
OF_TEAMS = (("paper/k5-fdd", TEAM), ("best/k5-tdd", TEAM))
#: A short training, for a look at what it makes of a part.
TRAINING = {
    "training.environments": 4,
    "training.rollout_slots": 8,
    "training.minibatches": 2,
    "training.hidden_units": [8],
}
CASES = [
    pytest.param((parts.role, entry.kind), id=f"{parts.role}-{entry.kind}")
    for parts in registries()
    if parts.base is not None and issubclass(parts.base, Part)
    for entry in parts
    if not entry.is_outside
]


@pytest.fixture(scope="module", autouse=True)
def _registered_again():
    """All parts, under another name."""
    names = [case.values[0] for case in CASES]
    for role, kind in names:
        parts = registry_of(role)
        parts.register(AGAIN + kind, version=1)(parts[kind].item)
    yield
    for role, kind in names:
        registry_of(role).unregister(AGAIN + kind)


@pytest.fixture(scope="module")
def pairs(request, tmp_path_factory):
    """Scenarios with a part, and with the same part under another name."""
    role, kind = request.param
    settings = on_disk(SETTINGS.get((role, kind), {}), tmp_path_factory.mktemp("data"))

    def make(name, changes):
        """The overrides of a bundled scenario for both, and both scenarios."""
        both = []
        for each in (kind, AGAIN + kind):
            data = {"kind": each, **settings}
            named = {KEYS[role]: [data] if role == "observation entry" else data}
            # The keys of another kind are none of this one's.
            rest = {k: v for k, v in changes.items() if not k.startswith(f"{KEYS[role]}.")}
            needed = {**IN_A_SEA.get(role, {}), **OVERRIDES.get((role, kind), {})}
            both.append({**rest, **needed, **named})
        return both, [load_scenario(name, overrides) for overrides in both]

    make.role = role
    return make


OF_WORLD = [case for case in CASES if registry_of(case.values[0][0]).base.is_of_world]


def every_pair(function):
    return pytest.mark.parametrize("pairs", CASES, indirect=True)(function)


def every_pair_of_a_world(function):
    return pytest.mark.parametrize("pairs", OF_WORLD, indirect=True)(function)


def worlds(pairs, of=WORLDS, **changes):
    """Pairs of scenarios in frequency and in time division, where the part is for both."""
    found = []
    for name, auvs in of:
        try:
            found.append(pairs(name, SMALL | auvs | PENALTIES[name] | changes)[1])
        except InputError:
            continue  # a rule for β is for time division, other AUVs for teams
    assert found
    return found


def same(function, pair):
    """What a function says of two scenarios is equal; of the first one it is asked only once."""
    first, second = pair
    # The part is often the one that another pair has, too.
    key = (function, first.name, first.hash)
    if key not in KNOWN:
        KNOWN[key] = function(first)
    assert_same(function(second), KNOWN[key])


def assert_same(found, expected):
    assert type(found) is type(expected)
    if isinstance(expected, np.ndarray):
        assert found.dtype == expected.dtype
        # Its report takes longer than the comparison.
        if found.tobytes() != expected.tobytes() or found.shape != expected.shape:
            np.testing.assert_array_equal(found, expected)
    elif isinstance(expected, dict):
        assert found.keys() == expected.keys()
        for name, value in expected.items():
            assert_same(found[name], value)
    elif isinstance(expected, list | tuple):
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            assert_same(one, other)
    else:
        assert found == expected


@every_pair_of_a_world
def test_episodes(pairs):
    for first, second in worlds(pairs):
        assert first.hash != second.hash
        same(played, (first, second))


def played(scenario):
    """States, events, rewards, observations, masks, metrics of an episode, what is shown of it.

    Pictures are made of a snapshot alone.
    """
    world = World(scenario, 2)
    start = first_state(world, [0, 1])
    actions = actions_for(world, 0)
    chance = chance_for(world, [0, 1])
    slots = [dict(slot.values) for slot in episode(world, start, actions, chance=chance)]
    states = [start, *(State(*(slot[name] for name in State._fields)) for slot in slots)]
    masks, state = [world.action_mask(state) for state in states[:-1]], states[-1]
    named = (f"event {name}" if name in State._fields else name for name in Events._fields)
    snapshot = Snapshot.from_world(world, state, Events(*(slots[-1][name] for name in named)))
    observer = world.observer
    ranges = [[r.low, r.high, r.scale] for r in (observer.agent_ranges, observer.state_ranges)]
    shown = dataclasses.asdict(snapshot), as_text(snapshot), energy_outlook(scenario)
    return slots, masks, world.metrics(state), ranges, shown


@pytest.mark.filterwarnings("ignore:searches .tour, planner")
@every_pair_of_a_world
def test_policies_and_plans(pairs, monkeypatch):
    for name, breadth in FEW.items():
        monkeypatch.setattr(search, name, breadth)
    for pair in worlds(pairs, TWO_WORLDS, **SHORT):
        same(evaluated, pair)


def evaluated(scenario):
    policies = "greedy", "tour", PlannerPolicy(Budget(rounds=1))
    samples = [evaluate(scenario, policy, 2).samples for policy in policies]
    return samples, record_episode(scenario, "greedy").to_json()


@every_pair_of_a_world
def test_bounds(pairs):
    for first, second in worlds(pairs):
        for function in (bounds.least_age_sum, bounds.delivery_bound, is_covered):
            assert function(second) == function(first)
        found, expected = (bounds.bound(scenario, seconds=0) for scenario in (second, first))
        assert found.scheduling == expected.scheduling
        validity = found.validity.removesuffix(f"; {found.stated_by}").replace(AGAIN, "")
        assert validity == expected.validity
        relies = pairs.role in ("access", "hearing") or (
            pairs.role in OF_ENERGY and is_covered(first)
        )
        assert bool(found.stated_by) == relies
        assert expected.stated_by == ""
        if is_covered(first):
            same(game, (first, second))


def game(scenario):
    """What is searched for bounds, and what they are checked by."""
    field = FiniteGame.from_scenario(scenario)
    checked = finite_game(scenario, tuple(field.levels_j[:-1].tolist()))
    searched = field.levels_j, tuple(field.tables), field.next_cells, field.start, field.distance_m
    return searched, tuple(checked)


@every_pair
def test_trainings(pairs):
    for pair in worlds(pairs, OF_TEAMS, **TRAINING):
        same(trained, pair)


def trained(scenario):
    trainer = Trainer(scenario, seed=0)
    log = trainer.iterate()
    measured = {name: value for name, value in log.items() if not name.startswith("speed/")}
    return measured, {name: weight.numpy() for name, weight in trainer.weights().items()}


@pytest.mark.filterwarnings("ignore:searches .tour, planner")
@every_pair_of_a_world
def test_reports(pairs, tmp_path):
    """Those of a study: but for the name and the hash."""
    try:
        overrides, _ = pairs("paper/k5-fdd", SMALL | TEAM)
        name = "paper/k5-fdd"
    except InputError:
        overrides, _ = pairs("paper/k5-tdd", SMALL | TEAM)
        name = "paper/k5-tdd"
    texts = [reported(tmp_path / str(i), name, each) for i, each in enumerate(overrides)]
    assert texts[0] == texts[1]


def reported(folder, name, settings):
    folder.mkdir()
    group = {"scenarios": [name], "policies": ["greedy", "tour"], "episodes": 2}
    group |= {"settings": settings}
    study = load_study(write_study(folder / "tiny.yaml", groups={"all": group}, quick={}))
    identity = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}
    out = StudyFolder(folder / "out")
    with out.open(identity):
        pool, console = SameProcess(), Console(quiet=True)
        cells = expand(*study)
        results = run_study("tiny", study[0], cells, out, pool, "iout", console=console)
    assert not results.failures
    text = render_markdown(build_report(results), "figures").replace(AGAIN, "")
    return re.sub(r"[0-9a-f]{12}|\d{4}-\d\d-\d\d.*", "…", text)
