"""Whole episodes of the oracle under biased random actions, and what happened in them."""

from __future__ import annotations

import math
import random
from collections import Counter
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
from oracle import Oracle

from iout_marl.scenario import load_scenario
from iout_marl.world import ChanceStream, World, node_codes

if TYPE_CHECKING:
    from iout_marl.scenario import Scenario

#: Environments of a batch; each has actions (and drawn nodes) of its own.
ENVS = 3
STATE = (
    "slot",
    "age",
    "energy_j",
    "deliveries",
    "harvested_j",
    "spent_j",
    "age_sum",
    "peak_age",
    "capped_ages",
)
VEHICLES = (
    *("battery_j", "propulsion_j", "hotel_j", "charging_j", "docked_j"),
    *("distance_m", "stranded_slots"),
)
SEA = ("gain_db", "gust_m_per_s", "packets")
STORES = ("spilled_j", "leaked_j", "idle_j", "asleep_slots")
EVENTS = (
    *("left_grid", "blocked", "beta", "harvested_j", "delivered", "spent_j"),
    *("polled", "polled_delivered", "polled_j"),
)


@dataclass(frozen=True)
class Case:
    """A scenario with overrides, and what must happen in its episodes."""

    scenario: str
    happens: set[str]
    overrides: dict[str, Any] = field(default_factory=dict)
    episodes: int = 1
    tolerance: float = 1e-9


@dataclass
class ExpectedSlot:
    """What the oracle says of one slot: an entry for each env in every list."""

    action: list[Any]
    state: dict[str, list[Any]]
    events: dict[str, list[Any]]
    terms: dict[str, list[Any]]
    metrics: dict[str, list[Any]]
    observation: list[Any]
    chance: Any = None


@dataclass
class ExpectedEpisode:
    layouts: list[list[tuple[int, ...]]]
    first_observation: list[Any]
    slots: list[ExpectedSlot]


def biased_action(rng: random.Random, env: int, oracle: Oracle) -> list[list[int]]:
    """Env 0 acts at random, env 1 stays with node 0, env 2 visits one node after another.

    All AUVs of an env have the same target, so they often choose the same node.
    """
    num_nodes = len(oracle.nodes)
    num_choices = num_nodes + oracle.scenario.auvs.idle_choices
    target = {0: None, 1: 0, 2: oracle.slot // 12 % num_nodes}[env]
    action = []
    for cell in oracle.auv_cells:
        direction = rng.randrange(len(oracle.steps))
        nodes = [rng.randrange(num_choices), rng.randrange(num_choices)]
        if target is not None and rng.random() < 0.8:
            goal = oracle.node_cells[target]
            nodes = [target if rng.random() < 0.85 else node for node in nodes]
            ahead = [
                i
                for i, step in enumerate(oracle.steps)
                if sum(s * (g - c) for s, g, c in zip(step, goal, cell, strict=True)) > 0
            ]
            direction = rng.choice(ahead) if ahead else direction
        entries = 2 if oracle.scenario.duplex.kind == "fdd" else 1
        action.append([direction, *nodes[:entries]])
    return action


def what_happened(oracle: Oracle, capped_before: int, silenced_before: int) -> Counter[str]:
    """Names of what a case may ask for, counted over one slot of one env."""
    seen: Counter[str] = Counter()
    seen["silenced uplink"] += oracle.silenced - silenced_before
    stores = oracle.stores
    seen["spilled"] += len(stores.spilling)
    seen["starved"] += len(stores.starved)
    seen["asleep when heard"] += sum(event.heard in stores.sleeping for event in oracle.events)
    seen["store too small"] += len(stores.refused)
    vehicles = oracle.vehicles
    for what in ("stranded", "halted", "refused", "docked"):
        seen[f"vehicle {what}"] += len(getattr(vehicles, what))
    for what in ("holding", "drifting", "aground"):
        seen[f"water: {what}"] += len(getattr(oracle.water, what))
    seen["lost too weak"] += sum(excess < 0 for excess in oracle.sea.lost.values())
    seen["lost by bit errors"] += sum(excess >= 0 for excess in oracle.sea.lost.values())
    seen["lost when polled"] += sum(number > 0 for _, number in oracle.sea.lost)
    seen["collision"] += sum(e.spent_j > 0 and not e.delivered for e in oracle.events) > 1
    if oracle.scenario.hearing.kind == "polling":
        seen += kind_of_polling(oracle)
    for auv, event in enumerate(oracle.events):
        if event.delivered:
            alone = oracle.alone_j(auv, event.heard)
            seen["disturbed uplink"] += event.spent_j > alone * (1 + 1e-6)
    fair_share = oracle.scenario.num_slots / len(oracle.nodes)
    seen["capped age"] += oracle.capped_ages - capped_before
    for auv, event in enumerate(oracle.events):
        seen["delivery" if event.delivered else "no delivery"] += 1
        seen["left grid"] += event.left_grid
        seen["kept apart"] += event.blocked
        seen["under way"] += oracle.transit[auv] is not None
        seen["given up"] += event.gave_up
        charges, hears = (n != oracle.nobody for n in (event.charged, event.heard))
        seen["nobody charged"] += not charges and hears
        seen["nobody heard"] += charges and not hears
        seen["idle"] += not charges and not hears
        if hears:
            heard_m = oracle.distance_m(auv, event.heard)
            uplink_j = oracle.sound.required_j(heard_m, oracle.scenario.slot_s)
            seen["out of range"] += uplink_j == math.inf
        if charges:
            charged_m = oracle.distance_m(auv, event.charged)
            seen["below threshold"] += oracle.sound.harvested_j(charged_m, 1.0) == 0
            seen["same cell"] += oracle.auv_cells[auv] == oracle.node_cells[event.charged]
        seen["overserved node"] += event.delivered and oracle.deliveries[event.heard] > fair_share
        if oracle.scenario.duplex.kind == "tdd":
            seen += kind_of_split(oracle, auv) if charges else Counter()
        elif hears and not event.delivered:
            seen["wrong node" if event.some_node_able else "no able node"] += 1
        for other in range(auv):
            seen += kind_of_encounter(oracle, auv, other)
        book = oracle.notebooks[auv]
        seen["lost sight"] += min(book.seen_slot) < oracle.slot - 3
        in_sight = hears and oracle.distance_m(auv, event.heard) <= (
            oracle.scenario.observation.view_range_m or math.inf
        )
        seen["news from afar"] += event.delivered and not in_sight
        alone = [without > age for without, age in zip(book.age_without, oracle.age, strict=True)]
        seen["helped by another"] += any(alone) and not all(alone)
    return seen


def kind_of_split(oracle: Oracle, auv: int) -> Counter[str]:
    duplex, beta = oracle.scenario.duplex, oracle.events[auv].beta
    if beta in (0, 1):
        return Counter(["only charging" if beta else "only transmitting"])
    seen = Counter(["both"])
    seen["least charging"] += beta == duplex.beta_min
    return seen


def kind_of_polling(oracle: Oracle) -> Counter[str]:
    seen: Counter[str] = Counter()
    for event in oracle.events:
        polled = [node for node in event.polled if node != oracle.nobody]
        seen["polled"] += len(polled)
        seen["polled in the place of the chosen"] += bool(polled) and event.spent_j == 0
        seen["polled after the chosen"] += bool(polled) and event.delivered
        seen["polled and lost"] += len(polled) > sum(event.polled_delivered)
        ages = [oracle.age[node] for node in polled]
        seen["packets of different ages"] += len(set(ages)) > 1
    seen["rivals"] += oracle.polls.rivals
    seen["too late"] += oracle.polls.too_late
    return seen


def kind_of_encounter(oracle: Oracle, auv: int, other: int) -> Counter[str]:
    seen: Counter[str] = Counter()
    pair = [oracle.events[auv], oracle.events[other]]
    seen["shared charging"] += pair[0].charged == pair[1].charged != oracle.nobody
    if pair[0].heard != pair[1].heard or pair[0].heard == oracle.nobody:
        return seen
    distances = [oracle.distance_m(i, pair[0].heard) for i in (auv, other)]
    equal = distances[0] == distances[1]
    contested = pair[0].contested and pair[1].contested
    farther = pair[0] if distances[0] > distances[1] else pair[1]
    seen["contested uplink"] += contested
    seen["contest at equal distance"] += contested and equal
    seen["nearest AUV silent"] += farther.delivered and not equal
    return seen


def codes(world: World, scenario: Scenario, episode: int):
    generators = [np.random.default_rng([episode, env]) for env in range(ENVS)]
    return node_codes(scenario, world.grid, generators)


def layouts(scenario: Scenario, episode: int) -> list[list[tuple[int, ...]]]:
    """Cells of the nodes in each env; where they are drawn, the observation tells them."""
    count = scenario.num_nodes
    if scenario.nodes.kind == "fixed":
        return [list(scenario.nodes.cells[:count])] * ENVS
    world = World(scenario, num_envs=ENVS, library=np, dtype="float64")
    seen = world.observe(world.reset(codes(world, scenario, episode)))
    cells = seen[:, 0, 3 + 2 * count :].reshape(ENVS, count, 3).astype(int).tolist()
    return [[tuple(cell) for cell in env] for env in cells]


def play(case: Case) -> tuple[Scenario, list[ExpectedEpisode], Counter[str]]:
    """The oracle's episodes of a case, and how often each thing happened in them."""
    scenario = load_scenario(case.scenario, case.overrides)
    rng, seen, episodes = random.Random(0), Counter(), []
    for number in range(case.episodes):
        cells = layouts(scenario, number)
        oracles = [Oracle(scenario, env_cells) for env_cells in cells]
        episode = ExpectedEpisode(cells, [oracle.observe() for oracle in oracles], [])
        stream = ChanceStream(scenario, [np.random.default_rng([9, i]) for i in range(ENVS)])
        for _ in range(scenario.num_slots):
            chance = next(stream)
            action = [biased_action(rng, env, oracle) for env, oracle in enumerate(oracles)]
            for env, (oracle, entries) in enumerate(zip(oracles, action, strict=True)):
                before = oracle.capped_ages, oracle.silenced
                oracle.step(entries, drawn_for(chance, env))
                seen += what_happened(oracle, *before)
            episode.slots.append(_expected_slot(action, oracles, chance))
        episodes.append(episode)
    return scenario, episodes, seen


def drawn_for(chance: Any, env: int) -> dict[str, Any]:
    """What was drawn for one environment, in lists, without what was not."""
    if chance is None:
        return {}
    return {name: array[env].tolist() for name, array in chance._asdict().items() if array.size}


def _expected_slot(action: list[Any], oracles: list[Oracle], chance: Any) -> ExpectedSlot:
    def by_name(rows: list[dict[str, Any]]) -> dict[str, list[Any]]:
        return {name: [row[name] for row in rows] for name in rows[0]}

    limited = [oracle for oracle in oracles if oracle.stores.is_limited]
    of_stores = STORES if limited else ()
    with_batteries = [oracle for oracle in oracles if oracle.vehicles.is_limited]
    of_vehicles = VEHICLES if with_batteries else ()
    return ExpectedSlot(
        action,
        # As arrays, because the oracle continues writing in its lists.
        {
            **{name: np.array([getattr(oracle, name) for oracle in oracles]) for name in STATE},
            **{
                name: np.array([getattr(oracle.stores, name) for oracle in limited])
                for name in of_stores
            },
            **{
                name: np.array([getattr(oracle.vehicles, name) for oracle in with_batteries])
                for name in of_vehicles
            },
            **{name: np.array([getattr(o.sea, name) for o in oracles]) for name in SEA},
        },
        {name: [[getattr(e, name) for e in o.events] for o in oracles] for name in EVENTS},
        by_name([oracle.reward_terms() for oracle in oracles]),
        by_name([oracle.metrics() for oracle in oracles]),
        [oracle.observe() for oracle in oracles],
        chance,
    )
