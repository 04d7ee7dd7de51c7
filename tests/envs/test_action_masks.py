"""Masks hide what is of no use, and nothing else; what they hide is harmless."""

import itertools

import numpy as np
import pytest
from env_cases import STARTS, scenario

from iout_marl import iout_v0, load_scenario
from iout_marl.envs import AUVEnv
from iout_marl.world import World, node_codes

#: Steps in cells of the six directions, in the paper's order.
STEPS = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
DIRECTIONS = len(STEPS)
GRID = (6, 5, 3)
FDD = load_scenario("paper/k3-fdd")


#: By channel: spacing of cells, power and packets with which some nodes pay and others do not.
REACH = {
    "table": {
        "grid.spacing_m": (100, 300),
        "charging.power_w": (500, 5000),
        "uplink.packet_bits": (20, 200),
    },
    "sonar": {
        "grid.spacing_m": (300, 1500),
        "charging.power_w": (5, 20),
        "uplink.packet_bits": (1000, 20000),
    },
}


def random_scenario(rng, kind, auvs):
    """A scenario in FDD with nodes within reach and nodes beyond it."""
    cells = np.stack(np.unravel_index(rng.permutation(np.prod(GRID)), GRID), axis=-1) + 1
    changes = {
        "grid.cells": GRID,
        "nodes.cells": cells[:4].tolist(),
        "nodes.count": None,
        "auvs.start_cells": rng.permutation(cells)[:auvs].tolist(),
        "channel": {"kind": kind},
    }
    changes |= {name: float(rng.uniform(*ends)) for name, ends in REACH[kind].items()}
    return load_scenario(FDD, changes)


def start(world, seed=0):
    return world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(seed)]))


def masks_of(world, state):
    """Masks of directions, nodes to charge, nodes to hear: (auvs, choices) each."""
    return np.split(world.action_mask(state)[0], np.cumsum(world.action_sizes)[:-1], axis=-1)


def can_deliver(world, state):
    """Whether an AUV can have a packet from a node by any action of the fleet: (auvs, nodes).

    Found out by trying: all moves of all AUVs, each of which charges the node.
    """
    moves = np.array(list(itertools.product(range(DIRECTIONS), repeat=world.num_auvs)))
    every = World(world.scenario, len(moves))
    before = state.map(lambda array: np.repeat(array, len(moves), axis=0))
    found = np.zeros((world.num_auvs, world.num_nodes), dtype=bool)
    for auv, node in np.ndindex(found.shape):
        action = np.empty((len(moves), world.num_auvs, 3), dtype=int)
        action[..., 0], action[..., 1] = moves, node
        # The others hear another node, lest they be nearer.
        action[..., 2] = (node + 1) % world.num_nodes
        action[:, auv, 2] = node
        found[auv, node] = every.step(before, action)[1].delivered[:, auv].any()
    return found


def random_walk(world, rng, slots):
    """States of an episode of random actions."""
    state = start(world)
    for _ in range(slots):
        yield state
        action = rng.integers(0, world.action_sizes, (1, world.num_auvs, 3))
        state, _ = world.step(state, action)


KINDS = pytest.mark.parametrize("kind", REACH)
FLEETS = pytest.mark.parametrize("auvs", [1, 2, 3])


@pytest.mark.slow
@KINDS
@FLEETS
def test_a_node_is_masked_where_it_can_deliver_in_no_way_and_only_there(kind, auvs):
    rng = np.random.default_rng(0)
    seen = set()
    for _ in range(12):
        world = World(random_scenario(rng, kind, auvs))
        for state in random_walk(world, rng, 4):
            may_pay, delivers = masks_of(world, state)[2], can_deliver(world, state)
            for allowed, possible in zip(may_pay, delivers, strict=True):
                # Where nothing delivers, everything may be chosen: a choice needs a way to go.
                assert allowed.tolist() == (possible | ~possible.any()).tolist()
                seen.add((possible.any(), possible.all()))
    assert seen >= {(True, False), (True, True)}


@pytest.mark.slow
@KINDS
@FLEETS
def test_every_entry_has_a_choice_and_every_node_may_be_charged(kind, auvs):
    rng = np.random.default_rng(2)
    for _ in range(20):
        world = World(random_scenario(rng, kind, auvs))
        for state in random_walk(world, rng, 5):
            masks = masks_of(world, state)
            assert all(mask.any(axis=-1).all() for mask in masks)
            assert masks[1].all()


@pytest.mark.parametrize("name", ["paper/k3-fdd", "paper/k10-fdd"])
def test_masks_hide_nodes_in_the_papers_scenarios(name):
    env = iout_v0.parallel_env(load_scenario(name, {"observation.action_mask": "info"}))
    _, infos = env.reset(seed=0)
    nodes_to_hear = infos["auv_0"]["action_mask"][-env.scenario.num_nodes :]
    assert 0 < nodes_to_hear.sum() < env.scenario.num_nodes


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_a_direction_is_masked_where_it_leaves_the_grid_and_only_there(duplex, auvs):
    # What keeps AUVs apart is no matter of the grid.
    freely = {"auvs.separation_cells": 0}
    masked = scenario(duplex, auvs, mask="info", slots=100)
    env = iout_v0.parallel_env(load_scenario(masked, freely))
    size = np.array(env.scenario.grid.cells)
    rng = np.random.default_rng(1)
    observations, infos = env.reset(seed=0)
    seen = set()
    while env.agents:
        actions = {a: rng.integers(0, env.action_space(a).nvec) for a in env.agents}
        # Along the edges, where masks matter.
        actions = {
            a: np.array([rng.choice([0, 2, action[0]]), *action[1:]])
            for a, action in actions.items()
        }
        before, masks = observations, {a: infos[a]["action_mask"] for a in env.agents}
        observations, *_, infos = env.step(actions)
        for agent, action in actions.items():
            target = before[agent][:3] + STEPS[action[0]]
            inside = bool(((target >= 1) & (target <= size)).all())
            assert masks[agent][action[0]] == inside
            np.testing.assert_array_equal(
                observations[agent][:3], target if inside else before[agent][:3]
            )
            seen.add(inside)
    assert seen == {True, False}


@pytest.mark.parametrize("auvs", STARTS)
def test_in_tdd_every_node_may_be_chosen(auvs):
    env = iout_v0.parallel_env(scenario("tdd", auvs, mask="info", slots=100))
    rng = np.random.default_rng(0)
    _, infos = env.reset(seed=0)
    while env.agents:
        assert all(info["action_mask"].shape == (6 + 3,) for info in infos.values())
        assert all(info["action_mask"][6:].all() for info in infos.values())
        *_, infos = env.step({a: rng.integers(0, [6, 3]) for a in env.agents})


def test_without_a_way_to_go_every_choice_is_open():
    lone_cell = {
        "grid.cells": [1, 1, 1],
        "nodes.cells": [[1, 1, 1]],
        "nodes.count": 1,
        "auvs.start_cells": [[1, 1, 1]],
        "charging.power_w": 1e-9,
        "observation.action_mask": "info",
    }
    env = iout_v0.parallel_env(load_scenario("paper/k3-fdd", lone_cell))
    _, infos = env.reset(seed=0)
    assert infos["auv_0"]["action_mask"].tolist() == [1] * (6 + 1 + 1)


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
@pytest.mark.parametrize("auvs", STARTS)
def test_masked_actions_are_harmless_and_cost_what_the_scenario_says(duplex, auvs):
    price = 7.5
    free, dear = (
        iout_v0.parallel_env(
            scenario(duplex, auvs, mask="info", slots=50, **{"reward.location_penalty": p})
        )
        for p in (0.0, price)
    )
    sizes = np.cumsum(free.action_space("auv_0").nvec)[:-1]
    rng = np.random.default_rng(0)
    (_, infos), _ = free.reset(seed=0), dear.reset(seed=0)
    left = 0
    while free.agents:
        actions = {}
        for agent in free.agents:
            # A masked choice wherever there is one; +x else, which ends at an edge.
            parts = np.split(infos[agent]["action_mask"], sizes)
            worst = [np.flatnonzero(part == 0) for part in parts]
            actions[agent] = np.array([rng.choice(w) if len(w) else 0 for w in worst])
        directions_masked = {a: not infos[a]["action_mask"][actions[a][0]] for a in free.agents}
        observations, rewards, _, _, infos = free.step(actions)
        dear_observations, dear_rewards, *_ = dear.step(actions)
        for agent, masked in directions_masked.items():
            np.testing.assert_array_equal(observations[agent], dear_observations[agent])
            paid = rewards[agent] - dear_rewards[agent]
            assert paid == pytest.approx(price if masked else 0)
            left += masked
    assert left > 0


@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_mask_in_the_observation_is_that_in_the_info(duplex):
    in_info, in_observation = (
        iout_v0.parallel_env(scenario(duplex, 3, "episode", mask))
        for mask in ("info", "observation")
    )
    rng = np.random.default_rng(0)
    (vectors, infos), (observations, bare) = in_info.reset(seed=3), in_observation.reset(seed=3)
    while True:
        for agent, observation in observations.items():
            assert set(observation) == {"action_mask", "observation"}
            assert "action_mask" not in bare[agent]
            assert observation["action_mask"].dtype == np.int8
            np.testing.assert_array_equal(observation["action_mask"], infos[agent]["action_mask"])
            np.testing.assert_array_equal(observation["observation"], vectors[agent])
        if not in_info.agents:
            break
        actions = {a: rng.integers(0, in_info.action_space(a).nvec) for a in in_info.agents}
        vectors, *_, infos = in_info.step(actions)
        observations, *_, bare = in_observation.step(actions)


def test_no_mask_is_handed_out_unless_it_is_asked_for():
    observations, infos = iout_v0.parallel_env(scenario(mask="none")).reset(seed=0)
    assert isinstance(observations["auv_0"], np.ndarray)
    assert "action_mask" not in infos["auv_0"]


@pytest.mark.parametrize("make", [iout_v0.parallel_env, AUVEnv])
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_spaces_sample_by_the_mask_that_is_handed_out(make, duplex):
    env = make(scenario(duplex, mask="info"))
    _, infos = env.reset(seed=0)
    space = env.action_space if make is AUVEnv else env.action_space("auv_0")
    mask = (infos if make is AUVEnv else infos["auv_0"])["action_mask"]
    space.seed(0)
    first_choices = np.concatenate([[0], np.cumsum(space.nvec)[:-1]])
    for _ in range(50):
        action = space.sample(mask)
        assert space.contains(action)
        assert mask[first_choices + action].all()
    parts = tuple(np.split(mask, first_choices[1:]))
    assert space.contains(space.sample(parts))
    with pytest.raises(ValueError, match="expected one value for each of"):
        space.sample(mask[1:])


class TestTellNoMoreThanTheObservation:
    """Worlds that an AUV cannot tell apart have one mask."""

    def test_of_nodes_out_of_sight_nothing(self):
        near = {"observation.view_range_m": 150, "auvs.start_cells": [[2, 2, 1]]}
        world = World(load_scenario("paper/k5-fdd", near))
        *_, heard = masks_of(world, start(world))
        everything = World(
            load_scenario("paper/k5-fdd", {**near, "observation.view_range_m": None})
        )
        *_, known = masks_of(everything, start(everything))
        in_sight = world.view.sees(start(world).cell, start(world).node_cell)[0]
        assert in_sight.tolist() == [[True, False, False, False, False]]
        assert heard[~in_sight].all()
        assert (heard[in_sight] == known[in_sight]).all()
        assert not known.all()

    @pytest.mark.parametrize("sees_others", [True, False])
    def test_of_auvs_unseen_nothing(self, sees_others):
        masks = []
        for other in ([10, 10, 4], [8, 6, 2]):
            changes = {
                "auvs.start_cells": [[1, 2, 1], other],
                "observation.other_auvs": sees_others,
            }
            world = World(load_scenario("paper/k5-fdd", changes))
            masks.append(masks_of(world, start(world))[-1][0])
        assert (masks[0] == masks[1]).all() == (not sees_others)
