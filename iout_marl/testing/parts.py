"""Contract tests of a registered part: what all parts of its role promise, whoever has made it.

What they say of a part they say of it in worlds of several AUVs, of a single one, in frequency
and in time division, as far as the part's role goes with these.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from iout_marl import iout_v0
from iout_marl.core.limits import unheard
from iout_marl.core.table import flattened
from iout_marl.errors import InputError, did_you_mean
from iout_marl.parts.base import Part
from iout_marl.registry import Entry, Registry, registries, registry_of
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario
from iout_marl.scenario.keys import all_keys
from iout_marl.scenario.layers import Layer
from iout_marl.scenario.parts import Settings, part_of, parts_in, settings_model
from iout_marl.scenario.places import Places
from iout_marl.scenario.plain import plain_mapping
from iout_marl.scenario.problems import validate
from iout_marl.testing import by_role
from iout_marl.testing.environments import SEEDS
from iout_marl.testing.recorded import (
    Slot,
    actions_for,
    chance_for,
    compare,
    episode,
    first_state,
    permuted,
    permuted_chance,
    renamed,
)
from iout_marl.testing.settings import check_settings
from iout_marl.testing.training import check_training
from iout_marl.world import World
from iout_marl.world.watch import watch

#: Small in every respect, with energies that bind: packets that a slot's harvest pays nearby.
SMALL = {
    "grid.cells": [4, 3, 2],
    "nodes.cells": [[1, 1, 1], [4, 3, 2], [2, 3, 1], [4, 1, 1]],
    "nodes.count": 4,
    "episode.duration_s": 400,
    "age.maximum": 9,
    "uplink.packet_bits": 30000,
    "charging.power_w": 60000,
}
#: An AUV may name nobody: K is an action, and is in events.
NOBODY = {"auvs.idle_choices": True}
TEAM = {"auvs.start_cells": [[2, 2, 1], [4, 2, 1], [1, 3, 2]]}
ALONE = {"auvs.start_cells": [[2, 2, 1]]}
ONE_BAND = {"channel.access": "interference"}
#: Modems, whose packets leave time for further ones.
MODEMS = {
    "channel": {"kind": "sonar", "spreading_factor": 2.0},
    "charging.power_w": 2000,
    "harvester": {"kind": "aperture", "area_m2": 0.05, "efficiency": 0.6},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 3000.0,
        "packet_bits": 2048.0,
        "bandwidth_hz": 4500.0,
        "electronics_w": 0.8,
        "maximum_source_level_db": 118.0,
    },
}
#: Roles whose parts are put into worlds with modems, and what else they take there: a sea in which
#: packets get lost, some by bit errors.
ROUGH = {"uplink.required_snr_db": 5.0, "uplink.loss": "bpsk"}
SHADOWED = {"channel.fading": {"kind": "shadowing", "sigma_db": 3.0, "coherence_s": 300.0}}
WITH_MODEMS: Mapping[str, Mapping[str, Any]] = {
    "hearing": {},
    "fading": ROUGH,
    "wind": ROUGH,
    "loss": ROUGH | SHADOWED,
}
#: The worlds, by what they are called where a test fails.
WORLDS: Mapping[str, tuple[str, dict[str, Any]]] = {
    "3 AUVs, FDD": ("paper/k5-fdd", SMALL | TEAM),
    "3 AUVs, TDD": ("paper/k5-tdd", SMALL | TEAM),
    "3 AUVs, TDD, one band": ("best/k5-tdd", SMALL | TEAM | ONE_BAND | NOBODY),
    "1 AUV, FDD": ("paper/k5-fdd", SMALL | ALONE | NOBODY),
    "1 AUV, TDD": ("paper/k5-tdd", SMALL | ALONE),
}
#: Further ones for entries of observations, whose rows a table permutes.
TABLES: Mapping[str, tuple[str, dict[str, Any]]] = {
    f"{name}, in a table": (base, {**changes, "observation": "table"})
    for name, (base, changes) in WORLDS.items()
    if name in ("3 AUVs, FDD", "1 AUV, TDD")
}
#: Roles of parts that may be for tables.
IN_TABLES = ("observation entry", "network")
#: What a training is tested in: of a world it knows sizes alone, of observations and of actions.
OF_TRAINING: Mapping[str, tuple[str, ...]] = {
    "network": ("3 AUVs, FDD", "3 AUVs, TDD, one band", "1 AUV, TDD", *TABLES),
    "optimizer": ("3 AUVs, FDD", "1 AUV, TDD"),
}
#: Sums in another order, or by another library.
ROUNDING = 1e-9


def check_part(
    role: str | Registry[Any],
    kind: str,
    settings: Mapping[str, Any] | None = None,
    *,
    scenario: AnyScenario | None = None,
    overrides: Overrides = (),
    seeds: Sequence[int] = SEEDS,
) -> None:
    """Run all contract tests of one part.

    A batch equals single environments; torch equals NumPy in float64; a single environment equals
    the batch; permuting nodes or AUVs permutes the results, where the part says so; nothing is
    mutated; what is returned has the right shape and type, is finite and within its declared
    ranges; settings survive YAML and pickling and are in the hash; and what the role promises. Of
    networks and optimizers: see `iout_marl.testing.training.check_training`.

    Args:
        role: of the part, or its registry: `parts.rewards`, say.
        kind: the part's.
        settings: its keys; those without a default must be there.
        scenario: what the part is put into; None for worlds that suit its role, but for those
            that the part's `check` refuses.
        overrides: further changes of the scenario, which the part needs.
        seeds: of layouts and actions.

    Raises:
        InputError: no such role, kind or scenario, or a fault in it or in the settings.
        AssertionError: the first contract that fails: role, kind, contract, where.
    """
    entry = _entry(role, kind)
    subject = _Subject(entry, {"kind": kind, **(settings or {})})
    where = f"{entry.role} {kind!r}"
    validate(settings_model(entry), Layer(plain_mapping(subject.data, where), Places(where)))
    if scenario is None:
        bases = dict(_bases(entry.role, overrides))
    else:
        base = load_scenario(scenario, overrides)
        bases = {base.name: base}
    with subject.contract("in a scenario"):
        worlds = dict(subject.put_into(bases))
    contracts = CONTRACTS if entry.item.is_of_world else CONTRACTS_OF_TRAINING
    # Settings are the same in all of them.
    name, world = next(iter(worlds.items()))
    with subject.contract("settings", name):
        check_settings(world, _key(entry.role), subject.settings(world))
    for name, world in worlds.items():
        for contract, check in contracts.items():
            with subject.contract(contract, name):
                check(subject, world, tuple(seeds))


def _entry(role: str | Registry[Any], kind: str) -> Entry[Any]:
    name = role.role if isinstance(role, Registry) else role
    roles = [r.role for r in registries() if r.base is not None and issubclass(r.base, Part)]
    if name not in roles:
        raise InputError(f"unknown role {name!r}{did_you_mean(name, roles)}")
    return registry_of(name)[kind]


@dataclass(frozen=True)
class _Subject:
    """A part under test.

    Attributes:
        entry: what is registered.
        data: its settings as a scenario file has them.
    """

    entry: Entry[Any]
    data: dict[str, Any]
    _known: dict[tuple[Any, ...], list[Slot]] = field(default_factory=dict)
    _worlds: dict[tuple[Any, ...], World] = field(default_factory=dict)

    def world(self, scenario: Scenario, seeds: Sequence[int]) -> World:
        """A world of as many environments, the same for all contracts: it keeps no state."""
        key = (scenario.name, scenario.hash, len(seeds))
        if key not in self._worlds:
            self._worlds[key] = World(scenario, len(seeds))
        return self._worlds[key]

    def played(self, scenario: Scenario, seeds: Sequence[int]) -> list[Slot]:
        """An episode of random actions, played once for all contracts that compare with it."""
        key = (scenario.name, scenario.hash, *seeds)
        if key not in self._known:
            self._known[key] = _played(self.world(scenario, seeds), seeds)
        return self._known[key]

    @contextmanager
    def contract(self, name: str, where: str = "") -> Iterator[None]:
        """Whatever is raised meanwhile is a contract that fails.

        Raises:
            AssertionError: in its place, in one line.
        """
        try:
            # What a single environment plays on is no matter of right or wrong.
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)
                yield
        except Exception as error:
            what = str(error) if isinstance(error, AssertionError | InputError) else repr(error)
            of = f"{self.entry.role} {self.entry.kind!r}: "
            place = f" ({where})" if where else ""
            line = InputError(f"{of}{name}: {what.replace(of, '')}{place}")
            raise AssertionError(str(line)) from error

    def put_into(self, bases: Mapping[str, Scenario]) -> Iterator[tuple[str, Scenario]]:
        """The scenarios with the part, but for those that it refuses, if not all of them.

        Raises:
            InputError: it refuses all.
        """
        role = self.entry.role
        data = [self.data] if role == "observation entry" else self.data
        refusals = []
        for name, base in bases.items():
            try:
                yield name, load_scenario(base, {_key(role): data})
            except InputError as error:  # it may not be for all worlds
                refusals.append(error)
        if len(refusals) == len(bases):
            raise refusals[0]

    def settings(self, scenario: Scenario) -> Settings:
        """The part's settings in a scenario."""
        return next(s for _, s in parts_in(scenario) if self.is_it(s))

    def is_it(self, settings: Settings) -> bool:
        """Whether settings are those of the part."""
        return settings.entry == self.entry


def _bases(role: str, overrides: Overrides) -> Iterator[tuple[str, Scenario]]:
    """Scenarios for a part of a role, by name."""
    for name in {**WORLDS, **TABLES} if role in IN_TABLES else WORLDS:
        # A duplex part stands in for either; its worlds are those for the paper's first.
        is_out = {"beta rule": "TDD" not in name, "duplex": "FDD" not in name}
        if (
            not is_out.get(role)
            and not (role == "access" and "one band" in name)
            and name in OF_TRAINING.get(role, (name,))
        ):
            yield name, load_scenario(_base(name, role if role in WITH_MODEMS else ""), overrides)


@functools.cache
def _base(name: str, role: str) -> Scenario:
    """One of the worlds, with modems for a role that has them."""
    base, changes = {**WORLDS, **TABLES}[name]
    more = _with_modems(name) if role else {}
    return load_scenario(load_scenario(base, changes | more), WITH_MODEMS.get(role, {}))


def _with_modems(name: str) -> dict[str, Any]:
    """What a world takes for uplinks that have a time of their own."""
    more: dict[str, Any] = dict(MODEMS)
    if "TDD" in name:
        more["duplex.beta_rule"] = "airtime"
    if "one band" in name:
        more["channel.access"] = "exclusive"
    return more


def _key(role: str) -> str:
    """Where a scenario names a part of a role."""
    found = (
        key
        for key, fields in all_keys(Scenario).items()
        if any((part := part_of(field)) and part.role == role for field in fields)
    )
    return next(found, "observation.entries")


def _is_as_stated(subject: _Subject, scenario: Scenario, _: Sequence[int]) -> None:
    subject.settings(scenario).part.check_stated(scenario)


@unheard
def _values(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Shapes, types, ranges; nothing is mutated."""
    world = World(scenario, len(seeds))
    watch(world, subject.is_it)
    state = first_state(world, seeds)
    chance = chance_for(world, seeds)
    for slot, action in enumerate(actions_for(world, seeds[0])):
        given = state.map(np.copy), action.copy()
        world.observe(state)
        after, events = world.step(state, action, next(chance))
        world.reward(after, events)
        compare((state, action), given, 0, f"slot {slot}: an argument is changed: ")
        state = after


def _is_deterministic(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    again = _played(World(scenario, len(seeds)), seeds)
    _compare_slots(subject.played(scenario, seeds), again, 0)


def _batch(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    actions = actions_for(subject.world(scenario, seeds), seeds[0])
    together = subject.played(scenario, seeds)
    alone = World(scenario)
    for i, seed in enumerate(seeds):
        slots = episode(
            alone,
            first_state(alone, [seed]),
            actions[:, i : i + 1],
            chance=chance_for(alone, [seed]),
        )
        _compare_slots([slot.of_env(i) for slot in together], slots, ROUNDING)


def _torch(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    import torch

    found = _played(World(scenario, len(seeds), library=torch), seeds)
    _compare_slots(found, subject.played(scenario, seeds), ROUNDING)


def _played(world: World, seeds: Sequence[int]) -> list[Slot]:
    start, actions = first_state(world, seeds), actions_for(world, seeds[0])
    return episode(world, start, actions, chance=chance_for(world, seeds))


def _nodes(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    part = subject.entry.item
    if part.nodes_are_alike and len(set(scenario.node_weights)) == 1:
        _permute(subject, scenario, seeds, nodes=np.arange(scenario.num_nodes)[::-1])


def _auvs(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    if subject.entry.item.auvs_are_alike:
        _permute(subject, scenario, seeds, auvs=np.roll(np.arange(scenario.num_auvs), 1))


def _permute(
    subject: _Subject, scenario: Scenario, seeds: Sequence[int], **order: np.ndarray[Any, Any]
) -> None:
    world = subject.world(scenario, seeds)
    start, actions = first_state(world, seeds), actions_for(world, seeds[0])
    place = None
    if subject.entry.role == "observation entry":
        place = by_role.place_of_entry(world, subject.is_it)
        slots = episode(world, start, actions, place, chance=chance_for(world, seeds))
    else:
        slots = subject.played(scenario, seeds)
    start, actions = permuted(start, **order), permuted_actions(actions, **order)
    chance = (drawn and permuted_chance(drawn, **order) for drawn in chance_for(world, seeds))
    again = episode(world, start, actions, place, chance=chance)
    # Observations are of many parts; of an entry, its own are compared.
    _compare_slots(
        [slot.without("observation") for slot in again],
        [slot.permuted(**order).without("observation") for slot in slots],
        ROUNDING,
    )


def permuted_actions(
    actions: np.ndarray[Any, Any],
    nodes: np.ndarray[Any, Any] | None = None,
    auvs: np.ndarray[Any, Any] | None = None,
) -> np.ndarray[Any, Any]:
    """(slots, envs, auvs, entries) actions in a world whose nodes or AUVs are in another order."""
    if nodes is not None:
        actions = actions.copy()
        actions[..., 1:] = renamed(actions[..., 1:], nodes)
    return actions if auvs is None else actions[:, :, auvs]


def _compare_slots(found: list[Slot], expected: list[Slot], rounding: float) -> None:
    for number, (one, other) in enumerate(zip(found, expected, strict=True)):
        compare(one.values, other.values, rounding, f"slot {number}: ")


def _single(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    """An environment of one's own, traced or on arrays, equals the batch."""
    actions = actions_for(subject.world(scenario, seeds), seeds[0])
    slots = subject.played(scenario, seeds)
    env = iout_v0.parallel_env(scenario)
    env.reset(seed=seeds[0])
    for number, (slot, action) in enumerate(zip(slots, actions, strict=True)):
        given = dict(zip(env.possible_agents, action[0], strict=True))
        observations, rewards = env.step(given)[:2]
        found = {
            "observation": np.array([_vector(o) for o in observations.values()]),
            "reward": np.array(list(rewards.values())),
        }
        expected = {
            "observation": slot.values["observation"][0].astype(np.float32),
            "reward": slot.values["reward"][0],
        }
        compare(found, expected, ROUNDING, f"slot {number}: ")


def _vector(observation: Any) -> Any:
    if not isinstance(observation, dict):
        return observation
    return observation["observation"] if "observation" in observation else flattened(observation)


def _role(subject: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:
    check = by_role.CHECKS.get(subject.entry.role)
    if check is not None:
        check(subject.settings(scenario).part, scenario, seeds)


def _training(_: _Subject, scenario: Scenario, seeds: Sequence[int]) -> None:  # noqa: ARG001
    check_training(scenario)


#: What all parts promise, in the order in which it is tested.
CONTRACTS: Mapping[str, Callable[[_Subject, Scenario, Sequence[int]], None]] = {
    "what it states": _is_as_stated,
    "what its role promises": _role,
    "values": _values,
    "the same twice": _is_deterministic,
    "a batch equals single worlds": _batch,
    "torch equals NumPy": _torch,
    "permuted nodes": _nodes,
    "permuted AUVs": _auvs,
    "a single environment equals the batch": _single,
}
#: The same of what works in a training.
CONTRACTS_OF_TRAINING: Mapping[str, Callable[[_Subject, Scenario, Sequence[int]], None]] = {
    "what it states": _is_as_stated,
    "a training": _training,
}
