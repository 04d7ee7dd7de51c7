"""Chance in a batch of episodes: each of them draws from streams of its own."""

from __future__ import annotations

import functools
import inspect
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

#: Numbers that are drawn ahead for an episode, and for all of them, at most.
_AHEAD, _AHEAD_OF_ALL = 1024, 2**22
#: Choices that a number of [0, 1) decides between without a bias.
_FEW = 2**32
#: What streams are for: they have the same seed, but nothing in common.
_UNIFORM, _OTHER, _COMMON = range(3)
#: Distributions whose draws, or whose parameters, are not one number each.
_NOT_BY_NUMBER = ("dirichlet", "multinomial", "multivariate_hypergeometric", "multivariate_normal")


class EpisodeStreams(np.random.Generator):
    """A generator for a batch, with which every episode depends on its own seed alone.

    It is used as any generator is. Whatever is drawn in a shape that begins with the number of
    episodes, (envs, auvs) say, has a row for each of them, from the episode's own stream: the
    row is the same however many episodes are played beside it. What is drawn in another shape
    comes from one stream for all.

    Args:
        seed: of the first episode, that of episode i is `seed + i`; or a seed for each.
        num_episodes: how many there are.
    """

    def __init__(self, seed: int | Sequence[int], num_episodes: int) -> None:
        self._seed, self._count = seed, num_episodes
        super().__init__(np.random.PCG64(self._sequence(0, _COMMON)))
        self._common = np.random.Generator(self.bit_generator)
        # One call for many numbers: for each slot by itself it would take longer than the slot.
        self._ahead = np.empty((num_episodes, 0))
        self._next = 0
        self._made: dict[int, list[np.random.Generator]] = {}

    def random(self, size: Any = None, dtype: Any = np.float64, out: Any = None) -> Any:
        """Numbers of [0, 1), as `numpy.random.Generator.random` has them."""
        if not self._has_rows(size):
            return self._common.random(size, dtype, out)
        drawn = np.array(self._uniform(math.prod(np.atleast_1d(size)[1:].tolist()))).reshape(size)
        if np.dtype(dtype) == np.float32:
            # Not rounded, which might make a 1 of them.
            drawn = (np.floor(drawn * 2**24) / 2**24).astype(np.float32)
        if out is None:
            return drawn
        out[...] = drawn
        return out

    def integers(
        self,
        low: Any,
        high: Any = None,
        size: Any = None,
        dtype: Any = np.int64,
        endpoint: bool = False,  # noqa: FBT001, FBT002 (as NumPy has it)
    ) -> Any:
        """Integers from `low` up to `high`, as `numpy.random.Generator.integers` has them."""
        if not self._has_rows(size):
            return self._common.integers(low, high, size, dtype, endpoint)
        first, end = (0, low) if high is None else (low, high)
        choices = np.asarray(end) - first + endpoint
        if (choices < 1).any():
            raise ValueError("low >= high")
        if (choices > _FEW).any():
            return _INTEGERS(self, low, high, size, dtype, endpoint)
        return (first + (self.random(size) * choices).astype(np.int64)).astype(dtype)

    def _uniform(self, count: int) -> npt.NDArray[np.float64]:
        """The next numbers of every episode, (episodes, count)."""
        if self._next + count > self._ahead.shape[1]:
            more = max(min(_AHEAD, _AHEAD_OF_ALL // self._count), count)
            fresh = np.stack([stream.random(more) for stream in self._streams(_UNIFORM)])
            self._ahead = np.concatenate([self._ahead[:, self._next :], fresh], axis=1)
            self._next = 0
        self._next += count
        return self._ahead[:, self._next - count : self._next]

    def _has_rows(self, size: Any) -> bool:
        first = size[:1] if isinstance(size, tuple | list) else [size]
        return list(first) == [self._count]

    def _sequence(self, episode: int, purpose: int) -> np.random.SeedSequence:
        first = self._seed
        seed = first + episode if isinstance(first, int) else first[episode]
        return np.random.SeedSequence(seed, spawn_key=(purpose,))

    def _streams(self, purpose: int) -> list[np.random.Generator]:
        """The streams of all episodes, made when they are first drawn from."""
        if purpose not in self._made:
            sequences = (self._sequence(i, purpose) for i in range(self._count))
            made = [np.random.Generator(np.random.PCG64(sequence)) for sequence in sequences]
            self._made[purpose] = made
        return self._made[purpose]


def _by_rows(name: str) -> Callable[..., Any]:
    """A method of generators that draws the row of every episode from the episode's stream."""
    method: Callable[..., Any] = getattr(np.random.Generator, name)
    signature = inspect.signature(method)

    @functools.wraps(method)
    def draw(self: EpisodeStreams, *given: Any, **named: Any) -> Any:
        bound = signature.bind(self, *given, **named)
        (_, *parameters), size = bound.arguments.items(), bound.arguments.get("size")
        if not self._has_rows(size):
            return method(self._common, *given, **named)
        shape = tuple(np.atleast_1d(np.asarray(size)).tolist())

        def row(key: str, value: Any, i: int) -> Any:
            if key == "size":
                return shape[1:] or None
            has_rows = isinstance(value, np.ndarray | list | tuple) and name != "choice"
            return np.broadcast_to(value, shape)[i] if has_rows else value

        return np.array(
            [
                method(stream, **{key: row(key, value, i) for key, value in parameters})
                for i, stream in enumerate(self._streams(_OTHER))
            ]
        )

    return draw


_INTEGERS = _by_rows("integers")
for _name, _method in inspect.getmembers(np.random.Generator, inspect.isroutine):
    if _name.startswith("_") or _name in (*vars(EpisodeStreams), *_NOT_BY_NUMBER):
        continue
    if "size" in inspect.signature(_method).parameters:
        setattr(EpisodeStreams, _name, _by_rows(_name))
