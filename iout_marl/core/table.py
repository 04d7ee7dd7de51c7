"""How the rows of a node table lie in an observation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt


@dataclass(frozen=True)
class TableLayout:
    """Which entries of an observation belong to which row.

    The flat observation has the context first, then of each column of the other AUVs' rows its
    numbers for all of them, then of each column of the nodes' rows likewise, and last of each
    column of moves its numbers for all nodes by the first direction, by the second, and so on.

    Attributes:
        context: entries that belong to no row.
        auvs, auv_columns: other AUVs, and numbers for each.
        nodes, node_columns: nodes, and numbers for each.
        moves, move_columns: directions, and numbers for each pair of a direction and a node.
    """

    context: int
    auvs: int
    auv_columns: int
    nodes: int
    node_columns: int
    moves: int
    move_columns: int

    @property
    def ends(self) -> tuple[int, int, int, int]:
        """Where the context, the AUVs', the nodes' and the moves' entries end."""
        context = self.context
        auvs = context + self.auvs * self.auv_columns
        nodes = auvs + self.nodes * self.node_columns
        return context, auvs, nodes, nodes + self.moves * self.nodes * self.move_columns

    @property
    def size(self) -> int:
        """Entries of an observation."""
        return self.ends[-1]

    @property
    def node_entries(self) -> int:
        """Columns of a node's row: its own, then for each column of moves one a direction."""
        return self.node_columns + self.move_columns * self.moves

    def rows(self, flat: npt.NDArray[Any]) -> dict[str, npt.NDArray[Any]]:
        """Vectors by rows.

        Args:
            flat: (…, entries) vectors.

        Returns:
            `context` (…, context), `nodes` (…, nodes, node_entries) and, where there are other
            AUVs, `auvs` (…, auvs, auv_columns).
        """
        context, auvs, _, _ = self.ends
        lead = flat.shape[:-1]
        by_node = flat[..., auvs:].reshape(*lead, self.node_entries, self.nodes)
        rows = {"context": flat[..., :context], "nodes": np.swapaxes(by_node, -1, -2)}
        if self.auvs:
            by_auv = flat[..., context:auvs].reshape(*lead, self.auv_columns, self.auvs)
            rows["auvs"] = np.swapaxes(by_auv, -1, -2)
        return rows


def flattened(rows: Mapping[str, npt.NDArray[Any]], num_auvs: int = 1) -> npt.NDArray[Any]:
    """Rows as vectors: what `TableLayout.rows` gives, back again.

    Args:
        rows: `context` (…, context), `nodes` (…, nodes, columns), `auvs` alike or missing.
        num_auvs: how many observations are joined end to end, in rows and in vectors.

    Returns:
        (…, entries).

    Raises:
        ValueError: shapes do not go together.
    """
    lead = rows["context"].shape[:-1]
    parts = [rows["context"].reshape(*lead, num_auvs, -1)]
    for table in (rows[name] for name in ("auvs", "nodes") if name in rows):
        by_auv = table.reshape(*lead, num_auvs, -1, table.shape[-1])
        parts.append(np.swapaxes(by_auv, -1, -2).reshape(*lead, num_auvs, -1))
    return np.concatenate(parts, axis=-1).reshape(*lead, -1)
