"""What parts return, looked at while a world plays: shapes, types, ranges.

Where a scenario has parts from outside, they are looked at once, in a first slot;
`iout_marl.testing.check_part` has any part looked at over whole episodes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from iout_marl.core.limits import unheard
from iout_marl.core.split import Split
from iout_marl.parts import Blowing, Call, Heard, Request, Rest
from iout_marl.physics.arrays import Array
from iout_marl.registry import on_change
from iout_marl.scenario import Scenario
from iout_marl.scenario.parts import Settings, parts_in
from iout_marl.whole import short

#: By how much rounding may exceed a range, as a share of it.
_ROUNDING = {"float64": 1e-9, "float32": 1e-4}


@functools.lru_cache(maxsize=64)
@unheard
def check_first_slot(
    make_world: Callable[..., Any], scenario: Scenario, library: Any, dtype: str, device: Any
) -> None:
    """Play a slot by random actions, and look at what parts from outside return.

    Args:
        make_world: makes a world that does not do so itself.
        scenario, library, dtype, device: as for `World`.

    Raises:
        InputError: it is not what their role asks for, or they raise something.
    """
    # A number that no other axis has.
    taken = {1, scenario.num_auvs, scenario.num_nodes}
    num_envs = next(n for n in range(2, 6) if n not in taken)
    world = make_world(scenario, num_envs, library, dtype, device, measured=())
    watch(world, lambda part: part.entry.is_outside)
    state = world.reset(seed=0)
    world.observe(state)
    shape, rng = (num_envs, world.num_auvs), np.random.default_rng(0)
    action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)
    chance = next(world.draw_chance(0))
    state, events = world.step(state, world.backend.integers(action), chance)
    world.reward(state, events)
    world.observe(state)


# Of a name another part may be registered.
on_change.append(lambda _: check_first_slot.cache_clear())


def watch(world: Any, is_watched: Callable[[Settings], bool]) -> None:
    """Have parts of a world looked at whenever they return something.

    Args:
        world: the world, which raises an InputError from now on where a part returns what its
            role does not promise, or changes what it is given.
        is_watched: says of which parts.
    """
    for path, settings in parts_in(world.scenario):
        if is_watched(settings):
            look = _LOOKS.get(settings.entry.role)
            if look is not None:
                look(_Watch(world, settings), path)


class _Watched:
    """A part that is called, and looked at; its attributes are those of the part."""

    def __init__(self, part: Any, call: Callable[..., Any]) -> None:
        self._part, self._call = part, call

    def __getattr__(self, name: str) -> Any:
        return getattr(self._part, name)

    def __call__(self, *args: Any) -> Any:
        return self._call(*args)


class _Watch:
    """Looks at what one part of a world returns."""

    def __init__(self, world: Any, settings: Settings) -> None:
        self.world, self.settings = world, settings
        self._xp = world.backend.xp
        self._like = world.backend.zeros((1, 1))
        self.rounding = _ROUNDING["float64" if self._like.dtype == self._xp.float64 else "float32"]

    def over(self, function: Callable[..., Any], look: Callable[..., None]) -> Callable[..., Any]:
        """A function of the part whose results are looked at, with its arguments."""

        def watched(*args: Any) -> Any:
            before = [_copied(arg) for arg in args]
            with self.settings.entry.blamed():
                found = function(*args)
                look(found, *args)
            for arg, copy in zip(args, before, strict=True):
                self.need(
                    _alike(arg, copy), f"must not change the {type(arg).__name__} it is given"
                )
            return found

        return watched

    def need(self, holds: Any, message: str) -> None:
        """Refuse what does not hold everywhere."""
        if not bool(self._xp.all(self._xp.asarray(holds))):
            raise self.settings.entry.fault(message)

    def array(
        self,
        what: str,
        values: Any,
        shapes: Mapping[str, tuple[int, ...]],
        *,
        is_flags: bool = False,
    ) -> None:
        """Refuse what is no array of one of the shapes, and of flags or of floats."""
        dtype = self._xp.bool if is_flags else self.world.backend.dtype
        dtype_name = str(np.dtype(bool) if is_flags else self._like.dtype)
        words: dict[tuple[int, ...], str] = {}
        for name_of_shape, shape in shapes.items():
            words.setdefault(shape, name_of_shape)
        expected = " or ".join(f"{name} = {shape}" for shape, name in words.items())
        if not isinstance(values, type(self._like)):
            raise self.settings.entry.fault(
                f"{what} must be an array of {dtype_name}, {expected}, not {short(values)}"
            )
        if tuple(values.shape) not in shapes.values() or values.dtype != dtype:
            raise self.settings.entry.fault(
                f"{what} must be of {dtype_name}, {expected}, not of {values.dtype} and shape "
                f"{tuple(values.shape)}"
            )
        if values.device != self._like.device:
            raise self.settings.entry.fault(
                f"{what} must lie on {self._like.device}, not on {values.device}"
            )

    def finite(self, what: str, values: Array) -> None:
        """Refuse what is infinite or not a number."""
        self.need(self._xp.isfinite(values), f"{what} must be finite")

    def within(self, what: str, values: Array, low: Any, high: Any) -> None:
        """Refuse what is outside a range, of which a rounding may be exceeded."""
        low, high = np.asarray(low, np.float64), np.asarray(high, np.float64)
        room = self.rounding * (1 + np.maximum(np.abs(low), np.abs(high)))
        floats = self.world.backend.floats
        inside = (values >= floats(low - room)) & (values <= floats(high + room))
        if not bool(self._xp.all(inside)):
            found = float(self._xp.reshape(values[~inside], (-1,))[0])
            limits = f"from {low.min():g} to {high.max():g}"
            raise self.settings.entry.fault(
                f"{what} must lie {limits}, as stated, not at {found:g}"
            )

    @property
    def per_auv(self) -> dict[str, tuple[int, ...]]:
        return {"(envs, auvs)": (self.world.num_envs, self.world.num_auvs)}


def _look_at_reward(watch: _Watch, _: Any) -> None:
    world = watch.world
    bound = sum(world.reward_part.bounds(world.scenario).values())
    if world.reward_part.is_credited_apart:
        bound *= 2  # for a difference of two rewards
    shapes = {**watch.per_auv, "(envs, 1)": (world.num_envs, 1)}

    def look(terms: Any, *_: Any) -> None:
        if not isinstance(terms, Mapping) or not terms:
            raise watch.settings.entry.fault(
                f"must return a mapping of terms, name to array, not {short(terms)}"
            )
        for name, values in terms.items():
            watch.need(isinstance(name, str), f"the name of a term must be a text, not {name!r}")
            watch.array(f"term {name!r}", values, shapes)
            watch.finite(f"term {name!r}", values)
        if bound:
            watch.within("the reward", sum(terms.values()), -bound, bound)

    world.reward_part = _Watched(world.reward_part, watch.over(world.reward_part, look))


def _look_at_access(watch: _Watch, _: Any) -> None:
    world, xp = watch.world, watch.world.backend.xp
    most = world.access.max_uplinks_per_slot(world.num_auvs)

    def look(uplinks: Any, request: Request, split: Split) -> None:  # noqa: ARG001
        if not isinstance(uplinks, Sequence) or len(uplinks) != 2:
            raise watch.settings.entry.fault(
                f"must return Uplinks(delivered, spent_j), not {short(uplinks)}"
            )
        delivered, spent_j = uplinks
        watch.array("delivered", delivered, watch.per_auv, is_flags=True)
        watch.array("spent_j", spent_j, watch.per_auv)
        watch.finite("spent_j", spent_j)
        watch.need(request.sends | ~delivered, "a node must not deliver that does not send")
        number = xp.sum(xp.astype(delivered, xp.int64), axis=1)
        watch.need(
            number <= most,
            f"no more than max_uplinks_per_slot, {most}, may deliver in a slot, "
            f"not {int(xp.max(number))}",
        )
        same = request.heard[:, :, None] == request.heard[:, None, :]
        both = same & delivered[:, :, None] & delivered[:, None, :]
        times = xp.sum(xp.astype(both, xp.int64), axis=2)
        watch.need(times <= 1, "a node must deliver to one AUV at most")
        zero = world.backend.floats(0.0)
        by_node = xp.sum(xp.where(same, spent_j[:, None, :], zero), axis=2)
        room = 1 + watch.rounding
        watch.need(spent_j >= 0, "spent_j must not be negative")
        watch.need(
            by_node <= request.available_j * room, "a node must not spend more than available_j"
        )

    world.access = _Watched(world.access, watch.over(world.access, look))


def _look_at_hearing(watch: _Watch, _: Any) -> None:
    world, xp = watch.world, watch.world.backend.xp
    part, rounds = world.hearing, world.hearing.rounds(world.num_nodes)
    if not part.polls:
        return
    nobody = world.num_nodes
    columns = {"(envs, auvs, rounds)": (world.num_envs, world.num_auvs, rounds)}
    nodes = (world.num_envs, world.num_auvs, world.num_nodes)
    of_nodes = {"(envs, auvs, nodes)": nodes, "(envs, 1, nodes)": (nodes[0], 1, nodes[2])}

    def look_at_urgency(urgency: Any, *_: Any) -> None:
        watch.array("urgency", urgency, of_nodes)
        watch.finite("urgency", urgency)

    def look(heard: Any, call: Call) -> None:
        if not isinstance(heard, Heard):
            raise watch.settings.entry.fault(f"must return a Heard, not {short(heard)}")
        chosen, spent_j = heard.chosen
        watch.array("chosen.delivered", chosen, watch.per_auv, is_flags=True)
        watch.array("chosen.spent_j", spent_j, watch.per_auv)
        for name in ("spent_j", "age_s"):
            watch.array(name, getattr(heard, name), columns)
            watch.finite(name, getattr(heard, name))
            watch.need(getattr(heard, name) >= 0, f"{name} must not be negative")
        watch.array("delivered", heard.delivered, columns, is_flags=True)
        if tuple(heard.node.shape) not in columns.values() or heard.node.dtype != xp.int64:
            raise watch.settings.entry.fault(
                f"node must be of int64, (envs, auvs, rounds) = {columns['(envs, auvs, rounds)']}, "
                f"not of {heard.node.dtype} and shape {tuple(heard.node.shape)}"
            )
        watch.need((heard.node >= 0) & (heard.node <= nobody), "node must be from 0 to K, nobody")
        watch.need((heard.node < nobody) | ~heard.delivered, "nobody must not deliver")
        own = xp.concat([call.request.heard[..., None], heard.node], axis=2)
        arrived = xp.concat([chosen[..., None], heard.delivered], axis=2)
        watch.need(
            xp.sum(xp.astype(arrived, xp.int64), axis=2) <= part.uplinks_per_slot,
            f"no more than uplinks_per_slot, {part.uplinks_per_slot}, may arrive at an AUV",
        )
        every, came = (xp.reshape(each, (world.num_envs, -1)) for each in (own, arrived))
        times = (every[:, :, None] == every[:, None, :]) & came[:, :, None] & came[:, None, :]
        watch.need(
            xp.sum(xp.astype(times, xp.int64), axis=2) <= 1, "a node must deliver once a slot"
        )

    part.urgency = watch.over(part.urgency, look_at_urgency)

    def listen(call: Call, access: Any, storage: Any) -> Any:
        def heard(call: Call) -> Any:
            return part(call, access, storage)

        return watch.over(heard, look)(call)

    world.hearing = _Watched(part, listen)


def _look_at_split(watch: _Watch, _: Any) -> None:
    """Look at a duplex part, and at a rule for β, which splits the slot for it."""
    world, duplex, xp = watch.world, watch.world.duplex, watch.world.backend.xp
    splits, slot_s = duplex.splits_slot, world.link.slot_s

    def look(split: Any, *_: Any) -> None:
        if not isinstance(split, Split):
            raise watch.settings.entry.fault(f"split must return a Split, not {short(split)}")
        for name, values in split._asdict().items():
            watch.array(name, values, watch.per_auv)
            watch.need(~xp.isnan(values), f"{name} must be a number")
        watch.within("beta", split.beta, 0, 1)
        watch.within("charging_s", split.charging_s, 0, slot_s)
        watch.need(split.required_j >= 0, "required_j must not be negative")
        # Where nothing is sent, any duration does.
        silent, whole_s = split.beta == 1, world.backend.floats(slot_s)
        watch.need(split.uplink_s > 0, "uplink_s must be above 0, where nothing is sent too")
        watch.within("uplink_s", xp.where(silent, whole_s, split.uplink_s), 0, slot_s)
        if splits:
            total_s = xp.where(silent, whole_s, split.charging_s + split.uplink_s)
            watch.within("charging_s + uplink_s", total_s, 0, slot_s)

    def look_at_flags(sends: Any, *_: Any) -> None:
        watch.array("sends", sends, watch.per_auv, is_flags=True)

    duplex.split = watch.over(duplex.split, look)
    if watch.settings.entry.role == "duplex":
        duplex.sends = watch.over(duplex.sends, look_at_flags)


def _look_at_storage(watch: _Watch, _: Any) -> None:
    world = watch.world
    storage, room = world.storage, 1 + watch.rounding
    per_node = {"(envs, nodes)": (world.num_envs, world.num_nodes)}

    def look_at_filled(held_j: Any, energy_j: Array) -> None:
        watch.array("filled", held_j, {"that of its argument": tuple(energy_j.shape)})
        watch.need((held_j >= 0) & (held_j <= energy_j * room), "filled must not add energy")
        if storage.capacity_j is not None:
            watch.need(held_j <= storage.capacity_j * room, "filled must not exceed capacity_j")

    def look_at_rest(rest: Any, energy_j: Array) -> None:
        if not isinstance(rest, Rest):
            raise watch.settings.entry.fault(f"rest must return a Rest, not {short(rest)}")
        for name, values in rest._asdict().items():
            watch.array(name, values, per_node)
            watch.need(values >= 0, f"{name} of rest must not be negative")
        gap_j = sum(rest) - energy_j
        watch.need(
            (gap_j <= energy_j * watch.rounding) & (gap_j >= -energy_j * watch.rounding),
            "energies of rest must add up to what there was",
        )

    def look_at_flags(sleeps: Any, available_j: Array) -> None:
        shapes = {"that of its argument": tuple(available_j.shape)}
        watch.array("sleeps", sleeps, shapes, is_flags=True)

    storage.filled = watch.over(storage.filled, look_at_filled)
    storage.rest = watch.over(storage.rest, look_at_rest)
    storage.sleeps = watch.over(storage.sleeps, look_at_flags)


def _look_at_fading(watch: _Watch, _: Any) -> None:
    world = watch.world
    if not world.fades:
        return
    fading = world.reception.fading
    shapes = {"(envs, auvs, nodes)": (world.num_envs, world.num_auvs, world.num_nodes)}

    def look(gain_db: Any, *_: Any) -> None:
        watch.array("gain_db", gain_db, shapes)
        watch.finite("gain_db", gain_db)

    fading.gain_db = watch.over(fading.gain_db, look)


def _look_at_wind(watch: _Watch, _: Any) -> None:
    world = watch.world
    if world.reception is None or world.reception.wind is None:
        return
    wind = world.reception.wind
    columns = (world.num_envs, int(wind.is_drawn))

    def look(blowing: Any, *_: Any) -> None:
        if not isinstance(blowing, Blowing):
            raise watch.settings.entry.fault(f"blowing must return a Blowing, not {short(blowing)}")
        watch.array("speed_m_per_s", blowing.speed_m_per_s, {"(envs, 1)": (world.num_envs, 1)})
        watch.array("gust_m_per_s", blowing.gust_m_per_s, {"(envs, 1 or 0)": columns})
        for name, values in blowing._asdict().items():
            watch.finite(name, values)
        watch.need(blowing.speed_m_per_s >= 0, "speed_m_per_s must not be negative")

    wind.blowing = watch.over(wind.blowing, look)


def _look_at_entry(watch: _Watch, path: tuple[str | int, ...]) -> None:
    world = watch.world
    entries = list(world.observer.entries)
    # Those that a scenario lists come after all others.
    place = int(path[-1]) - len(world.scenario.observation.entries)
    entry = entries[place]
    ranges, auvs = entry.ranges(), (world.num_envs, world.num_auvs, entry.size)
    shapes = {"(envs, auvs, size)": auvs, "(envs, 1, size)": (world.num_envs, 1, entry.size)}

    def look(values: Any, *_: Any) -> None:
        watch.array("its numbers", values, shapes)
        watch.finite("its numbers", values)
        watch.within("its numbers", values, ranges.low, ranges.high)

    entries[place] = _Watched(entry, watch.over(entry, look))
    world.observer.entries = tuple(entries)


_LOOKS: dict[str, Callable[[_Watch, Any], None]] = {
    "reward": _look_at_reward,
    "access": _look_at_access,
    "hearing": _look_at_hearing,
    "duplex": _look_at_split,
    "beta rule": _look_at_split,
    "storage": _look_at_storage,
    "fading": _look_at_fading,
    "wind": _look_at_wind,
    "observation entry": _look_at_entry,
}


def _copied(arg: Any) -> Any:
    if isinstance(arg, tuple):
        return tuple(_copied(item) for item in arg)
    return arg.clone() if hasattr(arg, "clone") else arg.copy()


def _alike(arg: Any, copy: Any) -> bool:
    if isinstance(arg, tuple):
        return all(map(_alike, arg, copy))
    # What is not a number is not equal to itself.
    return bool(((arg == copy) | ((arg != arg) & (copy != copy))).all())
