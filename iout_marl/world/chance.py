"""Who draws the chance of episodes: for each environment from a stream of its own."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.chance import Chance, Draw, shape_of
from iout_marl.errors import InputError
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import parts_in

#: Numbers that are drawn ahead for an environment, at most, unless a slot takes more.
_AHEAD = 2**14
_BACKEND = Backend.from_library()


def draws_of(scenario: Scenario) -> dict[str, Draw]:
    """What a slot of one environment draws, by field of `Chance`; nothing in most scenarios."""
    return {
        name: draw
        for _, settings in parts_in(scenario)
        if settings.part.is_of_world
        for name, draw in settings.part.draws(scenario).items()
    }


def first_of_current(
    scenario: Scenario, rngs: Sequence[np.random.Generator]
) -> npt.NDArray[np.float64] | None:
    """What a current that changes by chance begins episodes with: (envs, 2) standard normal.

    None of one that does not. They are drawn from the streams of the layouts, after these:
    arguments as of `node_codes`.
    """
    draw = draws_of(scenario).get("current")
    return None if draw is None else np.stack([rng.standard_normal(draw.shape) for rng in rngs])


class ChanceStream(Iterator[Chance | None]):
    """The chance of a batch of episodes, slot by slot, as float64 NumPy arrays.

    Every environment has a stream of its own, a child of the one that its layout is drawn from,
    which itself is left as it is: so an environment has the same numbers alone and in a batch. Of a
    scenario that leaves nothing to chance, all that comes is None.

    Args:
        scenario: the scenario.
        rngs: of each environment; those that `node_codes` takes.
    """

    def __init__(self, scenario: Scenario, rngs: Sequence[np.random.Generator]) -> None:
        self._draws = draws_of(scenario)
        self._num_envs = len(rngs)
        a_slot = sum(math.prod(draw.shape) for draw in self._draws.values())
        #: Slots that are drawn at once: the same number whatever the batch.
        self._slots = min(max(_AHEAD // max(a_slot, 1), 1), scenario.num_slots)
        # As the world lays arrays out: slots first, then the axes in reverse order.
        self._ahead = {
            name: np.empty((self._slots, *draw.shape[::-1], self._num_envs))
            for name, draw in self._draws.items()
        }
        self._next = np.full(self._num_envs, self._slots)
        #: The slot that comes next where it is the same in all environments; else None.
        self._next_of_all: int | None = self._slots
        self._none = completed({}, _BACKEND, self._draws, self._num_envs)
        self._rngs = [self._child(rng) for rng in rngs]

    def _child(self, rng: np.random.Generator) -> np.random.Generator | None:
        if not self._draws:
            return None
        # A child's child: policies draw from the children themselves, see `EpisodeStreams`.
        sequence: Any = rng.bit_generator.seed_seq
        return np.random.default_rng(sequence.spawn(1)[0].spawn(1)[0])

    def restart(
        self, envs: Sequence[int], seeded: Mapping[int, np.random.Generator] | None = None
    ) -> None:
        """Begin new episodes.

        Args:
            envs: of which environments; the others go on with theirs.
            seeded: of those whose stream begins anew, that of the layout.
        """
        self._spread()
        self._next[envs] = self._slots
        if len(envs) == self._num_envs:
            self._next_of_all = self._slots
        for env, rng in (seeded or {}).items():
            self._rngs[env] = self._child(rng)

    def __next__(self) -> Chance | None:
        if not self._draws:
            return None
        slot = self._next_of_all
        if slot == self._slots:
            self._draw(range(self._num_envs))
            slot = self._next_of_all = 0
        if slot is None:
            due = np.flatnonzero(self._next == self._slots).tolist()
            if due:
                self._draw(due)
            found = {name: _each(ahead, self._next).T for name, ahead in self._ahead.items()}
            self._next += 1
        else:
            found = {name: ahead[slot].T for name, ahead in self._ahead.items()}
            self._next_of_all = slot + 1
        return self._none._replace(**found)

    def _spread(self) -> None:
        """Count the slots of every environment by itself from now on."""
        if self._next_of_all is not None:
            self._next[:] = self._next_of_all
            self._next_of_all = None

    def _draw(self, envs: Sequence[int]) -> None:
        drawn = {
            name: np.empty((len(envs), self._slots, *draw.shape[::-1]))
            for name, draw in self._draws.items()
        }
        for i, env in enumerate(envs):
            rng = self._rngs[env]
            assert rng is not None
            for name, draw in self._draws.items():
                fill = rng.standard_normal if draw.distribution == "normal" else rng.random
                fill(out=drawn[name][i])
        for name, rows in drawn.items():
            # What was handed out before is not written over.
            if len(envs) == self._num_envs:
                self._ahead[name] = np.ascontiguousarray(np.moveaxis(rows, 0, -1))
            else:
                self._ahead[name] = self._ahead[name].copy()
                self._ahead[name][..., envs] = np.moveaxis(rows, 0, -1)
        self._next[envs] = 0


def _each(ahead: npt.NDArray[np.float64], slot: npt.NDArray[np.int64]) -> npt.NDArray[np.float64]:
    """Of every environment its own slot, (…, envs)."""
    rows = [ahead[number, ..., env] for env, number in enumerate(slot.tolist())]
    return np.stack(rows, axis=-1)


def completed(
    found: Mapping[str, Array], backend: Backend, draws: dict[str, Draw], num_envs: int
) -> Chance:
    """The chance of a slot from what was drawn, with arrays without columns for the rest."""
    return Chance(
        *(
            found[name] if name in found else backend.zeros(shape_of(name, draws, num_envs))
            for name in Chance._fields
        )
    )


def expected(backend: Backend, draws: dict[str, Draw], num_envs: int) -> Chance:
    """What planners step by: all that is normal is 0, and nothing uniform is drawn."""
    normal = {
        name: backend.zeros(shape_of(name, draws, num_envs))
        for name, draw in draws.items()
        if draw.distribution == "normal"
    }
    return completed(normal, backend, {}, num_envs)


def check_chance(chance: Any, draws: dict[str, Draw], num_envs: int) -> None:
    """Refuse what is no chance of a slot of a world.

    Args:
        chance: what is given.
        draws: what the world takes.
        num_envs: its environments.

    Raises:
        InputError: it is something else, or of another shape.
    """
    if not isinstance(chance, Chance):
        raise InputError(f"chance must be a Chance, not {type(chance).__name__}")
    for name, draw in draws.items():
        found, wanted = tuple(getattr(chance, name).shape), shape_of(name, draws, num_envs)
        is_expected = draw.distribution == "uniform" and found[-1:] == (0,)
        if found != wanted and not is_expected:
            raise InputError(f"chance: {name} must have the shape {wanted}, not {found}")
