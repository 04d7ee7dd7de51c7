"""From AUVs' choices of nodes to nodes, and back, without a loop."""

from __future__ import annotations

import numpy as np

from iout_marl.arrays.backend import Backend
from iout_marl.physics.arrays import (
    Array,
    add_at,
    adds_at_indices,
    highest,
    lookup,
    lookup_inside,
    reverse_axes,
)


class NodeAxis:
    """Gathers from, scatters to and sums over the axis of nodes.

    The place of a choice is the index of its node's entry where the nodes lie one after
    the other in memory, each with its values of all environments: as `Backend` lays them.

    Args:
        num_envs: environments in the batch.
        num_auvs: M.
        num_nodes: K.
        backend: arrays to work with.
        names_nobody: whether nodes named may be K, which is nobody.

    Attributes:
        num_nodes: K, as a floating array.
    """

    def __init__(
        self,
        num_envs: int,
        num_auvs: int,
        num_nodes: int,
        backend: Backend,
        *,
        names_nobody: bool = False,
    ) -> None:
        self._xp = backend.xp
        self._is_alone = num_auvs == 1
        self._zero = backend.floats(0.0)
        self._zeros = reverse_axes(backend.xp, backend.zeros((num_envs, num_nodes)))
        self._num_envs = backend.integers(num_envs)
        self._env = backend.integers(np.arange(num_envs))[:, None]
        self._places = self._env[:, :, None] + backend.integers(np.arange(num_nodes)) * num_envs
        self._ones = backend.floats([1.0] * num_nodes)
        self._ones_of_auvs = backend.floats([[1.0] * num_auvs])
        self.num_nodes = backend.floats(float(num_nodes))
        self._last_node = backend.integers(num_nodes - 1) if names_nobody else None

    def flat_index(self, node: Array) -> Array:
        """Places of the (envs, auvs) nodes, or (envs, auvs, rounds) ones, in their shape.

        Nobody has the place of the last node: whoever reads or adds there sees to it that it
        counts for nothing.
        """
        if self._last_node is not None:
            node = self._xp.minimum(node, self._last_node)
        return node * self._num_envs + (self._env if node.ndim == 2 else self._env[:, :, None])

    def gather(self, values: Array, place: Array) -> Array:
        """The (envs, nodes) values at places, in their shape."""
        look = lookup if place.ndim == 2 else lookup_inside
        return look(self._xp, reverse_axes(self._xp, values), place)

    def flags(self, place: Array, flag: Array) -> Array:
        """The (envs, auvs) flag of each AUV at its place, else false: (envs, auvs, nodes)."""
        return (place[..., None] == self._places) & flag[..., None]

    def scatter_add(self, values: Array, place: Array, amount: Array) -> Array:
        """(envs, nodes) values, each with the (envs, auvs) amounts of the AUVs that chose it."""
        xp = self._xp
        if self._is_alone and adds_at_indices(xp):
            return reverse_axes(xp, add_at(xp, reverse_axes(xp, values), place, amount))
        # Amounts of several AUVs are added up before their node's value comes in.
        return values + self.total(place, amount)

    def total(self, place: Array, amount: Array) -> Array:
        """For each node, the sum of the amounts of those who named it: (envs, nodes).

        Args:
            place: (envs, auvs) or (envs, auvs, rounds) places.
            amount: in their shape.
        """
        xp = self._xp
        if xp is np:
            return add_at(xp, self._zeros, place.T, amount.T).T
        # An accelerator would add up several amounts for one node in any order.
        place, amount = (xp.reshape(each, (each.shape[0], -1)) for each in (place, amount))
        spread = xp.where(place[..., None] == self._places, amount[..., None], self._zero)
        return xp.sum(spread, axis=1)

    def sum(self, values: Array) -> Array:
        """Sum over nodes: (envs, nodes) to (envs,)."""
        # A product with a vector of ones takes about half the time of a sum.
        return values.dot(self._ones) if self._xp is np else values @ self._ones

    def max(self, values: Array) -> Array:
        """The highest over nodes: (envs, nodes) to (envs,)."""
        return highest(self._xp, values, -1)

    def broadcast_to_auvs(self, values: Array) -> Array:
        """The same value for every AUV: (envs,) to (envs, auvs)."""
        return values[:, None] * self._ones_of_auvs
