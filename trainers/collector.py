"""Runs the policy in the batched world and keeps what it saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from iout_marl.compiled import WorldPlayer
from iout_marl.core.chance import Draw
from iout_marl.core.state import SEA_FIELDS, STORE_FIELDS, TRANSIT_FIELDS, VEHICLE_FIELDS
from iout_marl.scenario import Scenario
from iout_marl.world import Chance, State, World, node_codes, redraws_every_episode
from iout_marl.world.chance import completed, first_of_current
from trainers.accel import Runtime
from trainers.accel.graphs import write_over
from trainers.imitation import Teacher
from trainers.networks import ActorCritic, uniform_noise
from trainers.rollout import Rollout, RolloutStorage, policies_first
from trainers.timing import PhaseTimer

#: Where the world runs on NumPy; elsewhere on torch.
NUMPY_DEVICES = ("cpu",)
#: Slots whose values the critic computes at once, of all environments: what a cache holds.
_SLOTS_AT_ONCE = 10


@dataclass
class _CapturedSlots:
    """Where slots are captured: the memory that they work in, and what is replayed."""

    storage: RolloutStorage
    collect_slot: Any  # the slot that comes next, the same operations for each
    compute_values: Any  # what is left to do when the slots are over


class Collector:
    """The batched world, its state, and the streams that it draws from.

    On a CPU the world runs on NumPy, which shares its memory with torch and handles
    small arrays in less time; on an accelerator it runs on torch, where the networks are.
    It computes in float32, where environments and evaluation take float64.

    Args:
        scenarios: the scenario of each policy: the same one, but for layouts that are drawn
            once for a run.
        num_envs: environments side by side, for each policy.
        seeds: of each policy; seed its layouts and actions.
        runtime: who shares the environments. Every process draws for all of them, so that it
            does not matter how many share.
        streams: whose streams to draw from, in the place of streams of its own.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        num_envs: int,
        seeds: Sequence[int],
        runtime: Runtime,
        streams: Collector | None = None,
    ) -> None:
        self.device, self._group = runtime.device, runtime.group
        self._runtime = runtime
        self._scenarios = scenarios
        self.num_envs = num_envs
        self._own = self._group.share(num_envs)
        #: Policies, and this process's environments of each.
        self.shape = (len(seeds), len(range(num_envs)[self._own]))
        on_numpy = self.device.type in NUMPY_DEVICES
        self.world = World(
            scenarios[0],
            self.shape[0] * self.shape[1],
            library=np if on_numpy else torch,
            dtype="float32",
            device=None if on_numpy else self.device,
        )
        self._player = WorldPlayer(self.world, with_mask=scenarios[0].training.mask_actions)
        self.layout_rngs = [np.random.default_rng(seed) for seed in seeds]
        self.generators = [torch.Generator(self.device).manual_seed(seed) for seed in seeds]
        self._is_central = scenarios[0].training.critic == "central"
        self._redraws = redraws_every_episode(scenarios[0])
        self._captures = runtime.captures and not on_numpy
        self._captured: dict[tuple[ActorCritic, int, bool], _CapturedSlots] = {}
        state = self._first_state()
        # Where slots are captured, each field has memory of its own.
        self.state = state.map(torch.clone) if self._captures else state
        self._slot = 0
        if streams is not None:
            self.layout_rngs, self.generators = streams.layout_rngs, streams.generators

    def restart(self) -> None:
        """Begin new episodes, whatever was played before."""
        self._set_state(self._first_state())
        self._slot = 0

    def _set_state(self, state: State) -> None:
        """Make it the present state; where slots are captured, in the memory of the one before."""
        if self._captures:
            write_over(self.state, state)
        else:
            self.state = state

    def _first_state(self, previous: State | None = None) -> State:
        if previous is not None and not self._redraws:
            return self.world.reset(previous.node_cell, current=self._first_of_current())
        codes = [
            node_codes(scenario, self.world.grid, [rng] * self.num_envs)[self._own]
            for scenario, rng in zip(self._scenarios, self.layout_rngs, strict=True)
        ]
        cells = self._to_device(np.concatenate(codes))
        return self.world.reset(cells, current=self._first_of_current())

    def _first_of_current(self) -> Any:
        """What the current of each environment begins with, where that is left to chance."""
        if not self.world.chance:
            return None
        drawn = [
            first_of_current(scenario, [rng] * self.num_envs)
            for scenario, rng in zip(self._scenarios, self.layout_rngs, strict=True)
        ]
        found = [numbers[self._own] for numbers in drawn if numbers is not None]
        return self._to_device(np.concatenate(found)) if found else None

    def _to_device(self, array: npt.NDArray[Any]) -> Any:
        """An array as the world takes it; to a GPU without waiting for what runs there."""
        if self.device.type != "cuda":
            return array
        return torch.from_numpy(array).pin_memory().to(self.device, non_blocking=True)

    def _tensor(self, array: Any, dtype: torch.dtype | None = None) -> Tensor:
        """The world's (policies · envs, …) as (policies, envs, …)."""
        tensor = torch.as_tensor(array, dtype=dtype, device=self.device)
        return tensor.reshape(*self.shape, *tensor.shape[1:])

    def observe(self) -> Tensor:
        """(policies, envs, auvs, entries) float32."""
        return self._tensor(self._player.observe(self.state), torch.float32)

    def observe_for_critic(self) -> Tensor | None:
        """(policies, envs, auvs, entries) float32 that the critic alone sees."""
        seen = self.world.observer.observe_for_critic(self.state, central=self._is_central)
        return None if seen is None else self._tensor(seen, torch.float32)

    def value(self, network: ActorCritic) -> Tensor:
        """Value of the present state to every AUV, (policies, envs, auvs)."""
        inputs = network.scaler(self.observe())
        return network.value(network.critic_inputs(inputs, self.observe_for_critic()))

    def uniform_noise(self, slots: int) -> Tensor:
        """What chooses the actions: (slots, policies, envs, auvs, action entries) of (0, 1]."""
        shape = (slots, self.num_envs, self.world.num_auvs, len(self.world.action_sizes))
        noise = [uniform_noise(shape, generator)[:, self._own] for generator in self.generators]
        return torch.stack(noise, dim=1)

    def draw_chance(self, slots: int) -> dict[str, Tensor]:
        """What slots leave to chance, by field of `Chance`: (slots, policies, envs, …) each."""
        return {
            name: torch.stack(
                [_drawn(draw, (slots, self.num_envs), g)[:, self._own] for g in self.generators],
                dim=1,
            )
            for name, draw in self.world.chance.items()
        }

    @torch.no_grad()
    def collect(
        self,
        network: ActorCritic,
        slots: int,
        *,
        use_mask: bool,
        timer: PhaseTimer | None = None,
        teacher: Teacher | None = None,
    ) -> Rollout:
        """Run the policy for `slots` slots of every environment.

        Args:
            network: the policies, stacked.
            slots: how long.
            use_mask: keep to the actions that the world's mask allows.
            timer: books the time to `environment`, `inference` and `rollout`, the rest.
            teacher: whose actions are kept, and mostly played, in place of the policy's.
        """
        world, timer = self.world, timer or PhaseTimer()
        is_shown = teacher is not None
        storage, captured = self._allocate(network, slots, use_mask=use_mask, is_shown=is_shown)
        rollout = storage.rollout
        values_at_end: dict[int, Tensor] = {}
        timer("rollout")
        for t in range(slots):
            if captured is None:
                self.state = self._collect_slot(network, storage, t, timer, teacher)
            else:
                captured.collect_slot()
                timer("rollout")
            self._slot += 1
            if self._slot >= world.num_slots:
                # Filled in where it is: a number written by its index would be brought there.
                rollout.truncated[t].fill_(1)
                # A time limit is no end of the task: what lies beyond it still counts.
                values_at_end[t] = self.value(network)
                rollout.episodes.append(self._means(world.metrics(self.state)))
                self._set_state(self._first_state(self.state))
                self._slot = 0
                timer("rollout")
        if captured is None:
            self._compute_values(network, rollout)
        else:
            captured.compute_values()
        timer("inference")
        if self._slot > 0:
            values_at_end[slots - 1] = self.value(network)
        for t, value in values_at_end.items():
            rollout.next_value[t] = value
        rollout.reward_terms = {k: v / slots for k, v in self._means(storage.totals).items()}
        timer("rollout")
        return rollout

    def _allocate(
        self, network: ActorCritic, slots: int, *, use_mask: bool, is_shown: bool
    ) -> tuple[RolloutStorage, _CapturedSlots | None]:
        """Memory for a rollout, with its noise; where slots are captured, always the same."""
        noise, chance = self.uniform_noise(slots), self.draw_chance(slots)
        key = (network, slots, use_mask)
        if key in self._captured:
            captured = self._captured[key]
            captured.storage.restart(noise, chance)
            return captured.storage, captured
        observer = self.world.observer
        privileged = observer.critic_ranges(central=self._is_central)
        storage = RolloutStorage.allocate(
            (slots, *self.shape, self.world.num_auvs),
            noise,
            entries=len(observer.agent_ranges.low),
            privileged=0 if privileged is None else len(privileged.low),
            choices=sum(self.world.action_sizes),
            keep_observations=network.scaler.running,
            use_mask=use_mask,
            is_shown=is_shown,
            chance=chance,
        )
        if not self._captures:
            return storage, None
        captured = self._captured[key] = _CapturedSlots(
            storage,
            self._runtime.capture(partial(self._collect_next, network, storage)),
            self._runtime.capture(partial(self._compute_values, network, storage.rollout)),
        )
        return storage, captured

    def _collect_next(self, network: ActorCritic, storage: RolloutStorage) -> None:
        """The slot that comes next, the same operations for each."""
        self._set_state(self._collect_slot(network, storage, storage.row, PhaseTimer()))
        storage.row += 1

    def _collect_slot(
        self,
        network: ActorCritic,
        storage: RolloutStorage,
        t: int | Tensor,
        timer: PhaseTimer,
        teacher: Teacher | None = None,
    ) -> State:
        """One slot, written to row `t` of the rollout: the state after it.

        Args:
            network: the policies.
            storage: the rollout, and what is drawn for it.
            t: which slot of it; where one capture serves all, (1,) int64 on the device.
            timer: books the time.
            teacher: as for `collect`.
        """
        world = self.world
        observation = self.observe()
        privileged = self.observe_for_critic()
        use_mask = storage.rollout.mask is not None
        mask = self._tensor(self._player.action_mask(self.state)) if use_mask else None
        timer("environment")
        inputs = network.scaler(observation)
        noise = storage.at(storage.noise, t)
        action, log_probability = network.act(inputs, mask, noise)
        played = action
        if teacher is not None:
            action, played = teacher.shows(self.state, action, self.num_envs, self._own)
        timer("inference")
        storage.write(
            t,
            observation=observation,
            privileged=privileged,
            inputs=inputs,
            mask=mask,
            action=action,
            log_probability=log_probability,
        )
        timer("rollout")
        world_action = played.reshape(world.num_envs, *played.shape[-2:])
        state, terms, reward = self._player.step(
            self.state,
            world_action.numpy() if world.backend.xp is np else world_action,
            self._chance(storage, t) if storage.chance else None,
        )
        storage.write(t, reward=self._tensor(reward))
        for name, term in terms.items():
            if name in storage.totals:
                storage.totals[name] += term
            else:
                storage.totals[name] = term + 0.0
        timer("environment")
        return state

    def _chance(self, storage: RolloutStorage, t: int | Tensor) -> Chance:
        """The chance of row `t` of a rollout, as the world takes it."""
        world = self.world
        drawn: dict[str, Any] = {
            name: storage.at(rows, t).reshape(world.num_envs, *rows.shape[3:])
            for name, rows in storage.chance.items()
        }
        if world.backend.xp is np:
            drawn = {name: rows.numpy() for name, rows in drawn.items()}
        laid = {name: world.backend.with_envs_inside(rows) for name, rows in drawn.items()}
        return completed(laid, world.backend, world.chance, world.num_envs)

    def _compute_values(self, network: ActorCritic, rollout: Rollout) -> None:
        """Fill in what the critic sees, its values, and those of what followed each slot.

        The latter but for the last slot, and as if no episode had ended.
        """
        if rollout.privileged is not None:
            seen = policies_first(rollout.privileged)
            inputs = network.critic_inputs(policies_first(rollout.inputs), seen)
            rollout.critic_inputs.copy_(policies_first(inputs))
        for first in range(0, len(rollout.value), _SLOTS_AT_ONCE):
            slots = slice(first, first + _SLOTS_AT_ONCE)
            value = network.value(policies_first(rollout.critic_inputs[slots]))
            rollout.value[slots] = policies_first(value)
        rollout.next_value[:-1] = rollout.value[1:]

    def _means(self, values: Mapping[str, Any]) -> dict[str, Tensor]:
        """Mean of each of the world's (envs, …) arrays over all environments: (policies,)."""
        own = [self._tensor(array).flatten(1).mean(-1) for array in values.values()]
        means = self._group.sum(torch.stack(own) / self._group.size)
        return dict(zip(values, means, strict=True))

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """State and streams of one policy's environments, as tensors and plain values.

        All of a group have to ask together; they get the same.
        """
        tensors = {k: torch.as_tensor(array) for k, array in self.state._asdict().items()}
        whole = {
            name: self._group.join(t.reshape(*self.shape, *t.shape[1:])[policy].clone()).cpu()
            for name, t in tensors.items()
        }
        sums = whole.pop("sums").unbind(-1)
        # Without what fields came for, states are those of versions before them.
        later = [] if self.world.storage.is_limited else list(STORE_FIELDS)
        if not self.world.vehicle.is_limited:
            later += VEHICLE_FIELDS
        if not self.world.may_be_idle:
            later.append("unasked")
        if not self.world.hearing.polls:
            later.append("polled")
        if not self.world.motion.takes_slots:
            later += TRANSIT_FIELDS
        later += [name for name in SEA_FIELDS if not getattr(self.state, name).shape[-1]]
        whole = {name: t for name, t in whole.items() if name not in later}
        names = [metric.name for metric in self.world.summed]
        return {
            "state": whole,
            **({"sums": dict(zip(names, sums, strict=True))} if names else {}),
            "layout_rng": self.layout_rngs[policy].bit_generator.state,
            "generator": self.generators[policy].get_state(),
        }

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """Continue from the `state_dict` of each policy.

        Of metrics that were not summed when it was made, the sums begin at 0.
        """
        states = [
            dict.fromkeys((*STORE_FIELDS, *VEHICLE_FIELDS), one["state"]["age"][:, :0])
            | {name: self._none_of(one) for name in ("unasked", "polled")}
            | dict.fromkeys(TRANSIT_FIELDS, one["state"]["cell"][:, :0])
            | self._sea_of(one)
            | one["state"]
            | {"sums": self._sums_of(one)}
            for one in saved
        ]
        joined = State(*(torch.cat([s[name][self._own] for s in states]) for name in State._fields))
        if self.world.backend.xp is np:
            state = joined.map(lambda tensor: tensor.numpy())
        else:
            state = joined.map(lambda tensor: tensor.to(self.device))
        self._set_state(state.map(self.world.backend.with_envs_inside))
        self._slot = int(self.state.slot[0])
        for one, rng, generator in zip(saved, self.layout_rngs, self.generators, strict=True):
            rng.bit_generator.state = one["layout_rng"]
            generator.set_state(one["generator"])

    def _sums_of(self, saved: dict[str, Any]) -> Tensor:
        none = torch.zeros_like(saved["state"]["mean_age"])
        sums = [saved.get("sums", {}).get(m.name, none) for m in self.world.summed]
        return torch.stack(sums, dim=-1) if sums else self._none_of(saved)

    def _sea_of(self, saved: dict[str, Any]) -> dict[str, Tensor]:
        """How the sea differs from its median: not at all, in states that do not say."""
        age, auvs = saved["state"]["age"], self.world.num_auvs
        empty = {name: self._none_of(saved) for name in SEA_FIELDS}
        return empty | {"gain_db": age.new_empty((len(age), auvs, 0))}

    @staticmethod
    def _none_of(saved: dict[str, Any]) -> Tensor:
        """No columns, (envs, 0): of what there was not when it was made."""
        return torch.zeros_like(saved["state"]["mean_age"])[:, None][:, :0]


def _drawn(draw: Draw, shape: tuple[int, ...], generator: torch.Generator) -> Tensor:
    """Numbers of a distribution, shape and then that of `draw`, on the generator's device."""
    make = torch.randn if draw.distribution == "normal" else torch.rand
    return make(*shape, *draw.shape, generator=generator, device=generator.device)
