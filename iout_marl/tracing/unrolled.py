"""One slot of a single environment as straight-line Python.

NumPy takes about half a microsecond to look at an array, however small, and a slot of a single
environment is a hundred looks at arrays of a few numbers. So the world is run once on symbols in
their place, and what it does to each number becomes a line of a Python function: the same
world, rule by rule and digit by digit, without the arrays. `benchmarks/environment.py` measures
what it gains.
"""

from __future__ import annotations

import functools
import itertools
import math
import traceback
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.core.chance import Chance, shape_of
from iout_marl.core.grid import Grid
from iout_marl.core.limits import unheard
from iout_marl.core.state import Events, State
from iout_marl.metrics import Metric
from iout_marl.physics.arrays import Array
from iout_marl.registry import on_change
from iout_marl.scenario import Scenario
from iout_marl.tracing.library import UnknownOperationError
from iout_marl.tracing.program import Program
from iout_marl.tracing.symbols import LIBRARY, SymbolArray, objects
from iout_marl.world.world import World

#: Plain numbers, in the order in which they lie in one array or in several, one after the other.
Numbers: TypeAlias = tuple[Any, ...]
#: Shape and type of an array.
Form: TypeAlias = tuple[tuple[int, ...], np.dtype[Any]]
#: Up to which numbers of pairs of an AUV and a node, of AUVs and of cells it pays. The function
#: grows with pairs, whatever the scenario has an AUV see, and with pairs of AUVs; tables with
#: cells. From eight AUVs on, NumPy's sums over them would also differ in the last digit.
MOST_PAIRS, MOST_AUVS, MOST_CELLS = 40, 4, 20_000


def pays_unrolled(scenario: Scenario) -> bool:
    """Whether an `UnrolledSlot` of a scenario takes less time than the world on NumPy."""
    if scenario.observation.part.is_table:
        return False  # more numbers than arrays take
    pairs = scenario.num_auvs * scenario.num_nodes
    cells = Grid.from_scenario(scenario).num_cells
    return pairs <= MOST_PAIRS and scenario.num_auvs <= MOST_AUVS and cells <= MOST_CELLS


# It never changes, and all environments of a process can share it.
@functools.lru_cache(maxsize=16)
def unrolled_slot(
    scenario: Scenario, *, with_mask: bool = False, summed: tuple[Metric, ...] = ()
) -> UnrolledSlot | None:
    """The `UnrolledSlot` of a scenario, made once.

    None, and a warning that names the operation, where a part or a metric from outside does
    something that cannot be written down for symbols.
    """
    try:
        return UnrolledSlot(scenario, with_mask=with_mask, summed=summed)
    except Exception as error:  # whatever somebody's code says to symbols: arrays will do
        warnings.warn(
            f"{scenario.name}: a single environment plays on arrays, which takes about four times "
            f"as long: {_reason(error)}",
            RuntimeWarning,
            stacklevel=2,
        )
        return None


# Of a name another part may be registered.
on_change.append(lambda _: unrolled_slot.cache_clear())


def _reason(error: Exception) -> str:
    """What cannot be written down, and where."""
    frames = traceback.extract_tb(error.__traceback__)
    folder = str(Path(__file__).parent)
    outside = [frame for frame in frames if not frame.filename.startswith((folder, "<"))]
    where = f"{outside[-1].filename}:{outside[-1].lineno}: " if outside else ""
    if isinstance(error, UnknownOperationError):
        return f"{where}no straight-line form of {error}"
    return f"{where}{type(error).__name__}: {error}"


class UnrolledSlot:
    """Step, reward and observation of a single environment, on plain numbers.

    Where numbers overflow it gives what NumPy gives, but no warning.

    Args:
        scenario: the scenario.
        with_mask: also say which actions make sense.
        summed: metrics that are summed over slots, see `World.summed`.
    """

    @unheard
    def __init__(
        self, scenario: Scenario, *, with_mask: bool = False, summed: tuple[Metric, ...] = ()
    ) -> None:
        program, world = Program(), World(scenario, library=LIBRARY, measured=summed)
        # Of a first state every number is known.
        state = world.reset(np.zeros((1, world.num_nodes), dtype=np.int64))
        shape = (1, world.num_auvs, len(world.action_sizes))
        action = SymbolArray.unknown(program, "action", np.zeros(shape, dtype=np.int64))
        before = State(*(SymbolArray.unknown(program, *item) for item in state._asdict().items()))
        drawn = {name: np.zeros(shape_of(name, world.chance, 1)) for name in Chance._fields}
        chance = Chance(*(SymbolArray.unknown(program, *item) for item in drawn.items()))
        after, events = world.step(before, action, chance)
        mask = [world.action_mask(after)] if with_mask else []
        results = [after, events, [world.reward(after, events)], [world.observe(after)], mask]
        self._function = program.function(
            [numbers(before), numbers([action]), numbers(chance)],
            [numbers(each) for each in results],
        )
        self._state = [(array.shape, array.dtype) for array in state]
        self._events = [(array.shape, array.dtype) for array in events]
        #: Where in the numbers of a state, and of events, those of each array are.
        self.in_state = _places(State._fields, self._state)
        self.in_events = _places(Events._fields, self._events)

    def __call__(
        self, state: Numbers, action: Sequence[int], chance: Numbers = ()
    ) -> tuple[Numbers, Numbers, Numbers, Numbers, Numbers]:
        """One slot.

        Args:
            state: `numbers` of the state before it.
            action: the entries of the AUVs' actions, one AUV after the other.
            chance: `numbers` of the slot's chance, where there is any.

        Returns:
            numbers of the state after it, of what happened in it, of the (auvs) rewards, of
            the (auvs, entries) observations, and of the (auvs, choices) mask, if asked for.
        """
        result: tuple[Numbers, Numbers, Numbers, Numbers, Numbers] = self._function(
            state, action, chance
        )
        return result

    def state(self, of: Numbers) -> State:
        """The state of these numbers."""
        return State(*_arrays(of, self.in_state, self._state))

    def events(self, of: Numbers) -> Events:
        """The events of these numbers."""
        return Events(*_arrays(of, self.in_events, self._events))


def numbers(arrays: Sequence[Array]) -> Numbers:
    """The numbers, or symbols, of arrays, such as a state, one after the other."""
    return tuple(each for array in arrays for each in objects(array).ravel().tolist())


def _places(names: Sequence[str], forms: Sequence[Form]) -> dict[str, slice]:
    """Where the numbers of each of the arrays are, by name."""
    ends = itertools.accumulate(math.prod(shape) for shape, _ in forms)
    places = itertools.starmap(slice, itertools.pairwise([0, *ends]))
    return dict(zip(names, places, strict=True))


def _arrays(
    of: Numbers, places: Mapping[str, slice], forms: Sequence[Form]
) -> list[npt.NDArray[Any]]:
    return [
        np.array(of[place], dtype=dtype).reshape(shape)
        for place, (shape, dtype) in zip(places.values(), forms, strict=True)
    ]
