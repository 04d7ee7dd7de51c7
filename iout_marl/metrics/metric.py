"""The description of a metric, and what becomes of a user's function."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array, cast
from iout_marl.scenario import Scenario
from iout_marl.whole import short

if TYPE_CHECKING:
    from iout_marl.world import State, World

#: What a metric is a function of: the state at the end of an episode, a slot (its values are
#: summed over the slots of an episode), or the rewards of an episode.
Source: TypeAlias = Literal["state", "slot", "rewards"]
Better: TypeAlias = Literal["less", "more"]


@dataclass(frozen=True, eq=False)
class Metric:
    """A metric, and how it is shown.

    Attributes:
        name: its key in Python and JSON.
        function: computes it, (envs,): of `(world, state)`, of `(world, state, events)` after
            each slot, or of `(world, total)`, the (envs, auvs) rewards of an episode: see
            `computed_from`.
        definition: a sentence.
        unit: empty for a pure number.
        symbol: as in the paper; empty where it has none.
        heading: of its row in a table.
        axis_title: of an axis or a column, with the unit.
        title: of a figure.
        tag: in TensorBoard and `metrics.jsonl`.
        curve_title: what the curve of a training shows, if not quite the metric; with the unit.
        digits: behind the point.
        better: whether less or more of it is better; None where neither is.
        low, high: what it cannot be below and above.
        is_positive: it is never 0, and reports divide by it.
        computed_from: what it is a function of.
        in_table: whether the command line's tables have a row for it.
        has_curve: whether studies keep the curve of a training.
        is_builtin: whether it is of this software.
        applies: whether worlds of a scenario have it.
    """

    name: str
    function: Callable[..., Array]
    definition: str
    unit: str
    heading: str
    axis_title: str
    title: str
    tag: str
    symbol: str = ""
    curve_title: str = ""
    digits: int = 2
    better: Better | None = None
    low: float = -math.inf
    high: float = math.inf
    is_positive: bool = False
    computed_from: Source = "state"
    in_table: bool = True
    has_curve: bool = False
    is_builtin: bool = True
    applies: Callable[[Scenario], bool] = lambda _: True

    def values(self, world: World, state: State, *events: Any) -> Array:
        """The (envs,) values of a state, or of a slot, in the state's floating type.

        Raises:
            InputError: a user's function returns something else.
        """
        found = self.function(world, state, *events)
        return found if self.is_builtin else self._as_expected(found, world, state)

    def _as_expected(self, found: Any, world: World, state: State) -> Array:
        xp, like = world.backend.xp, state.age
        # What is known beforehand may be of another type than what is not, see `symbols`.
        if not isinstance(found, type(like)) and not isinstance(
            found, type(world.backend.zeros((1,)))
        ):
            raise InputError(
                f"metric {self.name}: must return an array of {world.num_envs} numbers, one for "
                f"each environment, not {short(found)}"
            )
        if tuple(found.shape) != (world.num_envs,):
            raise InputError(
                f"metric {self.name}: must return an array of shape ({world.num_envs},), one "
                f"number for each environment, not {tuple(found.shape)}"
            )
        if found.dtype == like.dtype:
            return found
        if not xp.isdtype(found.dtype, ("bool", "integral", "real floating")):
            raise InputError(f"metric {self.name}: must return numbers, not {found.dtype}")
        return cast(xp, found, like.dtype)

    def check(self, values: Iterable[float]) -> None:
        """Refuse values of a user's metric that are not what it says of itself.

        Args:
            values: floats, one for each episode.

        Raises:
            InputError: one is not finite, or lies outside the metric's bounds.
        """
        for i, value in enumerate(values):
            if not math.isfinite(value):
                raise InputError(f"metric {self.name}: must be finite, not {value} (episode {i})")
            if not self.low <= value <= self.high:
                raise InputError(
                    f"metric {self.name}: must lie between {self.low:g} and {self.high:g}, as it "
                    f"was registered, not {value:g} (episode {i})"
                )
