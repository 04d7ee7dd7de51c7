"""Observations in any of the forms in which environments hand them out, and actions likewise.

| from | observation | action |
|---|---|---|
| one agent | (entries,) | (choices,) |
| ParallelEnv | {agent: (entries,)} | {agent: (choices,)} |
| all AUVs of an environment | (auvs, entries) | (auvs, choices) |
| gymnasium, one controller | (auvs · entries,) | (auvs · choices,) |
| VectorEnv | (envs, auvs · entries) | (envs, auvs · choices) |
| a batch | (envs, auvs, entries) | (envs, auvs, choices) |

In each of them a vector may be `{"observation": vector, "action_mask": mask}`, or a node table by
rows, `{"context": (…, columns), "nodes": (…, K, columns), "auvs": (…, M − 1, columns),
"action_mask": mask}`, joined end to end by rows; the mask may be missing, and `auvs` where there is
one AUV. The leading axes of an answer are those of the question; its last is of one AUV, or of all
joined end to end.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.core.table import flattened
from iout_marl.errors import InputError
from iout_marl.whole import short
from iout_marl.world import World

#: What the observation of one AUV has, where it is a mapping.
_OF_ONE = {"observation", "context", "nodes"}
#: Axes of the arrays of a node table, without leading ones.
_DIMENSIONS = {"context": 1, "auvs": 2, "nodes": 2}


@dataclass(frozen=True)
class Sizes:
    """How many entries observations, masks and actions of one AUV have.

    Attributes:
        observation: entries of an observation.
        action: number of choices of each entry of an action.
        num_auvs: how many are joined end to end; None for any number.
    """

    observation: int
    action: tuple[int, ...]
    num_auvs: int | None

    @classmethod
    def from_world(cls, world: World) -> Sizes:
        """Those of a world."""
        entries = len(world.observer.agent_ranges.low)
        return cls(entries, tuple(world.action_sizes), world.num_auvs)


@dataclass(frozen=True)
class Question:
    """Observations to choose actions for, a row for each AUV.

    Attributes:
        rows: (rows, entries) float32 observations.
        masks: (rows, choices) bool, or None where there are none.
        agents: whose rows they are, where the observations were given by agent.
        shape: that of the answer; the rows, if by agent.
    """

    rows: npt.NDArray[np.float32]
    masks: npt.NDArray[np.bool_] | None
    agents: tuple[str, ...] | None
    shape: tuple[int, ...]

    def answer(self, actions: npt.NDArray[np.int64]) -> Any:
        """(rows, entries) actions in the form that belongs to the observations."""
        if self.agents is not None:
            return dict(zip(self.agents, actions, strict=True))
        return actions.reshape(self.shape)


def read_question(observation: Any, mask: Any, sizes: Sizes, who: str) -> Question:
    """The observations, and the masks that came with or in them.

    Args:
        observation: see the table above.
        mask: masks in the same form: (…, choices) for (…, entries), or by agent; None for
            those in the observation, if there are any.
        sizes: what is expected.
        who: what the policy is called.

    Raises:
        InputError: they are of another form or size, or not finite.
    """
    if not isinstance(observation, Mapping) or not _OF_ONE.isdisjoint(observation):
        return _of_vectors(observation, mask, sizes, who)
    masks = mask if isinstance(mask, Mapping) else dict.fromkeys(observation, mask)
    agents = tuple(observation)
    each = [_of_vectors(observation[a], masks.get(a), sizes, f"{who}, {a}") for a in agents]
    for agent, question in zip(agents, each, strict=True):
        if question.shape != (len(sizes.action),):
            got = np.shape(_vector(observation[agent], sizes, who))
            raise InputError(f"{who}, {agent}: {_expected(sizes, (sizes.observation,))}, not {got}")
    rows = np.concatenate([question.rows for question in each] or [_no_rows(sizes.observation)])
    with_masks = [question.masks for question in each if question.masks is not None]
    if with_masks and len(with_masks) < len(each):
        raise InputError(f"{who}: some agents have a mask, but not all of them")
    all_masks = np.concatenate(with_masks) if with_masks else None
    return Question(rows, all_masks, agents, (len(rows), len(sizes.action)))


def _of_vectors(observation: Any, mask: Any, sizes: Sizes, who: str) -> Question:
    if mask is None and isinstance(observation, Mapping):
        mask = observation.get("action_mask")
    try:
        vector = np.asarray(_vector(observation, sizes, who), dtype=np.float32)
    except (ValueError, TypeError):
        given = short(_vector(observation, sizes, who))
        raise InputError(f"{who}: observations must be numbers, not {given}") from None
    entries = vector.shape[-1] if vector.ndim else 0
    joined = entries // sizes.observation
    fits = joined in (1, sizes.num_auvs) or (joined > 1 and sizes.num_auvs is None)
    if not fits or entries % sizes.observation:
        raise InputError(f"{who}: {_expected(sizes)}, not shape {vector.shape}")
    if not np.isfinite(vector).all():
        raise InputError(f"{who}: an observation holds {vector[~np.isfinite(vector)][0]}")
    leading = vector.shape[:-1]
    masks = None
    if mask is not None:
        wanted = (*leading, joined * sum(sizes.action))
        if np.shape(mask) != wanted:
            raise InputError(f"{who}: mask: expected shape {wanted}, not {np.shape(mask)}")
        masks = np.asarray(mask, dtype=np.bool_).reshape(-1, sum(sizes.action))
    rows = vector.reshape(-1, sizes.observation)
    return Question(rows, masks, None, (*leading, joined * len(sizes.action)))


def _vector(observation: Any, sizes: Sizes, who: str) -> Any:
    if not isinstance(observation, Mapping) or _OF_ONE.isdisjoint(observation):
        return observation
    if "observation" in observation:
        return observation["observation"]
    return _of_table(observation, sizes, who)


def _of_table(table: Mapping[str, Any], sizes: Sizes, who: str) -> npt.NDArray[np.float32]:
    """The vectors of a node table by rows."""
    rows: dict[str, npt.NDArray[np.float32]] = {}
    for name, least in _DIMENSIONS.items():
        if name not in table:
            if name == "auvs":
                continue
            raise InputError(f"{who}: a node table has context and nodes, but {name} is missing")
        try:
            rows[name] = np.asarray(table[name], dtype=np.float32)
        except (ValueError, TypeError):
            given = short(table[name])
            raise InputError(f"{who}: {name} must be numbers, not {given}") from None
        if rows[name].ndim < least:
            raise InputError(f"{who}: {name}: expected rows and columns, not {rows[name].shape}")
    shapes = {name: array.shape for name, array in rows.items()}
    entries = sum(math.prod(s[-_DIMENSIONS[name] :]) for name, s in shapes.items())
    try:
        return flattened(rows, max(entries // sizes.observation, 1))
    except ValueError:
        raise InputError(f"{who}: shapes of a node table do not go together: {shapes}") from None


def _no_rows(entries: int) -> npt.NDArray[np.float32]:
    return np.empty((0, entries), dtype=np.float32)


def _expected(sizes: Sizes, shape: Sequence[int] | None = None) -> str:
    if shape is not None:
        return f"expected an observation of shape {tuple(shape)}"
    one = f"expected observations of {sizes.observation} entries each"
    if sizes.num_auvs is None:
        return f"{one}, or several joined end to end"
    if sizes.num_auvs == 1:
        return one
    both = sizes.num_auvs * sizes.observation
    return f"{one}, or {both} of all {sizes.num_auvs} AUVs joined end to end"
