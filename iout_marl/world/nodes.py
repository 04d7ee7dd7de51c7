"""From AUVs' choices of nodes to nodes, and back, without a loop."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, lookup
from iout_marl.world.backend import Backend


class NodeAxis:
    """Gathers from and scatters to the axis of nodes.

    Args:
        num_envs: environments in the batch.
        num_auvs: M.
        num_nodes: K.
        backend: arrays to work with.
    """

    def __init__(self, num_envs: int, num_auvs: int, num_nodes: int, backend: Backend) -> None:
        self._xp = backend.xp
        self._zero = backend.floats(0.0)
        self._first = backend.integers(list(range(0, num_envs * num_nodes, num_nodes)))[:, None]
        self._nodes = backend.integers(list(range(num_nodes)))
        self._ones = backend.floats([1.0] * num_nodes)
        self._ones_of_auvs = backend.floats([[1.0] * num_auvs])
        self.num_nodes = num_nodes

    def chosen(self, values: Array, node: Array) -> Array:
        """Of (envs, nodes) values, those of the (envs, auvs) nodes: (envs, auvs)."""
        return lookup(self._xp, values, self._first + node)

    def one_hot(self, node: Array) -> Array:
        """(envs, auvs) nodes as (envs, auvs, nodes) bool."""
        return node[..., None] == self._nodes

    def total(self, one_hot: Array, values: Array) -> Array:
        """For each node, the sum of the (envs, auvs) values of the AUVs that chose it."""
        spread = self._xp.where(one_hot, values[..., None], self._zero)
        return spread[:, 0, :] if spread.shape[1] == 1 else self._xp.sum(spread, axis=1)

    def any(self, one_hot: Array, flags: Array) -> Array:
        """For each node, whether an AUV that chose it has its (envs, auvs) flag set."""
        spread = one_hot & flags[..., None]
        return spread[:, 0, :] if spread.shape[1] == 1 else self._xp.any(spread, axis=1)

    def sum(self, values: Array) -> Array:
        """Sum over nodes: (envs, nodes) to (envs,)."""
        # A product with a vector of ones is several times faster than a sum over a
        # short last axis.
        return values @ self._ones

    def mean(self, values: Array) -> Array:
        """Mean over nodes: (envs, nodes) to (envs,)."""
        return self.sum(values) / self.num_nodes

    def alike(self, values: Array) -> Array:
        """The same value for every AUV: (envs,) to (envs, auvs)."""
        return values[:, None] * self._ones_of_auvs
