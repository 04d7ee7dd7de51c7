"""The paper's baselines: random walk, round robin, greedy."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.policies.policy import Actions
from iout_marl.policies.predicting import BasePolicy
from iout_marl.world import State, World


class RandomWalk(BasePolicy):
    """A uniform sample of the action space in every slot."""

    name = "random-walk"
    is_deterministic = False

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        shape = state.cell.shape
        return np.stack([rng.integers(0, size, shape) for size in world.action_sizes], axis=-1)


class RoundRobin(BasePolicy):
    """A random direction; nodes in turn, one a slot, whether or not the uplink works.

    The same node is charged and heard. With several AUVs each starts its round at a
    node of its own.
    """

    name = "round-robin"
    is_deterministic = False

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        direction = rng.integers(0, world.action_sizes[0], state.cell.shape)
        first = np.arange(world.num_auvs) * world.num_nodes // world.num_auvs
        node = (state.slot[:, None] + first) % world.num_nodes
        return _same_node(world, direction, node)


class Greedy(BasePolicy):
    """One cell towards the nodes' centre of gravity, never at rest; the nearest node.

    Within one cell of the centre of gravity, a uniformly random node instead. The same
    node is charged and heard.
    """

    name = "greedy"
    is_deterministic = False

    def act(self, world: World, state: State, rng: np.random.Generator) -> Actions:
        position = _coordinates(world, state.cell)  # (envs, auvs, 3)
        nodes = _coordinates(world, state.node_cell)  # (envs, nodes, 3)
        centre = nodes.mean(axis=1)[:, None, :]
        # Of all directions, the one whose step ends nearest to the centre of gravity.
        targets = _coordinates(world, world.motion.neighbours(state.cell))
        moved = (targets != position[:, :, None, :]).any(-1)
        distance_after = world.grid.lengths(targets - centre[:, :, None, :])
        direction = np.where(moved, distance_after, np.inf).argmin(-1)

        at_centre = np.linalg.norm(position - centre, axis=-1) <= 1
        to_nodes = world.grid.lengths(position[:, :, None, :] - nodes[:, None, :, :])
        chance = rng.integers(0, world.num_nodes, at_centre.shape)
        return _same_node(world, direction, np.where(at_centre, chance, to_nodes.argmin(-1)))


def _coordinates(world: World, cell: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    return world.grid.coordinate_table()[cell].astype(np.float64)


def _same_node(
    world: World, direction: npt.NDArray[np.int64], node: npt.NDArray[np.int64]
) -> Actions:
    return np.stack([direction, *[node] * (len(world.action_sizes) - 1)], axis=-1)
