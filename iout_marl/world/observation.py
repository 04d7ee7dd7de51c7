"""What an AUV sees, and what a critic of all of them may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.core.limits import FARTHEST_M, UPLINK_W, bounded, unheard
from iout_marl.core.link import Link
from iout_marl.core.state import State
from iout_marl.physics.arrays import Array, lookup, turned
from iout_marl.scenario import Scenario


@dataclass(frozen=True)
class Ranges:
    """Bounds of the entries of an observation, and what makes them of order one.

    `scale` is what a network's input may be divided by, and `limit` where the quotient
    may stop, since energies have no natural bound: past a few uplinks' worth, more
    makes no difference.
    """

    low: npt.NDArray[np.float64]
    high: npt.NDArray[np.float64]
    scale: npt.NDArray[np.float64]
    limit: float = 4.0

    def of(self, entries: slice) -> Ranges:
        """Those of some of the entries."""
        return Ranges(self.low[entries], self.high[entries], self.scale[entries], self.limit)


class Observer:
    """Builds observations: an AUV's position, the ages and the stored energies of the nodes.

    Appended where the scenario says so, in this order: the nodes' positions; the share of
    the episode that is over; where the other AUVs are, from the nearest to the farthest, so
    that what an AUV sees does not depend on how they are numbered; how many slots ago it saw
    each node, where its view is limited; which AUV it is. Positions are counted from 1 as in
    the paper.

    Args:
        scenario: the scenario.
        grid: its grid.
        link: its links, which bound the energy and price it.
        backend: arrays to work with.
    """

    def __init__(self, scenario: Scenario, grid: Grid, link: Link, backend: Backend) -> None:
        self._settings = scenario.observation
        self._xp = backend.xp
        self._num_auvs = scenario.num_auvs
        self._sees_others = scenario.observation.other_auvs and scenario.num_auvs > 1
        self._is_limited = scenario.observation.view_range_m is not None
        self._nearness = backend.integers(_nearness(grid))
        self._link = link
        self._identity = backend.floats(np.eye(scenario.num_auvs))
        self._is_credited_apart: bool = scenario.reward.part.is_credited_apart
        self._num_nodes = num_nodes = scenario.num_nodes
        self._num_slots = scenario.num_slots
        #: x, y and z by code, one after the other; where each begins, to go with the cells
        #: of AUVs and nodes, or of pairs of AUVs.
        self._coordinates = backend.floats(grid.coordinate_table().T.reshape(-1) + 1)
        axes = backend.integers(np.arange(3) * grid.num_codes)
        self._axes = {2: axes[:, None, None], 3: axes[:, None, None, None]}
        self._dtype = backend.dtype
        self.price_j = _price_j(scenario, link)
        self._last_cell = backend.floats([float(max(n - 1, 1)) for n in grid.shape])
        self._maximum_age = float(scenario.age.maximum)
        # All AUVs at the node, charging it alone through the whole episode.
        best_slot_j = float(link.budget.harvested_power_w(0.0)) * scenario.slot_s
        energy_bound_j = best_slot_j * scenario.num_slots * scenario.num_auvs
        #: Entries of an observation that tell of each node: ages, energies.
        self.node_entries = (slice(3, 3 + num_nodes), slice(3 + num_nodes, 3 + 2 * num_nodes))
        self.agent_ranges = self._agent_ranges(scenario, grid, energy_bound_j)
        self.state_ranges = self._state_ranges(scenario, grid, energy_bound_j)

    def observe(self, state: State) -> Array:
        """Observations of every AUV: (envs, auvs, entries)."""
        scaled = self._settings.kind == "scaled"
        own = self._positions(state.cell, scaled=scaled)
        if self._is_limited:
            age, energy = state.seen_age, state.seen_energy_j
        else:
            age, energy = self._for_every_auv(state.age), self._for_every_auv(state.energy_j)
        parts = [own, self._ages(age), self._energies(energy)]
        if self._settings.node_positions:
            nodes = self._positions(state.node_cell, scaled=scaled)
            parts.append(self._for_every_auv(self._xp.reshape(nodes, (nodes.shape[0], -1))))
        if self._settings.time:
            parts.append(self._for_every_auv(self._time(state)))
        if self._sees_others:
            parts.append(self._others(state.cell, scaled=scaled))
        if self._is_limited:
            now = self._xp.astype(state.slot, self._dtype)[:, None, None]
            ago = now - state.seen_slot
            parts.append(ago / self._num_slots if scaled else ago)
        if self._settings.agent_index:
            shape = (state.cell.shape[0], self._num_auvs, self._num_auvs)
            parts.append(self._xp.broadcast_to(self._identity, shape))
        # Each entry of all environments in a row, as they come.
        joined = self._xp.concat([turned(self._xp, part) for part in parts], axis=0)
        return turned(self._xp, joined)

    def observe_globally(self, state: State) -> Array:
        """What a central critic sees, scaled as observations are: (envs, entries).

        Positions of all AUVs, ages, energies and deliveries of all nodes, positions of
        the nodes, share of the episode that is over. Scaled deliveries are per slot.
        """
        scaled = self._settings.kind == "scaled"
        num_envs = state.cell.shape[0]
        flat = [
            self._xp.reshape(self._positions(cell, scaled=scaled), (num_envs, -1))
            for cell in (state.cell, state.node_cell)
        ]
        parts = [
            flat[0],
            self._ages(state.age),
            self._energies(state.energy_j),
            self._counts(state.deliveries),
            flat[1],
            self._time(state),
        ]
        return self._xp.concat(parts, axis=-1)

    def observe_for_critic(self, state: State, *, central: bool) -> Array | None:
        """What an AUV's critic sees beside its observation: (envs, auvs, entries).

        The state of the network, where it is central; with difference rewards also the ages
        and deliveries by packets to others alone, of which the reward is made. None for nothing.
        """
        parts = []
        if central:
            parts.append(self._for_every_auv(self.observe_globally(state)))
        if self._is_credited_apart:
            parts += [self._ages(state.others_age), self._counts(state.others_deliveries)]
        return self._xp.concat(parts, axis=-1) if parts else None

    def critic_ranges(self, *, central: bool) -> Ranges | None:
        """Ranges of `observe_for_critic`."""
        parts = [self.state_ranges] if central else []
        if self._is_credited_apart:
            k = self._num_nodes
            first, end = 3 * self._num_auvs, 3 * self._num_auvs + k
            ages, counts = slice(first, end), slice(end + k, end + 2 * k)
            parts += [self.state_ranges.of(ages), self.state_ranges.of(counts)]
        if not parts:
            return None
        return _joined([(part.low, part.high, part.scale) for part in parts])

    def _ages(self, age: Array) -> Array:
        return age / self._maximum_age if self._settings.kind == "scaled" else age

    def _energies(self, energy_j: Array) -> Array:
        scaled = self._settings.kind == "scaled"
        return energy_j / (energy_j + self.price_j) if scaled else energy_j

    def _counts(self, deliveries: Array) -> Array:
        return deliveries / self._num_slots if self._settings.kind == "scaled" else deliveries

    def _positions(self, cell: Array, *, scaled: bool) -> Array:
        xp = self._xp
        places = self._axes[cell.ndim] + turned(xp, cell)
        xyz = turned(xp, lookup(xp, self._coordinates, places))
        return (xyz - 1) / self._last_cell if scaled else xyz

    def _others(self, cell: Array, *, scaled: bool) -> Array:
        """Steps in cells to each other AUV, the nearest first: (envs, auvs, 3 (auvs − 1))."""
        xp, (num_envs, num_auvs) = self._xp, cell.shape
        order = xp.argsort(
            self._link.at(self._nearness, self._link.offset(cell[:, None, :], cell[:, :, None])),
            axis=-1,
        )[..., 1:]
        # Of AUVs in one cell any may come first: they look alike.
        first = xp.arange(0, num_envs * num_auvs, num_auvs, device=cell.device)
        others = lookup(xp, cell, first[:, None, None] + order)
        steps = (
            self._positions(others, scaled=False)
            - self._positions(cell, scaled=False)[:, :, None, :]
        )
        steps = steps / self._last_cell if scaled else steps
        return xp.reshape(steps, (num_envs, num_auvs, -1))

    def _time(self, state: State) -> Array:
        return self._xp.astype(state.slot, self._dtype)[:, None] / self._num_slots

    def _for_every_auv(self, values: Array) -> Array:
        """(envs, entries) as (envs, auvs, entries)."""
        if self._num_auvs == 1:
            return values[:, None, :]
        shape = (values.shape[0], self._num_auvs, values.shape[1])
        return self._xp.broadcast_to(values[:, None, :], shape)

    def _agent_ranges(self, scenario: Scenario, grid: Grid, energy_bound_j: float) -> Ranges:
        k, scaled = scenario.num_nodes, scenario.observation.kind == "scaled"
        ones = np.ones(k)
        size = np.array(grid.shape, dtype=np.float64)
        cell = (np.zeros(3), np.ones(3), np.ones(3)) if scaled else (np.ones(3), size, size)
        unit = (0 * ones, ones, ones)
        amax = self._maximum_age
        parts = [
            cell,
            unit if scaled else (ones, amax * ones, amax * ones),
            unit if scaled else (0 * ones, energy_bound_j * ones, self.price_j * ones),
        ]
        if scenario.observation.node_positions:
            parts += [cell] * k
        if scenario.observation.time:
            parts.append((np.zeros(1), np.ones(1), np.ones(1)))
        if self._sees_others:
            far = np.ones(3) if scaled else np.maximum(size - 1, 1)
            parts += [(-far, far, far)] * (scenario.num_auvs - 1)
        if self._is_limited:
            slots = ones if scaled else ones * scenario.num_slots
            parts.append((0 * ones, slots, slots))
        if scenario.observation.agent_index:
            index = np.ones(scenario.num_auvs)
            parts.append((0 * index, index, index))
        return _joined(parts)

    def _state_ranges(self, scenario: Scenario, grid: Grid, energy_bound_j: float) -> Ranges:
        k, m, slots = scenario.num_nodes, scenario.num_auvs, float(scenario.num_slots)
        ones = np.ones(k)
        size = np.array(grid.shape, dtype=np.float64)
        cell = (np.ones(3), size, size)
        if scenario.observation.kind == "scaled":
            scale = np.ones(3 * m + 6 * k + 1)
            scale[3 * m + 2 * k : 3 * m + 3 * k] = 1 / k  # deliveries, of which K nodes share
            return Ranges(np.zeros(len(scale)), np.ones(len(scale)), scale)
        return _joined(
            [
                *[cell] * m,
                (ones, self._maximum_age * ones, self._maximum_age * ones),
                (0 * ones, energy_bound_j * ones, self.price_j * ones),
                (0 * ones, slots * ones, slots / k * ones),
                *[cell] * k,
                (np.zeros(1), np.ones(1), np.ones(1)),
            ]
        )


def _joined(parts: Sequence[tuple[npt.NDArray[np.float64], ...]]) -> Ranges:
    low, high, scale = (np.concatenate([part[i] for part in parts]) for i in range(3))
    return Ranges(low, high, scale)


def _nearness(grid: Grid) -> npt.NDArray[np.int64]:
    """By code difference + origin: its rank among all, the shortest first, 0 for none."""
    order = np.argsort(grid.offset_distances(), kind="stable")
    # Differences that no two cells have are 0 long as well; the origin comes before them.
    order = np.concatenate([[grid.offset_origin], order[order != grid.offset_origin]])
    rank = np.empty_like(order)
    rank[order] = np.arange(len(order))
    return rank


def _price_j(scenario: Scenario, link: Link) -> float:
    """Energy of an uplink over half the grid's diagonal: the yardstick for stored energy."""
    half_diagonal = 0.5 * scenario.grid.spacing_m * np.linalg.norm(scenario.grid.cells)
    power_per_snr_w = link.budget.power_per_snr_w(min(float(half_diagonal), FARTHEST_M))
    price_j = unheard(link.budget.required_energy_j)(power_per_snr_w, link.slot_s)
    # Divisors must be no less than numbers are, nor more.
    return float(bounded(price_j, *UPLINK_W))
