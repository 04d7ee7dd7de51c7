"""Entries of an observation: of what an AUV sees, one after the other."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, Literal, get_args

import numpy as np

from iout_marl.core.ranges import Ranges
from iout_marl.core.state import State
from iout_marl.errors import did_you_mean
from iout_marl.parts.base import Context, Part
from iout_marl.physics.arrays import Array
from iout_marl.registry import Registry
from iout_marl.scenario import Scenario
from iout_marl.whole import short, whole_number

#: What an entry may have a row of numbers for.
Rows = Literal["context", "auvs", "nodes", "moves"]


class Entry(Part):
    """One or several numbers of an observation, the same for every AUV or one's own.

    Attributes:
        unit: of the numbers, where they are not scaled.
        low, high, scale: the range of the numbers, and what makes them of order one, where
            `ranges` does not say it of each.
        feeds_node_network: whether it has one number for each node, of which the network for
            every node alike (`training.node_network`) is made.
        rows: what it has a number, or several `columns` of them, for: each node (`nodes`), each
            other AUV (`auvs`), each pair of a direction and a node (`moves`), or none of them
            (`context`). Numbers of one column lie next to one another. A node table
            (`observation: table`) is made by it.
        columns: how many numbers it has for each row.
    """

    unit: ClassVar[str] = ""
    low: float = 0.0
    high: float = 1.0
    scale: float = 1.0
    feeds_node_network: ClassVar[bool] = False
    rows: ClassVar[Rows] = "context"
    columns: ClassVar[int] = 1

    @property
    def size(self) -> int:
        """How many numbers, once it is set up."""
        return self.columns * self._num_rows

    @property
    def _num_rows(self) -> int:
        scenario = self.world.scenario
        moves = len(scenario.auvs.motion.part.steps) * scenario.num_nodes
        auvs, nodes = scenario.num_auvs - 1, scenario.num_nodes
        return {"context": 1, "auvs": auvs, "nodes": nodes, "moves": moves}[self.rows]

    def ranges(self) -> Ranges:
        """The ranges of the numbers, (size,) each, once it is set up."""
        return Ranges.uniform(self.size, self.low, self.high, self.scale)

    def check_stated(self, scenario: Scenario) -> None:  # noqa: ARG002
        if not isinstance(self.unit, str):
            raise self.fault(f"unit must be a text, not {short(self.unit)}")
        if self.rows not in get_args(Rows):
            known = ", ".join(get_args(Rows))
            hint = did_you_mean(str(self.rows), get_args(Rows))
            raise self.fault(f"rows must be one of {known}, not {short(self.rows)}{hint}")
        try:
            whole_number(self.columns, 1)
        except ValueError as error:
            raise self.fault(f"columns {error}") from None

    def checked_ranges(self) -> Ranges:
        """What `ranges` gives, after a look at it.

        Raises:
            InputError: it does not go with `size`, or with itself.
        """
        is_of_others = self.rows == "auvs"  # of whom a lone AUV has none
        try:
            size = whole_number(self.size, 0 if is_of_others else 1)
        except ValueError as error:
            raise self.fault(f"size {error}") from None
        expected = self.columns * self._num_rows
        if self.rows != "context" and size != expected:
            raise self.fault(
                f"size must be columns times rows ({self.rows}), {expected}, not {size}"
            )
        if self.feeds_node_network and size != self.world.scenario.num_nodes:
            raise self.fault(f"feeds_node_network: size must be one for each node, not {size}")
        ranges = self.ranges()
        for name in ("low", "high", "scale"):
            shape = np.shape(getattr(ranges, name))
            if shape != (size,):
                raise self.fault(
                    f"ranges().{name} must have shape {(size,)}, as size says, not {shape}"
                )
            if not np.isfinite(getattr(ranges, name)).all():
                raise self.fault(f"ranges().{name} must be finite")
        if not (ranges.low <= ranges.high).all():
            raise self.fault("low must not exceed high")
        if not (ranges.scale > 0).all():
            raise self.fault("scale must be above 0")
        return ranges

    def setup(self, world: Context) -> None:
        super().setup(world)
        self._num_auvs = world.scenario.num_auvs

    def for_every_auv(self, values: Array) -> Array:
        """(envs, size) as (envs, auvs, size)."""
        if self._num_auvs == 1:
            return values[:, None, :]
        shape = (values.shape[0], self._num_auvs, values.shape[1])
        return self.xp.broadcast_to(values[:, None, :], shape)

    @abstractmethod
    def __call__(self, state: State) -> Array:
        """The numbers, (envs, auvs, size); (envs, 1, size) is for all AUVs alike."""


entries: Registry[type[Entry]] = Registry("observation entry", Entry)
