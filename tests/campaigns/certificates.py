"""Certificates of every kind, mutated: no accepted claim exceeds the optimum, nothing crashes.

The worlds are so small that their optimum is known, by playing every action. Most mutated
certificates claim more than it, whatever else is changed: whatever is accepted then is a fault.
"""

from __future__ import annotations

import copy
import json
import time
import warnings
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from bounds.small_worlds import least_age_sum, small_world

from campaigns import mutations
from campaigns.campaign import Campaign, Tally
from iout_marl import load_scenario
from iout_marl.bounds import Certificate, scheduling, verified_age_sum
from iout_marl.bounds.ascent import climb
from iout_marl.bounds.branch_and_bound import search
from iout_marl.bounds.energy import COARSE, ROUGH
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.bounds.prices import Prices
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario
from iout_marl.world import pin_layout

#: Seconds of computing that no check of a small world may take; they take some hundredths.
MOST_SECONDS = 60.0
#: duplex, motion, nodes, slots, rule for β, AUVs; seed.
WORLDS = (
    (("fdd", "six", 2, 5, "paper", 1), 4),
    (("fdd", "hover", 2, 4, "paper", 1), 11),
    (("fdd", "six", 3, 4, "paper", 1), 13),
    (("fdd", "six", 1, 7, "paper", 1), 11),
    (("tdd", "six", 2, 6, "paper", 1), 2),
    (("tdd", "hover", 3, 4, "paper", 1), 5),
    (("tdd", "six", 2, 6, "stored", 1), 2),
    (("tdd", "hover", 3, 4, "stored", 1), 11),
    (("tdd", "six", 1, 8, "stored", 1), 5),
    (("fdd", "six", 2, 2, "paper", 2), 2),
)


class Target(NamedTuple):
    """A world, the least sum of ages in it, and true certificates of it as JSON has them."""

    scenario: Scenario
    optimum: int
    records: list[dict[str, Any]]


@cache
def targets() -> list[Target]:
    """All worlds."""
    made = [
        small_world(np.random.default_rng(seed), duplex, motion, nodes, slots, rule, auvs)
        for (duplex, motion, nodes, slots, rule, auvs), seed in WORLDS
    ]
    made += [_one_cell("fdd"), _one_cell("tdd")]
    found = [Target(s, least_age_sum(s), _certificates(s)) for s in made]
    return [*found, _anywhere()]


def _one_cell(duplex: str) -> Scenario:
    changes = {"cells": [[1, 1, 1]], "count": None}
    return load_scenario(
        f"paper/k3-{duplex}",
        {
            "grid.cells": [1, 1, 1],
            "auvs.start_cells": [[1, 1, 1]],
            "episode.duration_s": 150,
            "age.initial": 4,
            "age.maximum": 4,
            **{f"nodes.{key}": value for key, value in changes.items()},
        },
    )


def _anywhere() -> Target:
    """Nodes drawn at random: a claim must hold wherever they are."""
    # Of a world in which energy binds, with the certificate of the layout that a check would draw.
    fixed = small_world(np.random.default_rng(2), "tdd", "six", 2, 6, "paper")
    random = {"kind": "random", "count": 2, "redraw": "run", "weights": None}
    scenario = Scenario.model_validate({**fixed.model_dump(), "nodes": random}, strict=False)
    layouts = [pin_layout(scenario, seed) for seed in range(12)]
    records = [record for layout in layouts[:2] for record in _certificates(layout)]
    for record in records:
        record["world_hash"] = scenario.world_hash
    return Target(scenario, min(map(least_age_sum, layouts)), records)


def _certificates(scenario: Scenario) -> list[dict[str, Any]]:
    """A certificate of each kind that holds, and of the Lagrangian bound two."""
    world_hash, scheduled = scenario.world_hash, scheduling.least_age_sum(scenario)
    found = [Certificate(world_hash, scheduled)]
    if scenario.num_auvs == 1:
        games = [FiniteGame.from_scenario(scenario, ladder) for ladder in (COARSE, ROUGH)]
        ladders = [tuple(game.levels_j[:-1].tolist()) for game in games]
        highest = scenario.num_nodes * scenario.num_slots * scenario.age.maximum
        opened = search(games[0], scheduled, highest, np.inf)
        found.append(Certificate(world_hash, opened, ladders[0]))
    if scenario.num_auvs == 1 and scenario.duplex.kind == "tdd":
        climbed = climb(games[1], np.inf)
        assert climbed is not None
        age_sum, prices, _, oldest = climbed
        found += [
            Certificate(world_hash, int(age_sum - 0.1), ladder, prices, oldest)
            for ladder in ladders
        ]
    return [each.to_json() for each in found]


def run(rng: np.random.Generator, cases: int) -> Tally:
    """Mutate certificates, so many times."""
    tally = Tally()
    known = targets()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for _ in range(cases):
            target = known[rng.integers(len(known))]
            record = copy.deepcopy(target.records[rng.integers(len(target.records))])
            record["age_sum"] = _claim(rng, target, record["age_sum"])
            for _ in range(rng.choice([0, 1, 1, 1, 2, 4])):
                with np.errstate(all="ignore"):
                    record = _mutated(rng, record)
            begun = time.process_time()
            _try(tally, target, record, way=int(rng.integers(3)))
            if time.process_time() - begun > MOST_SECONDS:
                tally.fault(_shown(record), f"took more than {MOST_SECONDS} s")
    return tally


def _claim(rng: np.random.Generator, target: Target, proven: int) -> int:
    """What to claim: most often too much."""
    scenario, optimum = target.scenario, target.optimum
    highest = scenario.num_nodes * scenario.num_slots * scenario.age.maximum
    claims = [proven, optimum, optimum + 1, optimum + 1, optimum + 1, optimum + 2, highest]
    return claims[rng.integers(len(claims))]


def _mutated(rng: np.random.Generator, record: dict[str, Any]) -> dict[str, Any]:
    """A record with another change: a clumsy one, or one that leaves it well-formed."""
    if rng.random() < 0.5:
        return mutations.changed(rng, record)
    try:
        return _meant(rng, record)
    except (KeyError, TypeError, ValueError, OverflowError, IndexError):
        # An earlier change has left nothing to work on.
        return mutations.changed(rng, record)


def _meant(rng: np.random.Generator, record: dict[str, Any]) -> dict[str, Any]:
    """The record with other levels, prices or slots, of the right types and shapes."""
    levels = np.array(record["levels_j"], dtype=np.float64)
    span = float(abs(levels).max()) or 1.0
    choice = int(rng.integers(10 if "slots" in record else 4))
    if choice == 0:
        record["levels_j"] = (levels * 10.0 ** rng.uniform(-3, 3)).tolist()
    elif choice == 1:
        record["levels_j"] = (levels + span * rng.choice([-2, -0.5, -1e-9, 1e-9, 0.5])).tolist()
    elif choice == 2:
        made = np.sort(rng.random(rng.integers(1, 40))) * span
        record["levels_j"] = [0.0, *made.tolist()]
    elif choice == 3:
        record["levels_j"] = [0.0, *(span * 2.0 ** np.arange(-60, 900, 40)).tolist()]
    else:
        naming = np.array(record["naming"], dtype=np.float64)
        presence = np.array(record["presence"], dtype=np.float64)
        size = 10.0 ** rng.uniform(-2, rng.choice([1, 12]))
        if choice == 4:
            naming = naming * size
        elif choice == 5:
            presence = presence + rng.normal(size=presence.shape) * size
        elif choice == 6:
            presence = presence + rng.normal(size=presence.shape[-1]) * size
        elif choice == 7:
            record["oldest"] = int(rng.integers(2, 60))
        elif choice == 8:
            record["reach_m"] = float(10.0 ** rng.uniform(-8, 18))
        else:
            # As many slots as before, from 0 on, which may end anywhere.
            later = rng.choice(np.arange(1, 12), len(record["slots"]) - 1, replace=False)
            record["slots"] = [0, *np.sort(later).tolist()]
        record["naming"], record["presence"] = naming.tolist(), presence.tolist()
    return record


def _try(tally: Tally, target: Target, record: dict[str, Any], way: int) -> None:
    """Have a certificate checked: read from a record or from a text, or made by hand."""
    try:
        if way == 0:
            certificate = Certificate.from_json(record)
        elif way == 1:
            certificate = Certificate.from_json(json.loads(json.dumps(record, default=str)))
        else:
            certificate = _by_hand(record)
        proven = verified_age_sum(target.scenario, certificate)
    except InputError as refusal:
        line = str(refusal)
        if not line.isprintable() or not line.startswith("certificate: ") or len(line) > 300:
            tally.fault(_shown(record), f"refused by {line[:400]!r}")
        else:
            tally.note("refused")
        return
    except (RecursionError, OverflowError, TypeError, ValueError, MemoryError) as error:
        if way == 1 and error.__traceback__ and _is_from_json(error):
            tally.note("no JSON")
        else:
            tally.fault(_shown(record), error)
        return
    except Exception as error:
        tally.fault(_shown(record), error)
        return
    if type(proven) is not int or proven != certificate.age_sum or proven > target.optimum:
        tally.fault(_shown(record), f"accepted, with an optimum of {target.optimum}")
    else:
        tally.note("accepted")


def _shown(record: Any) -> str:
    """A record as text, where it can be written."""
    try:
        return str(record)
    except (RecursionError, ValueError):
        return "a record that is too deep, or has numbers of too many digits, to be written"


def _is_from_json(error: BaseException) -> bool:
    """Whether Python's own writer of JSON could not write the record."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return trace is not None and trace.tb_frame.f_globals.get("__name__", "").startswith("json")


def _by_hand(record: dict[str, Any]) -> Any:
    """The certificate as a program might put it together, unchecked."""
    if not isinstance(record, dict):
        return record
    prices = None
    if any(name in record for name in ("slots", "naming", "presence", "reach_m")):
        prices = Prices(
            _tuple(record.get("slots")),
            _array(record.get("naming")),
            _array(record.get("presence")),
            record.get("reach_m"),  # type: ignore[arg-type]
        )
    levels = record.get("levels_j")
    return Certificate(
        record.get("world_hash"),  # type: ignore[arg-type]
        record.get("age_sum"),  # type: ignore[arg-type]
        _tuple(levels),
        prices,
        record.get("oldest"),
    )


def _tuple(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _array(value: Any) -> Any:
    """An array, where the value makes one."""
    try:
        return np.array(value)
    except (ValueError, OverflowError, RecursionError):
        return value


CAMPAIGN = Campaign("certificates", cases=10_000, short=200, run=run)
