"""Spaces of the environment, space by space and entry by entry, for `docs/environment.md`."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from markdown_tables import numeral, page_of, table

from iout_marl import World, iout_v0, load_scenario
from iout_marl.core.ranges import Ranges
from iout_marl.envs import sb3_vec_env
from iout_marl.envs.episodes import INFO_KEYS, EpisodeBatch
from iout_marl.report.markup import markdown_text
from iout_marl.scenario import Overrides
from iout_marl.scenario.reference import summary_of

#: Scenarios whose spaces are shown.
FDD, TDD, TEAM = "paper/k10-fdd", "paper/k10-tdd", "multi/m3-k10-fdd"
#: Each direction that an AUV can take, by its step.
_DIRECTIONS = {(0, 0, 0): "stay"} | {
    tuple(sign * (axis == i) for i in range(3)): f"{'+' if sign > 0 else '−'}{name}"
    for axis, name in enumerate("xyz")
    for sign in (1, -1)
}


def spaces_tables() -> str:
    """What each API has as its spaces."""
    blocks = []
    for scenario in (FDD, TDD, TEAM):
        rows = (
            (name, f"`{call}`", _space(observation), _space(action))
            for name, call, observation, action in _apis(scenario)
        )
        headings = ("API", "Made by", "Observation space", "Action space")
        blocks += [f"### `{scenario}`", table(headings, rows)]
    return page_of(blocks)


def _apis(scenario: str) -> Iterator[tuple[str, str, spaces.Space[Any], spaces.Space[Any]]]:
    parallel = iout_v0.parallel_env(scenario)
    agent = parallel.possible_agents[0]
    own = parallel.observation_space(agent), parallel.action_space(agent)
    yield "PettingZoo ParallelEnv, an agent", "iout_v0.parallel_env(scenario)", *own
    turns = iout_v0.env(scenario)
    own = turns.observation_space(agent), turns.action_space(agent)
    yield "PettingZoo AEC, an agent", "iout_v0.env(scenario)", *own
    joint = gymnasium.make("iout_marl:AUV-v0", scenario=scenario)
    call = 'gymnasium.make("iout_marl:AUV-v0", scenario=scenario)'
    yield "Gymnasium, all AUVs", call, joint.observation_space, joint.action_space
    many = gymnasium.make_vec(
        "iout_marl:AUV-v0", 8, vectorization_mode="vector_entry_point", scenario=scenario
    )
    call = 'gymnasium.make_vec("iout_marl:AUV-v0", num_envs=8, …)'
    yield "VectorEnv, all of 8 environments", call, many.observation_space, many.action_space
    slots = sb3_vec_env(scenario, num_envs=8)
    call = "sb3_vec_env(scenario, num_envs=8)"
    name = f"Stable-Baselines3 VecEnv, each of {slots.num_envs} slots"
    yield name, call, slots.observation_space, slots.action_space


def _space(space: spaces.Space[Any]) -> str:
    if isinstance(space, spaces.Box):
        return f"`Box{space.shape}`, {space.dtype}".replace(",)", ")")
    if not isinstance(space, spaces.MultiDiscrete):
        raise TypeError(space)
    if space.nvec.ndim == 1:
        return f"`MultiDiscrete({space.nvec.tolist()})`"
    return f"`MultiDiscrete` {space.nvec.shape}, each row `{space.nvec[0].tolist()}`"


def entries_tables() -> str:
    """Actions, observations, states and infos, entry by entry."""
    blocks = ["### Actions"]
    for scenario in (FDD, TDD):
        blocks += [f"In `{scenario}`:", table(("Entry", "What", "Values"), _action(scenario))]
    idle = "auvs.idle_choices=true"
    blocks += [f"In `{TDD}` with `--set {idle}`:"]
    blocks += [table(("Entry", "What", "Values"), _action(TDD, idle))]
    headings = ("Entries", "What", "Unit", "Range", "Divided by")
    blocks.append("### Observations")
    for scenario in (FDD, TEAM):
        blocks += [f"In `{scenario}`:", table(headings, _observation(scenario))]
    blocks += ["### State, for central critics", f"In `{TEAM}`:", table(headings, _state(TEAM))]
    blocks += ["### Infos", table(("Key", "Of", "What"), _infos(TEAM))]
    return page_of(blocks)


def node_table() -> str:
    """What stands in each column of a node table."""
    observer = World(load_scenario(TEAM, {"observation": "table"})).observer
    assert observer.layout is not None
    rows, ends = [], dict.fromkeys(("context", "auvs", "nodes"), 0)
    for entry in observer.entries:
        array = "nodes" if entry.rows == "moves" else entry.rows
        times = observer.layout.moves if entry.rows == "moves" else 1
        begin, ends[array] = ends[array], ends[array] + entry.columns * times
        text = markdown_text(" ".join((inspect.getdoc(type(entry)) or "").split()))
        each = f" Each for the directions 0 to {times - 1} in turn." if times > 1 else ""
        columns = f"{begin} to {ends[array] - 1}"
        rows.append((f"`{array}`", columns, f"`{entry.settings.kind}`: {text}{each}"))
    return page_of([table(("Array", "Columns", "What"), rows)])


def _action(scenario: str, overrides: Overrides = None) -> Iterator[tuple[str, str, str]]:
    loaded = load_scenario(scenario, overrides)
    steps = loaded.auvs.motion.part.steps
    names = ", ".join(f"{i}: {_DIRECTIONS[tuple(step)]}" for i, step in enumerate(steps))
    nodes = f"0 to {loaded.num_nodes - 1}, a node"
    if loaded.auvs.idle_choices:
        nodes += f"; {loaded.num_nodes}, nobody"
    what = ["node to charge", "node to hear"]
    if loaded.duplex.part.splits_slot:
        what = ["node to charge, and then to hear"]
    yield "0", "direction", names
    for i, each in enumerate(what, 1):
        yield f"{i}", each, nodes
    sizes = World(loaded).action_sizes
    if len(sizes) != len(what) + 1:
        raise ValueError(f"{scenario}: {sizes} are not the entries {what}")


def _observation(scenario: str) -> Iterator[tuple[str, ...]]:
    observer = World(load_scenario(scenario)).observer
    begin = 0
    for entry in observer.entries:
        text = markdown_text(summary_of(type(entry)))
        yield _row(begin, f"`{entry.settings.kind}`: {text}", entry.unit, entry.ranges())
        begin += entry.size


def _state(scenario: str) -> Iterator[tuple[str, ...]]:
    """Of what `Observer.observe_globally` joins; the ranges are those that it states."""
    loaded = load_scenario(scenario)
    ranges = World(loaded).observer.state_ranges
    m, k = loaded.num_auvs, loaded.num_nodes
    parts = [
        ("x, y and z of every AUV", "cells", 3 * m),
        ("age of every node", "slots", k),
        ("energy stored in every node", "J", k),
        ("packets that every node has delivered", "packets", k),
        ("x, y and z of every node", "cells", 3 * k),
        ("share of the episode that is over", "", 1),
    ]
    if sum(size for *_, size in parts) != ranges.low.size:
        raise ValueError(f"{scenario}: the state has {ranges.low.size} entries")
    begin = 0
    for text, unit, size in parts:
        some = slice(begin, begin + size)
        own = Ranges(ranges.low[some], ranges.high[some], ranges.scale[some])
        yield _row(begin, text, unit, own)
        begin += size


def _row(begin: int, what: str, unit: str, ranges: Ranges) -> tuple[str, ...]:
    end = begin + ranges.low.size - 1
    scales = " and ".join(map(numeral, np.unique(ranges.scale)))
    span = f"{numeral(ranges.low.min())} to {numeral(ranges.high.max())}"
    return f"{begin}" if begin == end else f"{begin} to {end}", what, unit or "–", span, scales


def _infos(scenario: str) -> Iterator[tuple[str, str, str]]:
    episodes = EpisodeBatch(scenario)
    episodes.reset([0])
    info = episodes.info()
    for key, text in INFO_KEYS.items():
        whose = "the network" if info[key].ndim == 1 else "the AUV"
        yield f"`{key}`", whose, markdown_text(text)
