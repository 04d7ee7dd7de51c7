"""What the faces share: a batch of episodes, from seeds and actions to NumPy arrays.

Every face is a thin translation of this class into another API.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from iout_marl.envs.maskable import MaskableMultiDiscrete
from iout_marl.envs.play import BatchedPlay, Play, UnrolledPlay
from iout_marl.errors import InputError
from iout_marl.render import Snapshot, as_picture, as_text, print_text
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import Events, State, World, node_codes, redraws_every_episode
from iout_marl.world.actions import ActionCheck
from iout_marl.world.observation import Ranges
from iout_marl.world.unrolled import pays_unrolled, unrolled_slot

#: Of a slot and an environment, by name: see `Episodes.info`.
INFO_KEYS = (
    "mean_aoi",
    "time_mean_aoi",
    "peak_aoi",
    "jain",
    "harvested_j",
    "total_harvested_j",
    "total_spent_j",
    "delivered",
    "beta",
    "age_violations",
)
RENDER_MODES = ("human", "ansi", "rgb_array")

FloatArray = npt.NDArray[np.float32]


class Episodes:
    """Episodes of a scenario in a batch that start and end together.

    Args:
        scenario: a `Scenario`, a bundled name or a path.
        num_envs: environments in the batch.
        render_mode: one of `RENDER_MODES`, or None.

    Attributes:
        world: the world.
        observation_space, action_space: of one AUV.
        state_space: of the vector for central critics.

    Raises:
        InputError: no such scenario, a fault in it, or an unknown render mode.
    """

    def __init__(
        self, scenario: str | Path | Scenario, num_envs: int = 1, render_mode: str | None = None
    ) -> None:
        if render_mode is not None and render_mode not in RENDER_MODES:
            raise InputError(f"render_mode must be one of {RENDER_MODES} or None")
        self.render_mode = render_mode
        self.scenario = load_scenario(scenario)
        self.world = World(self.scenario, num_envs)
        self._num_envs = num_envs
        self._play: Play | None = None
        self.mask_place = self.scenario.observation.action_mask
        self._sizes = np.array(self.world.action_sizes)
        self._check = ActionCheck(num_envs, self.world.num_auvs, self.world.action_sizes)
        self.action_space = self.action_space_for(num_auvs=1)
        self.state_space = box(self.world.observer.state_ranges)
        self.vector_space = box(self.world.observer.agent_ranges)
        self.mask_space = spaces.MultiBinary(sum(self.world.action_sizes))
        self.observation_space: spaces.Space[Any] = (
            spaces.Dict({"observation": self.vector_space, "action_mask": self.mask_space})
            if self.mask_place == "observation"
            else self.vector_space
        )
        self._rngs: list[np.random.Generator] = []
        self._layout: npt.NDArray[np.int64] | None = None

    def __getstate__(self) -> dict[str, Any]:
        # A world holds its array library, which cannot be copied, nor can a function made
        # of it; but they hold nothing that changes, either.
        state = {**vars(self), "world": None, "_play": None}
        return state | {"_played": self._play and (self._play.state, self._play.events)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        played = state.pop("_played")
        vars(self).update(state)
        self.world = World(self.scenario, self._num_envs)
        if played:
            self._play = self._play_from(*played)

    def _play_from(self, state: State, events: Events | None = None) -> Play:
        if self._num_envs > 1 or not pays_unrolled(self.scenario):
            return BatchedPlay(self.world, state, events)
        slot = unrolled_slot(self.scenario, with_mask=self.mask_place != "none")
        return UnrolledPlay(slot, self.world, state, events)

    def reset(self, seeds: Sequence[int | None] | None = None) -> None:
        """Start the next episode of every environment.

        Args:
            seeds: a seed for each environment, or None to draw on from its stream. The
                first reset, and any with a seed, starts a stream; without a seed then
                from the operating system's entropy.
        """
        seeds = [None] * self.world.num_envs if seeds is None else list(seeds)
        if not self._rngs:
            self._rngs = [np.random.default_rng() for _ in seeds]
        reseeded = [i for i, seed in enumerate(seeds) if seed is not None]
        for i in reseeded:
            self._rngs[i] = np.random.default_rng(seeds[i])
        if self._layout is None or redraws_every_episode(self.scenario):
            self._layout = node_codes(self.scenario, self.world.grid, self._rngs)
        elif reseeded:
            self._layout = self._layout.copy()
            self._layout[reseeded] = node_codes(
                self.scenario, self.world.grid, [self._rngs[i] for i in reseeded]
            )
        self._play = self._play_from(self.world.reset(self._layout))
        self._show()

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
        return self._playing.state

    @property
    def _playing(self) -> Play:
        if self._play is None:
            raise RuntimeError("call reset() first")
        return self._play

    def step(self, action: npt.ArrayLike) -> npt.NDArray[np.float64]:
        """One slot of every environment.

        Args:
            action: (envs, auvs, entries) integers.

        Returns:
            (envs, auvs) rewards.

        Raises:
            ValueError: an action lies outside its space.
            RuntimeError: the episode is over, or has not begun.
        """
        play = self._playing
        if self.is_over:
            raise RuntimeError("the episode is over: call reset() first")
        reward = play.step(self._check(action))
        self._show()
        return reward

    @property
    def is_over(self) -> bool:
        """Whether the episodes have reached their time limit."""
        return self._slots_over >= self.world.num_slots

    @property
    def _slots_over(self) -> int:
        return int(self._playing.now("slot").item(0))

    def observe(self) -> FloatArray:
        """(envs, auvs, entries) observations, without masks; a fresh array each time."""
        return self._playing.observe()

    def masks(self) -> npt.NDArray[np.int8]:
        """(envs, auvs, choices): 1 for each sensible choice."""
        return self._playing.masks()

    def observe_globally(self) -> FloatArray:
        """(envs, entries): the vectors for central critics."""
        return self.world.observer.observe_globally(self.current).astype(np.float32, order="C")

    def info(self) -> dict[str, npt.NDArray[np.float64]]:
        """What infos tell, by `INFO_KEYS`: (envs,) each, or (envs, auvs) of an AUV's own.

        Of now: `mean_aoi`, the mean age over nodes. Of the episode so far:
        `time_mean_aoi`, the mean of that over its slots (what an evaluation calls
        `mean_aoi`); `peak_aoi`, the highest age of any node; `jain`; `total_harvested_j`,
        `total_spent_j` of all nodes; `age_violations`. Of an AUV in the last slot:
        `harvested_j`, the energy that it brought to a node; `delivered`, 1 if it received
        a packet; `beta` (0 in FDD). Before the first slot these are 0.
        """
        now, slot = self._playing.now, self._slots_over
        none = np.zeros((self.world.num_envs, self.world.num_auvs))
        last = self._playing.last if slot else lambda _: none
        return {
            "mean_aoi": now("mean_age"),
            "time_mean_aoi": now("age_sum") / slot if slot else now("mean_age"),
            "peak_aoi": now("peak_age"),
            "jain": now("jain"),
            "harvested_j": last("harvested_j"),
            "total_harvested_j": now("harvested_j"),
            "total_spent_j": now("spent_j"),
            "delivered": last("delivered"),
            "beta": last("beta"),
            "age_violations": now("capped_ages"),
        }

    def render(self, env: int = 0) -> str | npt.NDArray[np.uint8] | None:
        """The picture that `render_mode` names: text, (height, width, 3) pixels, or None."""
        if self.render_mode in (None, "human"):
            return None
        snapshot = Snapshot.of(self.world, self.current, self._playing.events, env)
        return as_text(snapshot) if self.render_mode == "ansi" else as_picture(snapshot)

    def _show(self) -> None:
        """In mode `human`, print every environment to the terminal."""
        if self.render_mode == "human":
            for env in range(self.world.num_envs):
                snapshot = Snapshot.of(self.world, self.current, self._playing.events, env)
                print_text(as_text(snapshot))


def box(ranges: Ranges) -> spaces.Box:
    """A float32 box that holds whatever lies within the ranges in float64."""
    low, high = ranges.low.astype(np.float32), ranges.high.astype(np.float32)
    low = np.where(low > ranges.low, np.nextafter(low, np.float32(-np.inf)), low)
    high = np.where(high < ranges.high, np.nextafter(high, np.float32(np.inf)), high)
    return spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
