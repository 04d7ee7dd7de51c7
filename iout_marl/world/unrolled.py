"""One slot of a single environment as straight-line Python.

NumPy takes about half a microsecond to look at an array, however small, and a slot of a single
environment is a hundred looks at arrays of a few numbers. So the world is run once on symbols in
their place, and what it does to each number becomes a line of a Python function: the same
world, rule by rule and digit by digit, without the arrays. `benchmarks/environment.py` measures
what it gains.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.world.state import Events, State
from iout_marl.world.symbols import LIBRARY, Program, SymbolArray
from iout_marl.world.world import World

#: Plain numbers, in the order in which they lie in one array or in several, one after the other.
Numbers: TypeAlias = tuple[Any, ...]
#: Up to which numbers of pairs of an AUV and a node, of AUVs and of cells it pays. The function
#: grows with pairs, whatever the scenario has an AUV see, and with pairs of AUVs; tables with
#: cells. From eight AUVs on, NumPy's sums over them would also differ in the last digit.
MOST_PAIRS, MOST_AUVS, MOST_CELLS = 40, 4, 20_000


def pays_unrolled(scenario: Scenario) -> bool:
    """Whether an `UnrolledSlot` of a scenario takes less time than the world on NumPy."""
    pairs = scenario.num_auvs * scenario.num_nodes
    cells = int(np.prod(scenario.grid.cells))
    return pairs <= MOST_PAIRS and scenario.num_auvs <= MOST_AUVS and cells <= MOST_CELLS


# It never changes, and all environments of a process can share it.
@functools.lru_cache(maxsize=16)
def unrolled_slot(scenario: Scenario, *, with_mask: bool = False) -> UnrolledSlot:
    """The `UnrolledSlot` of a scenario, made once."""
    return UnrolledSlot(scenario, with_mask=with_mask)


class UnrolledSlot:
    """Step, reward and observation of a single environment, on plain numbers.

    Where numbers overflow it gives what NumPy gives, but no warning.

    Args:
        scenario: the scenario.
        with_mask: also say which actions make sense.
    """

    def __init__(self, scenario: Scenario, *, with_mask: bool = False) -> None:
        program, world = Program(), World(scenario, library=LIBRARY)
        state = World(scenario).reset(np.zeros((1, world.num_nodes), dtype=np.int64))
        shape = (1, world.num_auvs, len(world.action_sizes))
        action = program.parameters("action", np.zeros(shape, dtype=np.int64))
        before = State(*(program.parameters(k, v) for k, v in state._asdict().items()))
        after, events = world.step(before, action)
        mask = [world.action_mask(after)] if with_mask else []
        results = [after, events, [world.reward(after, events)], [world.observe(after)], mask]
        self._function = program.function(
            [_objects(before), _objects([action])], [_objects(each) for each in results]
        )
        self._state = [(array.shape, array.dtype) for array in state]
        self._events = [(array.shape, array.dtype) for array in events]
        #: Where in the numbers of a state, and of events, each of its arrays begins.
        self.begins_of_state = _begins(State._fields, state)
        self.begins_of_events = _begins(Events._fields, events)

    def __call__(
        self, state: Numbers, action: Sequence[int]
    ) -> tuple[Numbers, Numbers, Numbers, Numbers, Numbers]:
        """One slot.

        Args:
            state: `numbers` of the state before it.
            action: the entries of the AUVs' actions, one AUV after the other.

        Returns:
            numbers of the state after it, of what happened in it, of the (auvs) rewards, of
            the (auvs, entries) observations, and of the (auvs, choices) mask, if asked for.
        """
        result: tuple[Numbers, Numbers, Numbers, Numbers, Numbers] = self._function(state, action)
        return result

    @staticmethod
    def numbers(arrays: State | Events) -> Numbers:
        """The numbers of a state, or of events."""
        return tuple(number for array in arrays for number in array.ravel().tolist())

    def state(self, numbers: Numbers) -> State:
        """The state of these numbers."""
        return State(*_arrays(numbers, self._state))

    def events(self, numbers: Numbers) -> Events:
        """The events of these numbers."""
        return Events(*_arrays(numbers, self._events))


def _objects(arrays: Sequence[Array]) -> list[Any]:
    """Symbols and numbers of arrays, one after the other."""
    values = [a.values if isinstance(a, SymbolArray) else a for a in arrays]
    return [each for array in values for each in array.ravel().tolist()]


def _begins(names: Sequence[str], arrays: Sequence[Array]) -> dict[str, int]:
    sizes = [int(np.prod(array.shape)) for array in arrays]
    return dict(zip(names, np.cumsum([0, *sizes]).tolist(), strict=False))


def _arrays(
    numbers: Numbers, forms: Sequence[tuple[tuple[int, ...], np.dtype[Any]]]
) -> list[npt.NDArray[Any]]:
    arrays, begin = [], 0
    for shape, dtype in forms:
        end = begin + int(np.prod(shape))
        arrays.append(np.array(numbers[begin:end], dtype=dtype).reshape(shape))
        begin = end
    return arrays
