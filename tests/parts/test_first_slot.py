"""What parts from outside state and return is looked at: one line says what is wrong with it."""

import numpy as np
import pytest
import torch
from polling import MODEM

from iout_marl import InputError, evaluate, iout_v0, parts
from iout_marl.parts.access import Uplinks
from iout_marl.parts.beta_rule.paper import PaperRule
from iout_marl.parts.channel.levels import Levels
from iout_marl.parts.duplex.tdd import TimeDivision
from iout_marl.parts.placement.random import Random
from iout_marl.parts.uplink.modem import Modem
from iout_marl.testing import check_part
from iout_marl.world import World, node_codes
from trainers import Trainer

TEAM = {"auvs.count": 2}


@pytest.fixture
def scenario_with(tiny):
    """Registers a class made for one test, and makes the tiny scenario that names it."""
    registered = []

    def make(registry, base, scenario="paper/k3-fdd", overrides=(), **members):
        kind = "mine"
        # What every part must have is not what these tests are about.
        left = {name: None for name in registry.required if base is registry.base}
        part = type("Mine", (base,), {"__module__": __name__, **left, **members})
        registry.register(kind, version=1)(part)
        registered.append(registry)
        key = KEYS[registry.role]
        named = [{"kind": kind}] if key.endswith("entries") else {"kind": kind}
        return tiny({key: named, **dict(overrides)}, scenario)

    yield make
    for registry in registered:
        registry.unregister("mine")


KEYS = {
    "absorption": "channel.absorption",
    "access": "channel.access",
    "beta rule": "duplex.beta_rule",
    "channel": "channel",
    "current": "current",
    "duplex": "duplex",
    "harvester": "harvester",
    "hearing": "hearing",
    "motion": "auvs.motion",
    "observation entry": "observation.entries",
    "placement": "nodes",
    "reward": "reward",
    "storage": "storage",
    "vehicle": "vehicle",
    "uplink": "uplink",
}
PACKETS = {"packet_bits": 100.0, "bandwidth_hz": 3000.0}


def ages(part, state):
    return -part.xp.max(state.age, axis=-1, keepdims=True)


def two_frames(scenario, velocity=0.1, frame=0, weight=0.5):
    slots, cells = scenario.num_slots, np.prod(scenario.grid.cells)
    return parts.Frames(
        np.full((2, cells, 2), velocity), np.full(slots, frame), np.full(slots, weight)
    )


REWARDS = {
    "a mapping of terms": lambda part, state, events: ages(part, state),
    "a mapping of terms, name to array, not {}": lambda part, state, events: {},
    "name of a term must be a text": lambda part, state, events: {1: ages(part, state)},
    r"\(envs, auvs\) = \(4, 3\) or \(envs, 1\) = \(4, 1\), not of float64 and shape \(4,\)": (
        lambda part, state, events: {"age": state.mean_age}
    ),
    "term 'age' must be an array of float64.*not 1.5": lambda part, state, events: {"age": 1.5},
    "not of int64 and shape": lambda part, state, events: {"age": events.heard},
    "term 'age' must be finite": lambda part, state, events: {
        "age": ages(part, state) / (0 * state.age[:, :1])
    },
    "must not change the State": lambda part, state, events: {
        "age": np.negative(state.age, out=state.age)[:, :1]
    },
    r"raises AttributeError: .*no attribute 'ages' \(.*test_first_slot.py:\d+\)": (
        lambda part, state, events: {"age": state.ages}
    ),
}


@pytest.mark.parametrize("message", REWARDS)
def test_rewards(scenario_with, message):
    scenario = scenario_with(
        parts.rewards, parts.Reward, overrides={"auvs.count": 3}, __call__=REWARDS[message]
    )
    with pytest.raises(InputError, match=f"^reward 'mine': .*{message}"):
        World(scenario)


def test_a_reward_beyond_its_bounds(scenario_with):
    scenario = scenario_with(
        parts.rewards,
        parts.Reward,
        __call__=lambda part, state, events: {"age": 100 * ages(part, state)},
        bounds=lambda part, scenario: {"age.maximum": 15.0},
    )
    with pytest.raises(InputError, match="the reward must lie from -15 to 15, as stated, not at"):
        World(scenario)


def test_wherever_a_world_is_made(scenario_with):
    """In evaluations, environments, trainings: before the first slot that counts."""
    scenario = scenario_with(
        parts.rewards, parts.Reward, __call__=lambda part, state, events: {"age": state.age}
    )
    for make in (
        lambda: World(scenario, 7, torch, "float32"),
        lambda: evaluate(scenario, "greedy"),
        lambda: iout_v0.parallel_env(scenario),
        lambda: Trainer(scenario, seed=0),
    ):
        with pytest.raises(InputError, match=r"^reward 'mine': term 'age' .*\(3, 1\)"):
            make()


def test_on_the_arrays_that_a_world_has(scenario_with):
    """What continues NumPy alone is refused where it would be used on torch."""
    scenario = scenario_with(
        parts.rewards,
        parts.Reward,
        __call__=lambda part, state, events: {"age": -np.asarray(state.age[:, :1])},
    )
    World(scenario)
    with pytest.raises(InputError, match=r"term 'age' must be an array of torch\.float64"):
        World(scenario, library=torch)


def test_once(scenario_with):
    calls = []

    def reward(part, state, events):
        calls.append(state)
        return {"age": ages(part, state)}

    scenario = scenario_with(parts.rewards, parts.Reward, __call__=reward)
    for num_envs in (1, 1, 5):
        World(scenario, num_envs)
    assert len(calls) == 1


ENTRIES = {
    "size must be at least 1, not 0": {"size": 0},
    "size must be a whole number": {"size": 2.5},
    r"ranges\(\).low must have shape \(2,\), as size says, not \(1,\)": {
        "size": 2, "ranges": lambda part: parts.entry.base.Ranges.uniform(1, 0, 1, 1)
    },
    "low must not exceed high": {"low": 2.0},
    "scale must be above 0": {"scale": 0.0},
    "high must be finite": {"high": float("inf")},
    "unit must be a text": {"unit": None},
    r"its numbers must be of float64.*size\) = \(3, 1, 1\), not of float64 and shape \(3, 1, 2\)": {
        "__call__": lambda part, state: part.for_every_auv(state.age)
    },
    "its numbers must lie from 0 to 1, as stated, not at": {
        "__call__": lambda part, state: part.for_every_auv(state.age[:, :1] + 7)
    },
}  # fmt: skip


@pytest.mark.parametrize("message", ENTRIES)
def test_observation_entries(scenario_with, message):
    with pytest.raises(InputError, match=f"observation entry 'mine': .*{message}"):
        World(scenario_with(parts.entries, parts.Entry, **ENTRIES[message]))


MOTIONS = {
    r"steps must be three whole numbers for each direction, \(directions, 3\), not": [(1, 0)],
    "steps must be three whole numbers": [(0.5, 0, 0)],
    "steps must be three": [(1, 0, 0), (1, 0)],
    "steps must be": [],
    "steps: two directions lead the same way": [(1, 0, 0), (0, 1, 0), (1, 0, 0)],
}


@pytest.mark.parametrize("message", MOTIONS)
def test_motions(scenario_with, message):
    """What a part states is looked at when a scenario names it, which says where it does."""
    with pytest.raises(InputError, match=f"auvs.motion: motion 'mine': {message}"):
        scenario_with(parts.motions, parts.Motion, steps=MOTIONS[message])


PLACEMENTS = {
    r"draw must give whole numbers of shape \(2, 3\), the nodes' cells, not float64": (
        lambda part, grid, rng: rng.random((2, 3))
    ),
    r"draw must give .* not int64 of shape \(3, 3\)": (
        lambda part, grid, rng: np.zeros((3, 3), dtype=int)
    ),
    r"draw gives the cell \[3, 0, 0\]; coordinates count from 0 and stay below \[3, 2, 1\]": (
        lambda part, grid, rng: np.array([[0, 0, 0], [3, 0, 0]])
    ),
}


@pytest.mark.parametrize("message", PLACEMENTS)
def test_placements(scenario_with, message):
    scenario = scenario_with(
        parts.placements, parts.Placement, num_nodes=2, draw=PLACEMENTS[message]
    )
    with pytest.raises(InputError, match=f"^placement 'mine': {message}"):
        World(scenario)


def test_a_placement_is_looked_at_whenever_it_draws(scenario_with):
    class Growing(Random):
        num_nodes = 2
        redraws = "episode"

        def draw(self, grid, rng):
            return np.array([[0, 0, 0], [int(rng.random() < 0.1) + 2, 0, 0]])

    scenario = scenario_with(
        parts.placements, Growing, Settings=parts.Settings, check=lambda part, scenario: None
    )
    world = World(scenario)
    rngs = [np.random.default_rng(seed) for seed in range(50)]
    with pytest.raises(InputError, match=r"draw gives the cell \[3, 0, 0\]"):
        node_codes(scenario, world.grid, rngs)


@pytest.mark.parametrize(
    ("message", "members"),
    [
        ("num_nodes must be at least 1, not 0", {"num_nodes": 0}),
        ("redraws must be one of never, run, episode, not 'often'", {"redraws": "often"}),
        ("weights must be a number from 0 for each of the 2 nodes", {"weights": (1.0,)}),
    ],
)
def test_what_a_placement_states(scenario_with, message, members):
    with pytest.raises(InputError, match=f"nodes: placement 'mine': {message}"):
        scenario_with(parts.placements, parts.Placement, **{"num_nodes": 2, **members})


ACCESS = {
    "must return Uplinks": lambda part, request, split: request.sends[:, 0],
    r"delivered must be of bool, \(envs, auvs\) = \(3, 2\), not of float64": (
        lambda part, request, split: Uplinks(request.available_j, request.available_j)
    ),
    "spent_j must be finite": lambda part, request, split: Uplinks(
        request.sends, request.available_j / 0
    ),
    "must not deliver that does not send": lambda part, request, split: Uplinks(
        ~request.sends, 0 * request.available_j
    ),
    "must not spend more than available_j": lambda part, request, split: Uplinks(
        part.to_nearest(request), request.available_j + 1
    ),
    "must not be negative": lambda part, request, split: Uplinks(
        part.to_nearest(request), -1 - request.available_j
    ),
}


@pytest.mark.parametrize("message", ACCESS)
def test_access_rules(scenario_with, message):
    scenario = scenario_with(
        parts.access_rules, parts.Access, overrides=TEAM, __call__=ACCESS[message]
    )
    with pytest.raises(InputError, match=f"^access 'mine': .*{message}"):
        World(scenario)


@pytest.mark.parametrize(
    ("message", "call"),
    [
        ("a node must deliver to one AUV at most", lambda part, request, split: request.sends),
        (
            "no more than max_uplinks_per_slot, 1, may deliver in a slot, not 2",
            lambda part, request, split: part.to_nearest(request),
        ),
    ],
)
def test_deliveries_of_access_rules(scenario_with, message, call):
    """In an ample sea every node could send to whoever asks."""

    class Generous(parts.Access):
        def __call__(self, request, split):
            return Uplinks(call(self, request, split), self._zero * split.beta)

        def max_uplinks_per_slot(self, num_auvs):
            return 1 if "max" in message else num_auvs

    ample = {"auvs.count": 4, "charging.power_w": 1e6, "nodes.count": 2}
    scenario = scenario_with(parts.access_rules, Generous, overrides=ample)
    with pytest.raises(InputError, match=f"^access 'mine': {message}"):
        World(scenario)


class Polling(parts.Hearing):
    """A part from outside that polls: the poorest node first."""

    polls = True
    uplinks_per_slot = 2

    def urgency(self, call, offset):
        return -call.available_j[:, None, :]


def replaced(**fields):
    """What a part says of a slot, with other fields."""

    def call(part, heard):
        return heard._replace(**{name: of(part, heard) for name, of in fields.items()})

    return call


POLLS = {
    "must return a Heard, not": lambda part, heard: heard.chosen,
    r"chosen.delivered must be of bool": replaced(
        chosen=lambda part, heard: Uplinks(heard.chosen.spent_j, heard.chosen.spent_j)
    ),
    r"delivered must be of bool, \(envs, auvs, rounds\)": replaced(
        delivered=lambda part, heard: heard.delivered[..., 0]
    ),
    "node must be of int64": replaced(node=lambda part, heard: heard.spent_j),
    "node must be from 0 to K": replaced(node=lambda part, heard: heard.node + 5),
    "nobody must not deliver": replaced(
        delivered=lambda part, heard: (
            heard.delivered | (heard.node == part.world.scenario.num_nodes)
        )
    ),
    "spent_j must not be negative": replaced(spent_j=lambda part, heard: -1 - heard.spent_j),
    "a node must deliver once a slot": replaced(
        node=lambda part, heard: 0 * heard.node,
        delivered=lambda part, heard: heard.node >= 0,
        chosen=lambda part, heard: Uplinks(
            heard.chosen.delivered & False, heard.chosen.spent_j * 0
        ),
    ),
}


@pytest.mark.parametrize("message", POLLS)
def test_hearing(scenario_with, message):
    class Wrong(Polling):
        def __call__(self, *args):
            return POLLS[message](self, super().__call__(*args))

    with pytest.raises(InputError, match=f"^hearing 'mine': {message}"):
        World(scenario_with(parts.hearings, Wrong, overrides=MODEM))


@pytest.mark.parametrize(
    ("message", "urgency"),
    [
        ("urgency must be of float64", lambda part, call, offset: call.age),
        ("urgency must be finite", lambda part, call, offset: call.age[:, None, :] / 0),
        ("raises AttributeError", lambda part, call, offset: call.ages),
    ],
)
def test_who_is_polled_first(scenario_with, message, urgency):
    scenario = scenario_with(parts.hearings, Polling, overrides=MODEM, urgency=urgency)
    with pytest.raises(InputError, match=f"^hearing 'mine': {message}"):
        World(scenario)


@pytest.mark.slow
def test_a_hearing_part_from_outside_keeps_the_contracts(scenario_with):
    scenario = scenario_with(parts.hearings, Polling, overrides=MODEM, nodes_are_alike=False)
    assert scenario.hearing.part.uplinks_per_slot == 2
    check_part(parts.hearings, "mine", seeds=(0,))


def test_hearing_needs_a_rule_for_packets_that_overlap(scenario_with):
    """Where an uplink from outside lets it pass."""
    settings = {key: value for key, value in MODEM["uplink"].items() if key != "kind"}
    members = {"check": lambda part, scenario: None}
    hearing = {"kind": "polling", "max_nodes_per_slot": 2}
    overrides = {**MODEM, **TEAM, "channel.access": "interference", "hearing": hearing}
    overrides["uplink"] = {"kind": "mine", **settings}
    with pytest.raises(InputError, match="'polling' takes an access rule under which uplinks do"):
        scenario_with(parts.uplinks, Modem, overrides=overrides, **members)


STORES = {
    "filled must be of float64": {"filled": lambda part, energy_j: energy_j > 1},
    "filled must not add energy": {"filled": lambda part, energy_j: energy_j + 1.0},
    "filled must not exceed capacity_j": {
        "filled": lambda part, energy_j: energy_j,
        "capacity_j": 1e-3,
    },
    "rest must return a Rest": {"rest": lambda part, energy_j: energy_j},
    "idle_j of rest must not be negative": {
        "rest": lambda part, energy_j: parts.Rest(energy_j + 1, energy_j * 0, energy_j * 0 - 1)
    },
    "energies of rest must add up to what there was": {
        "rest": lambda part, energy_j: parts.Rest(energy_j, energy_j + 1, energy_j * 0)
    },
    "sleeps must be of bool": {"sleeps": lambda part, available_j: available_j},
}


@pytest.mark.parametrize("message", STORES)
def test_stores(scenario_with, message):
    whole = {"rest": lambda part, energy_j: parts.Rest(energy_j, energy_j * 0, energy_j * 0)}
    scenario = scenario_with(parts.storages, parts.Storage, **(whole | STORES[message]))
    with pytest.raises(InputError, match=f"^storage 'mine': {message}"):
        World(scenario)


SPLITS = {
    "split must return a Split": lambda split: split.beta,
    "beta must be of float64": lambda split: split._replace(beta=split.beta[0]),
    "beta must lie from 0 to 1, as stated, not at 1.5": lambda split: split._replace(
        beta=split.beta * 0 + 1.5
    ),
    "charging_s must lie from 0 to 25, as stated, not at 30": lambda split: split._replace(
        charging_s=split.beta * 0 + 30
    ),
    "required_j must not be negative": lambda split: split._replace(
        required_j=-1 - split.required_j
    ),
    "uplink_s must be above 0": lambda split: split._replace(uplink_s=0 * split.uplink_s),
    "charging_s must be a number": lambda split: split._replace(charging_s=split.beta * np.nan),
}


@pytest.mark.slow
@pytest.mark.parametrize("message", SPLITS)
@pytest.mark.parametrize("registry", [parts.duplexes, parts.beta_rules], ids=lambda r: r.role)
def test_splits(scenario_with, registry, message):
    base = {"duplex": TimeDivision, "beta rule": PaperRule}[registry.role]

    class Wrong(base):
        def split(self, *args):
            return SPLITS[message](super().split(*args))

    scenario = scenario_with(registry, Wrong, "paper/k3-tdd")
    with pytest.raises(InputError, match=f"^{registry.role} 'mine': {message}"):
        World(scenario)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("message", "registry", "base", "members"),
    [
        ("num_choices must be 1 or 2", parts.duplexes, TimeDivision, {"num_choices": 3}),
        ("splits_slot must be True", parts.duplexes, TimeDivision, {"splits_slot": "yes"}),
        (
            "uplink_frequency_khz must be above 0",
            parts.duplexes,
            TimeDivision,
            {"uplink_frequency_khz": -1},
        ),
        ("is_limited must be True", parts.storages, parts.Storage, {"is_limited": 1}),
        ("flows must be True", parts.currents, parts.Current, {"flows": 1}),
        (
            "frames must return Frames, not None",
            parts.currents,
            parts.Current,
            {"frames": lambda part, scenario: None},
        ),
        (
            r"velocity_m_per_s must be floats of shape \(frames, cells, 2\)",
            parts.currents,
            parts.Current,
            {"frames": lambda part, scenario: parts.Frames.from_steady(np.zeros((3, 2)))},
        ),
        (
            "velocity_m_per_s must be finite",
            parts.currents,
            parts.Current,
            {"frames": lambda part, scenario: two_frames(scenario, np.nan)},
        ),
        (
            "frame must be from 0 to 0: the next one follows",
            parts.currents,
            parts.Current,
            {"frames": lambda part, scenario: two_frames(scenario, frame=1)},
        ),
        (
            "weight must be from 0 to 1",
            parts.currents,
            parts.Current,
            {"frames": lambda part, scenario: two_frames(scenario, weight=1.2)},
        ),
        (
            "max_speed_m_per_s must be above 0 m/s or None, not -1",
            parts.vehicles,
            parts.Vehicle,
            {"max_speed_m_per_s": -1},
        ),
        ("is_limited must be True", parts.vehicles, parts.Vehicle, {"is_limited": 1}),
        ("capacity_j must be above 0 J", parts.vehicles, parts.Vehicle, {"capacity_j": 0.0}),
        (
            "initial_j must be from 0 to capacity_j in J, not 9",
            parts.vehicles,
            parts.Vehicle,
            {"capacity_j": 5.0, "initial_j": 9.0},
        ),
        (
            "hotel_w must be 0 or more W",
            parts.vehicles,
            parts.Vehicle,
            {"initial_j": 9.0, "hotel_w": -1.0},
        ),
        ("docks must be cells of the grid", parts.vehicles, parts.Vehicle, {"docks": [[1, 1, 99]]}),
        (
            "propulsion_power_w must give a power from 0 in W for each of 3 speeds, not",
            parts.vehicles,
            parts.Vehicle,
            {"propulsion_power_w": lambda part, speed: -speed},
        ),
        (
            "propulsion_power_w must be 0 W at rest, not 7",
            parts.vehicles,
            parts.Vehicle,
            {"propulsion_power_w": lambda part, speed: speed + 7},
        ),
        ("capacity_j must be above 0 J", parts.storages, parts.Storage, {"capacity_j": -5.0}),
        ("drain_w must be 0 or more W", parts.storages, parts.Storage, {"drain_w": np.nan}),
        (
            "initial_j must be from 0 to capacity_j in J, not 9",
            parts.storages,
            parts.Storage,
            {"capacity_j": 5.0, "initial_j": 9.0},
        ),
        (
            r"max_uplinks_per_slot\(1\) must be a whole number from 1, not 0",
            parts.access_rules,
            parts.Access,
            {"max_uplinks_per_slot": lambda part, auvs: 0},
        ),
        (
            r"attenuation_db: must be a number for each of 3 distances, not float64 of shape \(\)",
            parts.channels,
            Levels,
            {"attenuation_db": lambda part, distance_m, khz: 3.0},
        ),
        (
            r"db_per_km\(\d+\) must be a number from 0 in dB/km, not -1.0",
            parts.absorptions,
            parts.Absorption,
            {"db_per_km": lambda part, khz: -1.0},
        ),
        (
            "harvested_power_w must give a number for each of 3 levels, not 1.0",
            parts.harvesters,
            parts.Harvester,
            {"harvested_power_w": lambda part, level_db, acoustic_w: 1.0},
        ),
        (
            "harvested_power_w must be finite and from 0 W",
            parts.harvesters,
            parts.Harvester,
            {"harvested_power_w": lambda part, level_db, acoustic_w: 150 - level_db},
        ),
        (
            "required_energy_j must give a number for each of 3 distances, not 1.0",
            parts.uplinks,
            parts.Uplink,
            {**PACKETS, "required_energy_j": lambda part, *args: 1.0},
        ),
        (
            "least_time_s must be from 0",
            parts.uplinks,
            parts.Uplink,
            {
                **PACKETS,
                "least_time_s": lambda part, distance_m, bands: distance_m - 1,
                "required_energy_j": lambda part, *args: 1.0,
            },
        ),
        ("polls must be True or False, not 1", parts.hearings, parts.Hearing, {"polls": 1}),
        (
            "uplinks_per_slot must be a whole number from 1, not 0",
            parts.hearings,
            Polling,
            {"uplinks_per_slot": 0},
        ),
        (
            "uplinks_per_slot must be 1 where polls is False, not 3",
            parts.hearings,
            parts.Hearing,
            {"uplinks_per_slot": 3},
        ),
        ("packet_bits must be above 0", parts.uplinks, parts.Uplink, {"packet_bits": 0}),
        (
            "longest_uplink must be above 0 and at most 1, not 2",
            parts.duplexes,
            TimeDivision,
            {"longest_uplink": 2},
        ),
    ],
)
def test_what_other_parts_state(scenario_with, message, registry, base, members):
    with pytest.raises(InputError, match=f": {registry.role} 'mine': {message}"):
        scenario_with(registry, base, **members)
