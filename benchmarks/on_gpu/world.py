"""The world alone."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np
import torch
from cases import Case, Given, LeftOut, Row
from torch import Tensor

from iout_marl.scenario import load_scenario
from iout_marl.world import State, World, node_codes
from on_gpu.measuring import (
    SCENARIO,
    SLOTS,
    WARM,
    forget,
    memory,
    powers,
    rate,
    seconds,
    synchronise,
    while_it_fits,
)
from trainers.accel import graphs
from trainers.accel.graphs import CapturedFunction, Graph, write_over


def in_place(
    slot: Callable[[State, Any], tuple[State, Any, Any]], state: State, graph: Graph
) -> Callable[[State, Any], tuple[State, Any, Any]]:
    """The slot, captured, on a state that stays where it is, whatever state comes in."""

    def play(action: Tensor) -> tuple[Tensor, Tensor]:
        after, reward, observation = slot(state, action)
        write_over(state, after)
        return reward, observation

    captured = CapturedFunction(play, lambda _: graph, state.age.device)
    return lambda _, action: (state, *captured(action))


def reset_world(library: Any, envs: int, device: str | None) -> tuple[World, State, list[Any]]:
    """A world, its first state, and actions of some slots."""
    world = World(load_scenario(SCENARIO), envs, library=library, dtype="float32", device=device)
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)] * envs))
    rng, sizes = np.random.default_rng(0), world.action_sizes
    actions = [
        world.backend.integers((rng.random((envs, world.num_auvs, len(sizes))) * sizes).astype(int))
        for _ in range(8)
    ]
    return world, state, actions


def world_alone(library: Any, *, captured: bool = False, compiled: bool = False) -> Case:
    """Slots with reward and observation."""

    def measure_size(device: str, envs: int) -> Row:
        torch.compiler.reset()
        forget(device)
        world, state, actions = reset_world(library, envs, None if library is np else device)
        slot = torch.compile(world.slot, fullgraph=True, dynamic=False) if compiled else world.slot
        if captured:
            # A graph reads and writes the same memory each time, every field its own.
            state = state.map(torch.clone)
            slot = in_place(slot, state, graphs.GRAPHS[device](torch.device(device)))

        def play(slots: int) -> None:
            nonlocal state
            for t in range(slots):
                state, _, _ = slot(state, actions[t % len(actions)])

        started = time.perf_counter()
        play(WARM)
        synchronise(device)
        ready_s = time.perf_counter() - started
        found = rate(SLOTS * envs, seconds(partial(play, SLOTS), device))
        return {**found, "ready after s": ready_s, **memory(device)}

    def measure(given: Given) -> Iterator[Row]:
        device = "cpu" if library is np else given.device
        if captured and device == "cpu":
            raise LeftOut("a CPU has no graphs")
        sizes = powers(4, 65_536) if device == "cpu" else powers(256, 4_194_304)
        if compiled:  # which takes a while for each
            sizes = sizes[2::2]
        sizes = [16, 256] if given.quick else sizes
        return while_it_fits(sizes, "environments", partial(measure_size, device))

    return measure
