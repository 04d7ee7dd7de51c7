"""Episodes slot by slot, in a form in which they can be permuted and compared."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.physics.arrays import Array
from iout_marl.world import Chance, ChanceStream, State, World, node_codes

Values = npt.NDArray[Any]
#: Slots that are played: enough for every age to stop, and for each node to be charged and heard.
MOST_SLOTS = 24
#: Fields with an axis of AUVs, and with one of nodes.
OF_AUVS = {
    *("cell", "seen_age", "seen_energy_j", "seen_slot", "others_age", "others_deliveries"),
    *("battery_j", "propulsion_j", "hotel_j", "charging_j", "docked_j", "distance_m"),
    *("stranded_slots", "drawn_j", "stranded", "gain_db", "lost", "excess_db"),
    *("left_grid", "blocked", "charged", "heard", "beta", "event harvested_j", "delivered"),
    *(
        "transit_slots",
        "course",
        "event polled",
        "polled_delivered",
        "polled_j",
        "event spent_j",
        "reward",
        "observation",
        "entry",
        "entry of nodes",
        "entry of auvs",
        *("table context", "table of auvs", "table of nodes"),
    ),
}
OF_NODES = {
    *("node_cell", "age", "energy_j", "deliveries", "seen_age", "seen_energy_j", "seen_slot"),
    *("others_age", "others_deliveries", "available_j", "entry of nodes", "gain_db"),
    "table of nodes",
    *("spilled_j", "leaked_j", "idle_j", "asleep_slots"),
}
#: Those with an axis of AUVs for each AUV, as the last one.
OF_AUVS_FOR_AUVS = {"entry of auvs", "table of auvs"}
CHOSEN_NODES = {"charged", "heard", "event polled"}


@dataclass(frozen=True)
class Slot:
    """What a slot has led to, by name: arrays of NumPy.

    Attributes:
        values: fields of the state after it and of its events, rewards, observations.
    """

    values: Mapping[str, Values]

    def of_env(self, env: int) -> Slot:
        """What it has led to in one environment of the batch."""
        return Slot({name: array[env : env + 1] for name, array in self.values.items()})

    def without(self, name: str) -> Slot:
        """All but one of them."""
        return Slot({other: array for other, array in self.values.items() if other != name})

    def permuted(self, nodes: Values | None = None, auvs: Values | None = None) -> Slot:
        """What it would have led to, had nodes or AUVs been in this order."""
        found = {}
        for name, array in self.values.items():
            if auvs is not None and name in OF_AUVS:
                array = array[:, auvs[: array.shape[1]]]  # noqa: PLW2901
            if auvs is not None and name in OF_AUVS_FOR_AUVS:
                array = array[..., auvs]  # noqa: PLW2901
            if nodes is not None and name in OF_NODES:
                array = array[..., nodes[: array.shape[-1]]]  # noqa: PLW2901
            if nodes is not None and name in CHOSEN_NODES:
                array = renamed(array, nodes)  # noqa: PLW2901
            found[name] = array
        return Slot(found)


def renamed(named: Values, nodes: Values) -> Values:
    """Nodes by the numbers that they have in another order; nobody, K, stays nobody."""
    return np.append(np.argsort(nodes), len(nodes))[named]


def permuted(state: State, nodes: Values | None = None, auvs: Values | None = None) -> State:
    """A state with nodes or AUVs in another order."""
    return State(**Slot(state._asdict()).permuted(nodes, auvs).values)


def first_state(world: World, seeds: Sequence[int]) -> State:
    """The first state, with the layouts of these seeds."""
    rngs = [np.random.default_rng(seed) for seed in seeds]
    return world.reset(node_codes(world.scenario, world.grid, rngs))


def chance_for(world: World, seeds: Sequence[int]) -> Iterator[Chance | None]:
    """The chance of episodes of these seeds, slot by slot."""
    stream = ChanceStream(world.scenario, [np.random.default_rng(seed) for seed in seeds])
    return (chance and chance.map(world.backend.floats) for chance in stream)


def permuted_chance(
    chance: Chance, nodes: Values | None = None, auvs: Values | None = None
) -> Chance:
    """The chance of a slot of a world whose nodes or AUVs are in another order."""
    fading, arrival = chance.fading, chance.arrival
    if nodes is not None and fading.shape[-1]:
        fading = fading[..., nodes]
    if auvs is not None:
        fading, arrival = (each[:, auvs] if each.shape[1] else each for each in (fading, arrival))
    return chance._replace(fading=fading, arrival=arrival)


def actions_for(world: World, seed: int) -> npt.NDArray[np.int64]:
    """(slots, envs, auvs, entries) random actions, those of fewer environments among them."""
    rng = np.random.default_rng(seed)
    shape = (world.num_envs, min(world.num_slots, MOST_SLOTS), world.num_auvs)
    actions = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
    return np.ascontiguousarray(np.swapaxes(actions, 0, 1))


def episode(
    world: World,
    state: State,
    actions: npt.NDArray[np.int64],
    place: int | None = None,
    *,
    chance: Iterable[Chance | None] = itertools.repeat(None),
) -> list[Slot]:
    """Play by these actions.

    Args:
        world: the world.
        state: its first state.
        actions: (slots, envs, auvs, entries).
        place: of an entry of observations that is recorded by itself: its numbers by row, or, for
            want of knowing which belong to which node, all in rising order.
        chance: of each slot, by `chance_for`, in worlds that take any.
    """
    found = []
    for action, drawn in zip(actions, chance, strict=False):
        state, events = world.step(state, world.backend.integers(action), drawn)
        values: dict[str, Any] = state._asdict()
        for name, array in events._asdict().items():
            values[name if name not in values else f"event {name}"] = array
        values["reward"] = world.reward(state, events)
        values["observation"] = world.observe(state)
        if place is not None:
            entry = world.observer.entries[place]
            seen = entry(state)
            seen = np.broadcast_to(seen, (world.num_envs, world.num_auvs, seen.shape[-1]))
            if entry.rows == "auvs":
                by_row = seen.reshape(*seen.shape[:2], entry.columns, world.num_auvs - 1)
                values["entry of auvs"] = with_itself(by_row)
            elif entry.rows in ("nodes", "moves") or entry.feeds_node_network:
                values["entry of nodes"] = seen.reshape(*seen.shape[:2], -1, world.num_nodes)
            else:
                values["entry"] = np.sort(seen, axis=-1)
        elif world.observer.layout is not None:
            rows = world.observer.layout.rows(_numpy(values["observation"]))
            values["table context"] = rows["context"]
            values["table of nodes"] = np.swapaxes(rows["nodes"], -1, -2)
            if "auvs" in rows:
                values["table of auvs"] = with_itself(np.swapaxes(rows["auvs"], -1, -2))
        found.append(Slot({name: _numpy(array) for name, array in values.items()}))
    return found


def with_itself(of_others: Values) -> Values:
    """Numbers of each AUV about others, (envs, auvs, columns, auvs - 1), with 0 about itself."""
    each = [np.insert(of_others[:, i], i, 0, axis=-1) for i in range(of_others.shape[1])]
    return np.stack(each, axis=1)


def _numpy(array: Array) -> Values:
    return np.asarray(array.cpu() if hasattr(array, "cpu") else array)


def compare(found: Any, expected: Any, rounding: float, message: str) -> None:
    """Compare arrays, mappings and tuples of them: numbers up to a rounding, all else exactly.

    Raises:
        AssertionError: they differ: where.
    """
    if isinstance(expected, Mapping):
        for name, values in expected.items():
            one = found[name]
            # Most are: the same bytes need no second look.
            if not (
                isinstance(values, np.ndarray)
                and one.dtype == values.dtype
                and one.shape == values.shape
                and one.tobytes() == values.tobytes()
            ):
                compare(one, values, rounding, f"{message}{name} ")
        return
    if isinstance(expected, tuple):
        for one, other in zip(found, expected, strict=True):
            compare(one, other, rounding, message)
        return
    assert found.shape == expected.shape, f"{message}has shape {found.shape}, not {expected.shape}"
    assert found.dtype == expected.dtype, f"{message}is {found.dtype}, not {expected.dtype}"
    same = found == expected
    if same.all():
        return
    if rounding == 0 or expected.dtype.kind != "f":
        same |= (found != found) & (expected != expected)
    else:
        same = np.isclose(found, expected, rtol=rounding, atol=rounding, equal_nan=True)
    if not same.all():
        first = tuple(np.argwhere(~same)[0].tolist())
        raise AssertionError(f"{message}at {first} is {found[first]}, not {expected[first]}")
