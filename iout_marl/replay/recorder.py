"""Records an episode while it is played."""

from __future__ import annotations

from typing import Any

import numpy as np

from iout_marl.core.reasons import Reason
from iout_marl.errors import InputError
from iout_marl.evaluation import play
from iout_marl.policies import AnyPolicy, Policy, policy_for
from iout_marl.render.snapshot import battery_shares, currents_at, docks_of, sleeping
from iout_marl.replay.recording import Recording
from iout_marl.scenario import AnyScenario, Overrides, load_scenario, to_yaml
from iout_marl.whole import seed_argument
from iout_marl.world import Events, State, World


class Recorder:
    """Takes the slots of one environment of a batch down, one after the other.

    Args:
        world: the world, on NumPy.
        state: the first state.
        policy: what to call whoever plays.
        seed: of the episode, where it is known.
        env: index of the environment.
    """

    def __init__(
        self, world: World, state: State, policy: str, seed: int | None = None, env: int = 0
    ) -> None:
        self._world, self._state, self._env = world, state, env
        self._policy, self._seed = policy, seed
        self._cells = world.grid.coordinate_table() + 1
        self._reasons: list[Reason] = []
        self._places = [self._place(state)]
        self._slots: list[dict[str, Any]] = []

    def _place(self, state: State) -> dict[str, Any]:
        env = self._env
        return {
            "path": self._cells[state.cell[env]],
            "ages": np.array(state.age[env], dtype=np.float64),
            "energy_j": np.array(state.energy_j[env], dtype=np.float64),
            **self._of_vehicles(state),
        }

    def _of_vehicles(self, state: State) -> dict[str, Any]:
        """What only some scenarios' AUVs have: a battery, a current, moves over several slots."""
        motion, env, found = self._world.motion, self._env, {}
        battery = battery_shares(self._world, state, env)
        if battery is not None:
            found["battery"] = battery
        currents = currents_at(self._world, state, env)
        if currents is not None:
            found["current_m_per_s"] = currents
        if motion.takes_slots:
            found["heading"] = self._cells[motion.heading(state)[env]]
            found["transit_slots"] = np.array(state.transit_slots[env])
        return found

    def add(self, events: Events, state: State) -> None:
        """Take a slot down.

        Args:
            events: what happened in it.
            state: the state after it.
        """
        world, env = self._world, self._env
        beta = np.array(events.beta[env], dtype=np.float64)
        charged, heard = (
            np.where(named == world.num_nodes, 0, named + 1)
            for named in (np.array(events.charged[env]), np.array(events.heard[env]))
        )
        polled = np.array(events.polled[env])
        asleep = sleeping(world, events, env)
        no_time = world.duplex.splits_slot & (beta == 0)
        own = {name: np.array(getattr(events, name)[env]) for name in _OF_EVENTS}
        self._slots.append(
            {
                **own,
                "charged": np.where(no_time, 0, charged),
                "heard": heard,
                "beta": beta,
                "outcome": [
                    self._number(reason)
                    for reason in world.outcomes(self._state, events, state)[env]
                ],
                "polled": np.where(polled == world.num_nodes, 0, polled + 1),
                "polled_outcome": np.reshape(
                    [
                        self._number(reason)
                        for row in world.polled_outcomes(self._state, events, state)[env]
                        for reason in row
                    ],
                    polled.shape,
                ).astype(np.int64),
                **({"asleep": asleep} if asleep is not None else {}),
                "rewards": np.array(world.reward(state, events)[env], dtype=np.float64),
            }
        )
        self._places.append(self._place(state))
        self._state = state

    def _number(self, reason: Reason | None) -> int:
        if reason is None:
            return 0
        if reason not in self._reasons:
            self._reasons.append(reason)
        return self._reasons.index(reason) + 1

    def recording(self) -> Recording:
        """What has been taken down so far.

        Raises:
            InputError: the scenario has numbers that are too large to compute with.
            RuntimeError: no slot has been played.
        """
        if not self._slots:
            raise RuntimeError("no slot has been played: there is nothing to record yet")
        world, scenario = self._world, self._world.scenario
        arrays = {
            name: np.array([each[name] for each in rows])
            for rows in (self._places, self._slots)
            for name in rows[0]
        }
        for name, values in arrays.items():
            if not np.isfinite(values).all():
                raise InputError(
                    f"{scenario.name}: {name} has numbers that are too large to compute with"
                )
        return Recording(
            scenario=scenario.name,
            scenario_hash=scenario.hash,
            scenario_yaml=to_yaml(scenario),
            policy=self._policy,
            seed=self._seed,
            grid=world.grid.shape,
            spacing_m=scenario.grid.spacing_m,
            slot_s=float(scenario.slot_s),
            num_slots=world.num_slots,
            maximum_age=float(scenario.age.maximum),
            reference_energy_j=float(world.representation.reference_energy_j),
            capacity_j=world.storage.capacity_j,
            ages_over_time=world.sampling.is_continuous,
            docks=docks_of(world),
            duplex=world.duplex.label,
            splits_slot=world.duplex.splits_slot,
            reasons=tuple(self._reasons),
            nodes=self._cells[self._state.node_cell[self._env]],
            **arrays,
        )


class FirstEpisode:
    """Records the first episode of a batch that `evaluate` plays, for its `observe`.

    Args:
        policy: what to call whoever plays.
        seed: of the first episode.
    """

    def __init__(self, policy: str, seed: int) -> None:
        self._policy, self._seed = policy, seed
        self._recorder: Recorder | None = None

    def __call__(self, world: World, state: State, events: Events | None) -> None:
        """Take down the first state of an episode, or a slot; as `evaluate` calls it."""
        # A world of one environment: why uplinks of others have failed, nobody asks.
        first = state.map(lambda array: array[:1])
        if events is None:
            self._recorder = Recorder(World(world.scenario), first, self._policy, self._seed)
        elif self._recorder is not None:
            self._recorder.add(Events(*(array[:1] for array in events)), first)

    def recording(self) -> Recording:
        """What has been taken down so far.

        Raises:
            InputError: as `Recorder.recording`.
            RuntimeError: no slot has been played.
        """
        if self._recorder is None:
            raise RuntimeError("no episode has begun: there is nothing to record yet")
        return self._recorder.recording()


#: Of the events, what is recorded as it is.
_OF_EVENTS = ("left_grid", "blocked", "harvested_j", "spent_j", "polled_j")


def record_policy(
    scenario: AnyScenario,
    policy: AnyPolicy,
    seed: int = 0,
    *,
    overrides: Overrides = None,
) -> Recording:
    """Play one episode, the first of those of `evaluate`, and record it.

    Args:
        scenario, policy, seed, overrides: as for `evaluate`.

    Raises:
        InputError, TypeError: as `evaluate` does.
    """
    seed = seed_argument(seed)
    found, player = policy_for(load_scenario(scenario, overrides), policy, seed)
    return record_player(found, player, seed)


def record_player(scenario: Any, player: Policy, seed: int, name: str = "") -> Recording:
    """`record_policy` of what `policy_for` has found.

    Args:
        scenario: the scenario that the policy plays.
        player: the policy.
        seed: of the episode.
        name: what to call it, if not by its own name.
    """
    world = World(scenario)
    slots = play(world, player, seed)
    state, _ = next(slots)
    recorder = Recorder(world, state, name or str(player.name), seed)
    with np.errstate(over="ignore", invalid="ignore"):
        for state, events in slots:
            assert events is not None
            recorder.add(events, state)
    return recorder.recording()
