"""What the APIs share: a batch of episodes, from seeds and actions to NumPy arrays.

Every API class is a thin translation of this class into another API.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from iout_marl.compiled import SlotChoice
from iout_marl.envs.arguments import render_mode_of
from iout_marl.envs.maskable import MaskableMultiDiscrete
from iout_marl.envs.observed import ObservationForm, box
from iout_marl.envs.stepper import ArrayStepper, CompiledStepper, Stepper, TracedStepper
from iout_marl.errors import InputError
from iout_marl.render import Snapshot, as_picture, as_text, print_text
from iout_marl.scenario import AnyScenario, Overrides, load_scenario
from iout_marl.tracing.unrolled import UnrolledSlot, pays_unrolled, unrolled_slot
from iout_marl.world import (
    ChanceStream,
    Events,
    State,
    World,
    node_codes,
    redraws_every_episode,
)
from iout_marl.world.actions import ActionCheck
from iout_marl.world.chance import first_of_current

#: Infos of one slot of one environment, by name: of now, of the episode so far, or of an AUV in
#: the last slot, of which those before the first slot are 0.
INFO_KEYS = {
    "aoi_now": "mean age over nodes now, in slots",
    "mean_aoi": "`aoi_now` under a misleading name, which it keeps until `iout_v1`",
    "time_mean_aoi": "mean of `aoi_now` over the slots so far: `mean_aoi` of an evaluation",
    "peak_aoi": "highest age of any node in any slot so far, in slots",
    "jain": "Jain's index of the packets that each node has delivered so far",
    "harvested_j": "energy that the AUV brought to a node in the last slot, in J",
    "total_harvested_j": "energy that all nodes have harvested so far, in J",
    "total_spent_j": "energy that all nodes have spent on uplinks so far, in J",
    "delivered": "packets that the AUV received in the last slot: 0 or 1, or more where it polls",
    "beta": "share of the last slot in which the AUV charged, in TDD; 0 in FDD",
    "age_violations": "node-slots so far in which an age would have passed its maximum",
}
#: Those of them that each AUV has of its own.
OWN_INFO_KEYS = ("harvested_j", "delivered", "beta")
#: Those of them that a state has, with their names there.
_STATE_FIELDS = {
    "aoi_now": "mean_age",
    "mean_aoi": "mean_age",
    "peak_aoi": "peak_age",
    "jain": "jain",
    "total_harvested_j": "harvested_j",
    "total_spent_j": "spent_j",
    "age_violations": "capped_ages",
}

FloatArray = npt.NDArray[np.float32]
#: A slot of one environment with one AUV and fewer nodes is played as plain numbers: compiled, it
#: would take 12 µs, most of which goes to handing arrays over.
_NODES_COMPILED = 15


class EpisodeBatch:
    """Episodes of a scenario in a batch that start and end together, unless some are restarted.

    Args:
        scenario: a `Scenario`, a bundled name, a path or a mapping.
        num_envs: environments in the batch.
        render_mode: one of `RENDER_MODES`, or None.
        overrides: as for `load_scenario`.

    Attributes:
        world: the world.
        form: that of observations.
        observation_space, action_space: of one AUV.
        state_space: of the vector for central critics.
        seeds: those by which all environments were last reset together; None for entropy.

    Raises:
        InputError: no such scenario, a fault in it, or an argument out of its range.
    """

    def __init__(
        self,
        scenario: AnyScenario,
        num_envs: int = 1,
        render_mode: str | None = None,
        *,
        overrides: Overrides = None,
    ) -> None:
        self.render_mode = render_mode_of(render_mode)
        self.scenario = load_scenario(scenario, overrides)
        try:
            self.world = World(self.scenario, num_envs)
        except MemoryError:
            raise InputError(f"num_envs: no memory for {num_envs:,} environments") from None
        self._num_envs = self.world.num_envs
        self._stepper: Stepper | None = None
        self.mask_place = self.scenario.observation.action_mask
        self._sizes = np.array(self.world.action_sizes)
        self._check = ActionCheck(self._num_envs, self.world.num_auvs, self.world.action_sizes)
        self._choice = self._choice_of_slot()
        self.action_space = self.action_space_for(num_auvs=1)
        self.state_space = box(self.world.observer.state_ranges)
        observer, is_by_rows = self.world.observer, self.scenario.observation.part.is_by_rows
        self.form = ObservationForm(
            observer.agent_ranges,
            observer.layout if is_by_rows else None,
            sum(self.world.action_sizes) if self.mask_place == "observation" else 0,
        )
        self.observation_space = self.form.space()
        self.seeds: tuple[int | None, ...] = (None,) * self._num_envs
        self._rngs: list[np.random.Generator] = []
        self._layout: npt.NDArray[np.int64] | None = None
        self._chance: ChanceStream | None = None
        #: Whether some were restarted without the others.
        self._is_apart = False
        #: Slots that are over in the first environment; 0 before the first reset.
        self._slots_over = 0

    def __getstate__(self) -> dict[str, Any]:
        # A world holds its array library, which cannot be copied, nor can a function made
        # of it; but they hold nothing that changes, either.
        state = {**vars(self), "world": None, "_stepper": None, "_choice": None}
        state.pop("_unrolled", None)
        summed = tuple(metric.name for metric in self.world.summed)
        return state | {
            "_played": self._stepper and (self._stepper.state, self._stepper.events, summed)
        }

    def __setstate__(self, state: dict[str, Any]) -> None:
        played = state.pop("_played")
        vars(self).update(state)
        self.world = World(self.scenario, self._num_envs)
        self._choice = self._choice_of_slot()
        if played:
            before, events, summed = played
            self._stepper = self._stepper_from(self.world.with_sums_of(before, summed), events)

    @cached_property
    def _unrolled(self) -> UnrolledSlot | None:
        """A slot for a single environment, where there is one."""
        if self._num_envs > 1 or not pays_unrolled(self.scenario):
            return None
        return unrolled_slot(
            self.scenario, with_mask=self.mask_place != "none", summed=self.world.summed
        )

    def _stepper_from(self, state: State, events: Events | None = None) -> Stepper:
        slot = self._unrolled
        # Of many numbers a slot takes longer number by number than it does compiled.
        is_quick = self.world.num_auvs == 1 and self.world.num_nodes < _NODES_COMPILED
        choice = None if is_quick and slot is not None else self._choice
        if choice is not None and (compiled := choice.slot()) is not None:
            return CompiledStepper(compiled, self.world, state, events)
        if slot is not None:
            return TracedStepper(slot, self.world, state, events, choice)
        return ArrayStepper(self.world, state, events, self._choice)

    def _choice_of_slot(self) -> SlotChoice:
        return SlotChoice(
            self.scenario,
            observed="float32",
            with_mask=self.mask_place != "none",
            summed=self.world.summed,
        )

    def reset(
        self,
        seeds: Sequence[int | None] | None = None,
        where: npt.NDArray[np.bool_] | None = None,
    ) -> None:
        """Start the next episode of every environment, or of some.

        Args:
            seeds: a seed for each environment, or None to draw on from its stream. The
                first reset, and any with a seed, starts a stream; without a seed then
                from the operating system's entropy.
            where: (envs,) of which environments, whose seeds alone count; None for all.
        """
        if where is not None and not where.all():
            self._restart(seeds, where)
            return
        self._is_apart = False
        seeds = [None] * self.world.num_envs if seeds is None else list(seeds)
        if not self._rngs:
            self._rngs = [np.random.default_rng() for _ in seeds]
        reseeded = [i for i, seed in enumerate(seeds) if seed is not None]
        if reseeded:
            self.seeds = tuple(seeds)
        for i in reseeded:
            self._rngs[i] = np.random.default_rng(seeds[i])
        if self._layout is None or redraws_every_episode(self.scenario):
            self._layout = node_codes(self.scenario, self.world.grid, self._rngs)
        elif reseeded:
            self._layout = self._layout.copy()
            self._layout[reseeded] = node_codes(
                self.scenario, self.world.grid, [self._rngs[i] for i in reseeded]
            )
        if self._chance is not None:
            self._chance.restart(range(self._num_envs), {i: self._rngs[i] for i in reseeded})
        elif self.world.chance:
            self._chance = ChanceStream(self.scenario, self._rngs)
        current = self._first_of_current(list(range(self._num_envs)))
        self._stepper = self._stepper_from(self.world.reset(self._layout, current=current))
        self._arrive()

    def _restart(self, seeds: Sequence[int | None] | None, where: npt.NDArray[np.bool_]) -> None:
        before, events = self.current, self._running.events
        rows = np.flatnonzero(where).tolist()
        for i in rows:
            if seeds is not None and seeds[i] is not None:
                self._rngs[i] = np.random.default_rng(seeds[i])
        assert self._layout is not None
        seeded = [i for i in rows if seeds is not None and seeds[i] is not None]
        drawn = rows if redraws_every_episode(self.scenario) else seeded
        if drawn:
            self._layout = self._layout.copy()
            rngs = [self._rngs[i] for i in drawn]
            self._layout[drawn] = node_codes(self.scenario, self.world.grid, rngs)
        if self._chance is not None:
            self._chance.restart(rows, {i: self._rngs[i] for i in seeded})
        first = self.world.reset(self._layout, current=self._first_of_current(rows))
        state = State(*(_written(old, new, where) for old, new in zip(before, first, strict=True)))
        self._stepper, self._is_apart = self._stepper_from(state, events), bool(state.slot.any())
        self._arrive()

    def _first_of_current(self, rows: list[int]) -> npt.NDArray[np.float64] | None:
        """As `first_of_current`, drawn for some environments alone."""
        drawn = None
        if self.world.chance:
            drawn = first_of_current(self.scenario, [self._rngs[i] for i in rows])
        if drawn is None:
            return None
        of_all = np.zeros((self._num_envs, drawn.shape[1]))
        of_all[rows] = drawn
        return of_all

    def action_space_for(self, num_auvs: int) -> spaces.MultiDiscrete:
        """The actions of some AUVs, joined end to end.

        Where masks are handed out, the space takes them to `sample` by.
        """
        sizes = np.tile(self._sizes, num_auvs)
        if self.mask_place == "none":
            return spaces.MultiDiscrete(sizes)
        return MaskableMultiDiscrete(sizes)

    @property
    def current(self) -> State:
        """The state.

        Raises:
            RuntimeError: before the first reset.
        """
        return self._running.state

    @property
    def last_events(self) -> Events | None:
        """What happened in the last slot; None before the first.

        Raises:
            RuntimeError: before the first reset.
        """
        return self._running.events

    @property
    def has_begun(self) -> bool:
        """Whether there was a reset."""
        return self._stepper is not None

    @property
    def _running(self) -> Stepper:
        if self._stepper is None:
            raise RuntimeError("the episode has not begun: call reset() first")
        return self._stepper

    def step(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """One slot of every environment.

        Args:
            action: (envs, auvs, entries) integers.

        Returns:
            (envs, auvs) rewards.

        Raises:
            InputError: an action lies outside its space.
            RuntimeError: an episode is over, or has not begun.
        """
        stepper = self._running
        if self._is_apart and self.over.any():
            which = np.flatnonzero(self.over).tolist()
            raise RuntimeError(f"the episodes of environments {which} are over: reset them first")
        if self.is_over:
            raise RuntimeError("the episode is over: call reset() first")
        chance = None if self._chance is None else next(self._chance)
        reward = stepper.step(self._check(action), chance)
        self._arrive()
        return reward

    @property
    def is_over(self) -> bool:
        """Whether the first episode has reached the time limit; False before the first reset."""
        return self._slots_over >= self.world.num_slots

    @property
    def over(self) -> npt.NDArray[np.bool_]:
        """Which episodes have reached their time limit, (envs,)."""
        if not self._is_apart:
            return np.full(self._num_envs, self.is_over)
        return np.asarray(self._running.now("slot") >= self.world.num_slots)

    def observe(self) -> FloatArray:
        """(envs, auvs, entries) observations as vectors; a fresh array each time."""
        return self._running.observe()

    def observations(self) -> Any:
        """Observations in their form, each array (envs, auvs, …); fresh arrays each time."""
        return self.form.arrays(self.observe(), self.masks)

    def masks(self) -> npt.NDArray[np.int8]:
        """(envs, auvs, choices): 1 for each sensible choice."""
        return self._running.masks()

    def observe_globally(self) -> FloatArray:
        """(envs, entries): the vectors for central critics."""
        return self.world.observer.observe_globally(self.current).astype(np.float32, order="C")

    def info(self) -> dict[str, npt.NDArray[np.float64]]:
        """What infos tell, by `INFO_KEYS`: (envs,) each, or (envs, auvs) of an AUV's own."""
        if self._is_apart:
            return self._info_apart()
        last = self._running.last if self._slots_over else self._no_events
        return self._told(self._running.now, last, self._delivered)

    def info_of_first(self) -> dict[str, Any]:
        """`info` of the first environment in plain numbers: one each, or a list of the AUVs'."""
        if self._is_apart or not self._slots_over:
            return {name: values[0].tolist() for name, values in self.info().items()}
        running = self._running

        def delivered() -> Any:
            polls = self.world.hearing.polls
            return self._delivered()[0].tolist() if polls else running.first_last("delivered")

        return self._told(running.first_now, running.first_last, delivered)

    def _told(
        self,
        now: Callable[[str], Any],
        last: Callable[[str], Any],
        delivered: Callable[[], Any],
    ) -> dict[str, Any]:
        """What infos tell, where all episodes have begun together.

        Args:
            now, last: give fields of the state and of the last slot's events.
            delivered: gives the packets of the last slot.
        """
        slot, aoi_now = self._slots_over, now("mean_age")
        return {
            "aoi_now": aoi_now,
            "mean_aoi": aoi_now,
            "time_mean_aoi": now("age_sum") / slot if slot else aoi_now,
            "peak_aoi": now("peak_age"),
            "jain": now("jain"),
            "harvested_j": last("harvested_j"),
            "total_harvested_j": now("harvested_j"),
            "total_spent_j": now("spent_j"),
            "delivered": delivered() if slot else last("delivered"),
            "beta": last("beta"),
            "age_violations": now("capped_ages"),
        }

    def _delivered(self) -> npt.NDArray[Any]:
        """Packets of the last slot, (envs, auvs)."""
        delivered = self._running.last("delivered")
        if self.world.hearing.polls:
            polled = self._running.last("polled_delivered")
            delivered = delivered + polled.reshape(*delivered.shape, -1).sum(-1)
        return delivered

    def _no_events(self, _: str) -> npt.NDArray[np.float64]:
        return np.zeros((self.world.num_envs, self.world.num_auvs))

    def _info_apart(self) -> dict[str, npt.NDArray[np.float64]]:
        """`info` where some episodes have begun later than others."""
        running, slots = self._running, self._running.now("slot")
        begun = slots > 0
        own = {name: running.last(name) for name in ("harvested_j", "beta")}
        own["delivered"] = self._delivered()
        last = {name: np.where(begun[:, None], values, 0.0) for name, values in own.items()}
        now = {name: running.now(field) for name, field in _STATE_FIELDS.items()}
        mean = running.now("age_sum") / np.maximum(slots, 1)
        now["time_mean_aoi"] = np.where(begun, mean, now["mean_aoi"])
        return {name: (now | last)[name] for name in INFO_KEYS}

    def render(self, env: int = 0) -> str | npt.NDArray[np.uint8] | None:
        """The picture that `render_mode` names: text, (height, width, 3) pixels, or None."""
        if self.render_mode in (None, "human"):
            return None
        snapshot = self._snapshot(env)
        return as_text(snapshot) if self.render_mode == "ansi" else as_picture(snapshot)

    def _arrive(self) -> None:
        """Count the slots that are over; in mode `human`, print every environment."""
        self._slots_over = int(self._running.first_now("slot"))
        if self.render_mode == "human":
            for env in range(self.world.num_envs):
                print_text(as_text(self._snapshot(env)))

    def _snapshot(self, env: int) -> Snapshot:
        state = self.current
        events = self._running.events if state.slot[env] else None
        return Snapshot.from_world(self.world, state, events, env)


def _written(
    old: npt.NDArray[Any], new: npt.NDArray[Any], where: npt.NDArray[np.bool_]
) -> npt.NDArray[Any]:
    """The old array, laid out in memory as it is, with the new one's rows."""
    mixed = old.copy(order="K")
    mixed[where] = new[where]
    return mixed
