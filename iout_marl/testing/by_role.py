"""What parts of one role promise beyond what all do."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from iout_marl.bounds.check_game import finite_game, is_covered
from iout_marl.bounds.energy import FINE
from iout_marl.bounds.finite_game import FiniteGame
from iout_marl.core.budget import LinkBudget
from iout_marl.core.grid import Grid
from iout_marl.core.limits import unheard
from iout_marl.parts import Absorption, Channel, Harvester, Placement, Uplink
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings
from iout_marl.testing.recorded import actions_for, chance_for, first_state
from iout_marl.world import World

#: Draws of layouts that are compared.
DRAWS = 20


def place_of_entry(world: World, is_it: Callable[[Settings], bool]) -> int:
    """Where among a world's entries of observations one is: the last of its kind."""
    entries = world.observer.entries
    return max(i for i, entry in enumerate(entries) if is_it(entry.settings))


def check_placement(part: Placement, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Different cells of the grid, drawn by the seed alone, and as often as it says."""
    grid = Grid.from_scenario(scenario)
    layouts = []
    for seed in [*seeds, *range(DRAWS)]:
        first, second = (part.checked_draw(grid, np.random.default_rng(seed)) for _ in range(2))
        assert np.array_equal(first, second), f"seed {seed} gives two layouts"
        assert len(np.unique(first, axis=0)) == len(first), f"seed {seed}: two nodes in one cell"
        layouts.append(first.tolist())
    differ = any(layout != layouts[0] for layout in layouts)
    if part.redraws == "never":
        assert not differ, "redraws is 'never', but layouts differ by the seed"
    elif part.num_nodes < grid.num_cells:
        assert differ, f"redraws is {part.redraws!r}, but {DRAWS} seeds give one layout"


def check_entry(_: Any, scenario: Scenario, __: Sequence[int]) -> None:
    """Ranges of as many numbers as it says."""
    for entry in World(scenario).observer.entries:
        entry.checked_ranges()


def check_absorption(part: Absorption, _: Scenario, __: Sequence[int]) -> None:
    """Finite and not negative, of one frequency or of several."""
    khz = np.geomspace(1.0, 500.0, 60)
    found = np.asarray(part.db_per_km(khz))
    assert found.shape == khz.shape, f"db_per_km has shape {found.shape}, not {khz.shape}"
    assert np.isfinite(found).all(), f"db_per_km is not finite at {khz[~np.isfinite(found)][0]} kHz"
    assert (found >= 0).all(), f"db_per_km is negative at {khz[found < 0][0]:.3g} kHz"
    one = np.asarray([float(part.db_per_km(float(each))) for each in khz])
    assert np.allclose(one, found, rtol=1e-12), "db_per_km of one frequency is not that of several"


@unheard
def check_channel(part: Channel, scenario: Scenario, _: Sequence[int]) -> None:
    """What is lost, and what an uplink takes, does not fall with the distance."""
    duplex = scenario.duplex.part
    farthest_m = float(Grid.from_scenario(scenario).metres(scenario.grid.cells))
    # Below a metre spreading is not what any of these equations are for.
    metres = np.linspace(1.0, farthest_m, 200)
    hertz = scenario.uplink.part.bandwidth_hz
    for name, values in {
        "attenuation_db": part.attenuation_db(metres, duplex.charging_frequency_khz),
        "power_per_snr_w": part.power_per_snr_w(metres, duplex.uplink_frequency_khz, hertz),
    }.items():
        assert np.isfinite(values).all(), f"{name} is not finite"
        falls = np.diff(values) < -1e-12 * np.abs(values[1:])
        assert not falls.any(), f"{name} falls beyond {metres[:-1][falls][:1]} m"
        if name == "power_per_snr_w":
            assert (values > 0).all(), f"{name} is not above 0"


@unheard
def check_harvester(part: Harvester, scenario: Scenario, _: Sequence[int]) -> None:
    """More sound never brings less; whatever there is of it, power is finite and from 0."""
    acoustic_w = scenario.charging.power_w * scenario.charging.efficiency
    found = np.asarray(part.harvested_power_w(np.linspace(0.0, 260.0, 500), acoustic_w))
    assert np.isfinite(found).all(), "harvested_power_w is not finite"
    assert (found >= 0).all(), "harvested_power_w is negative"
    assert (np.diff(found) >= 0).all(), "harvested_power_w falls where more sound arrives"


@unheard
def check_uplink(part: Uplink, scenario: Scenario, seeds: Sequence[int]) -> None:
    """An uplink costs something, no less over a longer way, and no more in more time."""
    budget, slot_s = LinkBudget(scenario), scenario.slot_s
    metres = np.linspace(1.0, float(Grid.from_scenario(scenario).metres(scenario.grid.cells)), 200)
    watts = budget.power_per_snr_w(metres)
    found = np.asarray(budget.required_energy_j(watts, slot_s, metres))
    assert (found > 0).all(), "required_energy_j is not above 0"
    assert (found[1:] >= found[:-1] * (1 - 1e-12)).all(), "a longer way costs less"
    hurried = np.asarray(budget.required_energy_j(watts, slot_s / 2, metres))
    assert (hurried >= found * (1 - 1e-12)).all(), "less time costs less"
    in_time = part.least_time_s(metres, 1) <= slot_s
    assert (in_time | np.isinf(found)).all(), "least_time_s is more than a slot, but it is paid for"
    check_reasons(part, scenario, seeds)


def check_tables(_: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Where it states what a slot does to levels of energy: no node is ever richer than that.

    Its two derivations, for the search of bounds and for their check, agree.
    """
    if not is_covered(scenario):
        return
    field = FiniteGame.from_scenario(scenario, FINE)
    game = finite_game(scenario, tuple(field.levels_j[:-1].tolist()))
    for number, table in enumerate(table for table in field.tables if table is not None):
        checked = [tables[number] for tables in game.tables]
        assert np.array_equal(checked, table), "search_tables and check_tables differ"
    world = World(scenario)
    codes = world.grid.encode(world.grid.all_coordinates()).tolist()
    for seed in seeds:
        state, levels = first_state(world, [seed]), np.zeros(world.num_nodes, dtype=np.int64)
        for slot, action in enumerate(actions_for(world, seed)):
            state, events = world.step(state, action, world.expected)
            _follow(field, levels, codes.index(int(state.cell[0, 0])), events)
            where = f"slot {slot} by seed {seed}: "
            assert (levels < field.num_levels).all(), f"{where}search_tables forbid what is done"
            room_j = 1e-9 * (1 + state.energy_j[0])
            richer = state.energy_j[0] > field.levels_j[levels] + room_j
            assert not richer.any(), f"{where}a node is richer than search_tables have it"


def check_reasons(_: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Why uplinks have failed: flags for reasons, of which every failed uplink has one."""
    world = World(scenario)
    for seed in seeds:
        state, chance = first_state(world, [seed]), chance_for(world, [seed])
        for slot, action in enumerate(actions_for(world, seed)):
            before = state
            state, events = world.step(before, action, next(chance))
            found = world.outcomes(before, events, state)
            arrived = np.array([[reason is None for reason in row] for row in found])
            where = f"slot {slot} by seed {seed}: "
            assert np.array_equal(arrived, events.delivered), f"{where}outcomes"
            polled = world.polled_outcomes(before, events, state)
            lost = np.reshape(
                [reason is not None for row in polled for auv in row for reason in auv],
                events.polled.shape,
            )
            expected = (events.polled < world.num_nodes) & ~events.polled_delivered
            assert np.array_equal(lost, expected), f"{where}polled_outcomes"


def check_duplex(part: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Its tables and its reasons."""
    check_tables(part, scenario, seeds)
    check_reasons(part, scenario, seeds)


def _follow(field: FiniteGame, levels: Any, cell: int, events: Any) -> None:
    """Move the levels of the nodes named as the tables say."""
    charge, deliver, both = field.tables
    charged, heard = int(events.charged[0, 0]), int(events.heard[0, 0])
    delivered = bool(events.delivered[0, 0])
    nobody = field.scenario.num_nodes
    if both is None:
        if heard == nobody:
            return
        levels[heard] = (deliver if delivered else charge)[heard, cell, levels[heard]]
    elif delivered and charged == heard:
        levels[heard] = both[heard, cell, levels[heard]]
    else:
        if charged != nobody:
            levels[charged] = charge[charged, cell, levels[charged]]
        if delivered:
            levels[heard] = deliver[heard, cell, levels[heard]]


@unheard
def check_storage(part: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Energy is conserved, node by node; a store without limits leaves it as it is; reasons."""
    world = World(scenario, len(seeds))
    state, chance = first_state(world, seeds), chance_for(world, seeds)
    start_j, env = state.energy_j, np.arange(len(seeds))[:, None]
    gained_j = np.zeros_like(start_j)
    for slot, action in enumerate(actions_for(world, seeds[0])):
        state, events = world.step(state, action, next(chance))
        # Whoever names nobody moves no energy.
        charged, heard = (
            np.minimum(named, world.num_nodes - 1) for named in (events.charged, events.heard)
        )
        np.add.at(gained_j, (env, charged), events.harvested_j)
        np.add.at(gained_j, (env, heard), -events.spent_j)
        for i in range(events.polled.shape[2]):
            polled = np.minimum(events.polled[..., i], world.num_nodes - 1)
            np.add.at(gained_j, (env, polled), -events.polled_j[..., i])
        lost_j = state.spilled_j + state.leaked_j + state.idle_j if part.is_limited else 0.0
        gap_j = np.abs(start_j + gained_j - lost_j - state.energy_j)
        assert (gap_j <= 1e-9 * (1 + np.abs(gained_j) + lost_j)).all(), (
            f"slot {slot} by seeds {seeds}: energy is not conserved, by {gap_j.max():.3g} J"
        )
    check_tables(part, scenario, seeds)
    check_reasons(part, scenario, seeds)


@unheard
def check_vehicle(part: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Energy is conserved, AUV by AUV, and never below 0; who is stranded does nothing; reasons."""
    world = World(scenario, len(seeds))
    state, chance = first_state(world, seeds), chance_for(world, seeds)
    for slot, action in enumerate(actions_for(world, seeds[0]) if part.is_limited else ()):
        before = state
        state, events = world.step(before, action, next(chance))
        where = f"slot {slot} by seeds {seeds}"
        spent_j = state.propulsion_j + state.hotel_j + state.charging_j
        come_j = world.vehicle.initial_j + state.docked_j
        gap_j = np.abs(come_j - spent_j - state.battery_j)
        assert (gap_j <= 1e-9 * come_j).all(), (
            f"{where}: energy is not conserved, by {gap_j.max()} J"
        )
        assert (state.battery_j >= 0).all(), f"{where}: a battery has less than nothing"
        idle = (state.cell == before.cell) & (events.harvested_j == 0) & ~events.delivered
        assert (idle | ~events.stranded).all(), f"{where}: an AUV that is stranded did something"
    check_tables(part, scenario, seeds)
    check_reasons(part, scenario, seeds)


def check_hearing(_: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """No node is heard twice in a slot; packets fit into it; energy is conserved; reasons."""
    world = World(scenario, len(seeds))
    state, chance = first_state(world, seeds), chance_for(world, seeds)
    most = world.hearing.uplinks_per_slot
    for slot, action in enumerate(actions_for(world, seeds[0])):
        before = state
        state, events = world.step(before, action, next(chance))
        where = f"slot {slot} by seeds {seeds}: "
        sent = events.polled < world.num_nodes
        own = events.delivered + events.polled_delivered.sum(axis=2)
        assert (own <= most).all(), f"{where}more than uplinks_per_slot arrive at an AUV"
        counts = state.deliveries - before.deliveries
        assert (counts <= 1).all(), f"{where}a node delivers twice"
        assert (counts.sum(axis=1) == own.sum(axis=1)).all(), f"{where}packets are lost count of"
        lasts_s = np.zeros(state.cell.shape)
        for i in range(events.polled.shape[2]):
            place = world.nodes.flat_index(events.polled[..., i])
            offset = world.link.offset(state.cell, world.nodes.gather(state.node_cell, place))
            lasts_s += np.where(sent[..., i], world.link.least_uplink_s[offset], 0.0)
        has_s = (1 - events.beta) * world.link.slot_s
        assert (lasts_s <= has_s * (1 + 1e-9)).all(), f"{where}packets take more than the slot"
    check_storage(scenario.storage.part, scenario, seeds)


def check_current(part: Any, scenario: Scenario, seeds: Sequence[int]) -> None:
    """Nobody is carried where none flows; AUVs move by what they do in still water, or drift."""
    world, still = World(scenario, len(seeds)), not part.flows
    assert (world.current is None) == still, "flows is not what the world makes of it"
    state, chance = first_state(world, seeds), chance_for(world, seeds)
    for slot, action in enumerate(actions_for(world, seeds[0]) if part.flows else ()):
        before = state
        state, _ = world.step(before, action, next(chance))
        reachable = world.manoeuvre.reachable(before)
        found = (reachable == state.cell[..., None]).any(axis=-1)
        assert found.all(), f"slot {slot} by seeds {seeds}: an AUV is where it could not come to"
    check_vehicle(scenario.vehicle.part, scenario, seeds)


CHECKS: Mapping[str, Callable[[Any, Scenario, Sequence[int]], None]] = {
    "absorption": check_absorption,
    "access": check_reasons,
    "beta rule": check_tables,
    "channel": check_channel,
    "current": check_current,
    "duplex": check_duplex,
    "harvester": check_harvester,
    "hearing": check_hearing,
    "observation entry": check_entry,
    "placement": check_placement,
    "storage": check_storage,
    "uplink": check_uplink,
    "vehicle": check_vehicle,
}
