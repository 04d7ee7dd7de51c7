"""Runs the policy in the batched world and keeps what it saw."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from iout_marl.metrics import described
from iout_marl.scenario import Scenario
from iout_marl.world import State, World, node_codes, redraws_every_episode
from trainers.graphs import Graph, Recorded, write_over
from trainers.group import Group
from trainers.laps import Laps
from trainers.networks import ActorCritic, uniform_noise

#: Where the world runs on NumPy; elsewhere on torch.
NUMPY_DEVICES = ("cpu",)
#: Of which the critic judges all environments in one go: what a processor's cache holds.
_SLOTS_AT_ONCE = 10


@dataclass
class Rollout:
    """A rollout, (slots, envs, auvs, …) each; `truncated` is (slots,).

    With several policies side by side there is one axis more: (slots, replicas, envs, …).
    All environments start and end their episodes together, so that one flag a slot
    tells of all of them. Where slots are recorded, the next rollout is written over it.
    """

    observation: Tensor  # (slots, envs, auvs, entries) float32, as the world gives it
    privileged: Tensor | None  # (slots, envs, auvs, entries) float32, for the critic alone
    inputs: Tensor  # (slots, envs, auvs, entries) float32, scaled as the policy saw it
    critic_inputs: Tensor  # (slots, envs, auvs, entries) float32, scaled as the critic saw it
    mask: Tensor | None  # (slots, envs, auvs, choices) bool, where masks are in use
    action: Tensor  # (slots, envs, auvs, entries) int64
    log_probability: Tensor  # (slots, envs, auvs) float32
    value: Tensor  # (slots, envs, auvs) float32
    reward: Tensor  # (slots, envs, auvs) float32, as the world gives it
    truncated: Tensor  # (slots,) bool: the episode ended with this slot
    next_value: Tensor  # (slots, envs, auvs): value of what followed the slot
    episodes: list[dict[str, Tensor]] = field(default_factory=list)  # metrics: mean over envs
    reward_terms: dict[str, Tensor] = field(default_factory=dict)  # mean of each term a slot

    def log(self) -> dict[str, Tensor]:
        """Means of the episodes that ended, and of the rewards, by TensorBoard tag: () each."""
        log = {
            described(name).tag: torch.stack([e[name] for e in self.episodes]).mean(0)
            for name in (self.episodes[0] if self.episodes else ())
        }
        log |= {f"reward/{name}": value for name, value in self.reward_terms.items()}
        log[described("reward").tag] = torch.stack(list(self.reward_terms.values())).sum(0)
        return log


@dataclass
class _Course:
    """What the slots of a rollout read and write; recorded, they do so again and again."""

    rollout: Rollout
    noise: Tensor  # (slots, envs, auvs, action entries): chooses the actions
    row: Tensor  # (1,) int64: the slot that comes next, where slots are recorded
    totals: dict[str, Any] = field(default_factory=dict)  # sum of each reward term, (envs, auvs)
    play: Recorded[None] | None = None  # that slot
    judge: Recorded[None] | None = None  # what is left to do when the slots are over

    def begin_again(self, noise: Tensor) -> None:
        """Make it as good as new, in the same memory, for a rollout with this noise."""
        self.noise.copy_(noise)
        self.row.zero_()
        self.rollout.truncated.zero_()
        self.rollout.episodes = []
        for total in self.totals.values():
            total.zero_()


class Simulation:
    """The batched world, its state, and the streams that it draws from.

    On a CPU the world runs on NumPy, which shares its memory with torch and handles
    small arrays in less time; on an accelerator it runs on torch, where the networks are.

    Args:
        scenarios: the scenario of each policy: the same one, but for layouts that are drawn
            once for a run.
        num_envs: environments side by side, for each policy.
        device: where the networks are.
        seeds: of each policy; seed its layouts and actions.
        group: who shares the environments. Everyone draws for all of them, so that it does
            not matter how many share.
        new_graph: makes what slots are recorded in, each graph for one function; None to run
            them as they are.
    """

    def __init__(
        self,
        scenarios: Sequence[Scenario],
        num_envs: int,
        device: torch.device,
        seeds: Sequence[int],
        group: Group | None = None,
        new_graph: Callable[[], Graph] | None = None,
    ) -> None:
        self.device = device
        self.group = group or Group()
        self._scenarios = scenarios
        self.num_envs = num_envs
        self._own = self.group.share(num_envs)
        own_envs = len(range(num_envs)[self._own])
        #: Axis of the policies, where there are several.
        self.replicas = (len(seeds),) if len(seeds) > 1 else ()
        self._shape = (*self.replicas, own_envs)
        on_numpy = device.type in NUMPY_DEVICES
        self.world = World(
            scenarios[0],
            len(seeds) * own_envs,
            library=np if on_numpy else torch,
            dtype="float32",
            device=None if on_numpy else device,
        )
        self.layout_rngs = [np.random.default_rng(seed) for seed in seeds]
        self.generators = [torch.Generator(device).manual_seed(seed) for seed in seeds]
        self._is_central = scenarios[0].training.critic == "central"
        self._redraws = redraws_every_episode(scenarios[0])
        self._new_graph = new_graph if self.world.backend.xp is not np else None
        self._courses: dict[tuple[ActorCritic, int, bool], _Course] = {}
        self.state = self._apart(self._first_state())
        self._slot = 0

    def _apart(self, state: State) -> State:
        """The state; where slots are recorded, in memory of its own for each field."""
        return state if self._new_graph is None else state.map(torch.clone)

    def _go_on_from(self, state: State) -> None:
        """Make it the present state; where slots are recorded, in the same memory as ever."""
        if self._new_graph is None:
            self.state = state
            return
        write_over(self.state, state)

    def _first_state(self, previous: State | None = None) -> State:
        if previous is not None and not self._redraws:
            return self.world.reset(previous.node_cell)
        codes = [
            node_codes(scenario, self.world.grid, [rng] * self.num_envs)[self._own]
            for scenario, rng in zip(self._scenarios, self.layout_rngs, strict=True)
        ]
        return self.world.reset(self._brought(np.concatenate(codes)))

    def _brought(self, array: npt.NDArray[Any]) -> Any:
        """An array as the world takes it; to a GPU without waiting for what runs there."""
        if self.device.type != "cuda":
            return array
        return torch.from_numpy(array).pin_memory().to(self.device, non_blocking=True)

    def _tensor(self, array: Any, dtype: torch.dtype | None = None) -> Tensor:
        """(…) for (replicas · envs, …), as (replicas, envs, …) where there are several."""
        tensor = torch.as_tensor(array, dtype=dtype, device=self.device)
        return tensor.reshape(*self._shape, *tensor.shape[1:]) if self.replicas else tensor

    def observe(self) -> Tensor:
        """(envs, auvs, entries) float32."""
        return self._tensor(self.world.observe(self.state), torch.float32)

    def observe_for_critic(self) -> Tensor | None:
        """(envs, auvs, entries) float32 that the critic alone sees."""
        seen = self.world.observer.observe_for_critic(self.state, central=self._is_central)
        return None if seen is None else self._tensor(seen, torch.float32)

    def value(self, network: ActorCritic) -> Tensor:
        """Value of the present state to every AUV, (envs, auvs)."""
        inputs = network.scaler(self.observe())
        return network.value(network.critic_inputs(inputs, self.observe_for_critic()))

    def uniform_noise(self, slots: int) -> Tensor:
        """What chooses the actions: (slots, envs, auvs, action entries) of (0, 1]."""
        shape = (slots, self.num_envs, self.world.num_auvs, len(self.world.action_sizes))
        noise = [uniform_noise(shape, generator)[:, self._own] for generator in self.generators]
        return torch.stack(noise, dim=1) if self.replicas else noise[0]

    @torch.no_grad()
    def collect(
        self, network: ActorCritic, slots: int, *, use_mask: bool, laps: Laps | None = None
    ) -> Rollout:
        """Run the policy for `slots` slots of every environment.

        Args:
            network: the policy, or all of them.
            slots: how long.
            use_mask: keep to the actions that the world's mask allows.
            laps: books the time under `environment`, `inference` and `rollout`, the rest.
        """
        world, laps = self.world, laps or Laps()
        course = self._begun(network, slots, use_mask=use_mask)
        rollout = course.rollout
        values_at_end: dict[int, Tensor] = {}
        laps("rollout")
        for t in range(slots):
            if course.play is None:
                self.state = self._play(network, course, t, laps)
            else:
                course.play()
                laps("rollout")
            self._slot += 1
            if self._slot >= world.num_slots:
                # Filled in where it is: a number written by its index would be brought there.
                rollout.truncated[t].fill_(1)
                # A time limit is no end of the task: what lies beyond it still counts.
                values_at_end[t] = self.value(network)
                rollout.episodes.append(self._means(world.metrics(self.state)))
                self._go_on_from(self._first_state(self.state))
                self._slot = 0
                laps("rollout")
        if course.judge is None:
            self._judge(network, rollout)
        else:
            course.judge()
        laps("inference")
        if self._slot > 0:
            values_at_end[slots - 1] = self.value(network)
        for t, value in values_at_end.items():
            rollout.next_value[t] = value
        rollout.reward_terms = {k: v / slots for k, v in self._means(course.totals).items()}
        laps("rollout")
        return rollout

    def _begun(self, network: ActorCritic, slots: int, *, use_mask: bool) -> _Course:
        """Room for a rollout, and its noise; where slots are recorded, the same room as ever."""
        noise = self.uniform_noise(slots)
        key = (network, slots, use_mask)
        if key in self._courses:
            self._courses[key].begin_again(noise)
            return self._courses[key]
        row = torch.zeros(1, dtype=torch.int64, device=self.device)
        course = _Course(self._empty(slots, use_mask=use_mask), noise, row)
        if self._new_graph is not None:
            play = partial(self._play_next, network, course)
            judge = partial(self._judge, network, course.rollout)
            course.play = Recorded(play, self._new_graph())
            course.judge = Recorded(judge, self._new_graph())
            self._courses[key] = course
        return course

    def _play_next(self, network: ActorCritic, course: _Course) -> None:
        """The slot that comes next, the same operations for each."""
        self._go_on_from(self._play(network, course, course.row, Laps()))
        course.row += 1

    def _empty(self, slots: int, *, use_mask: bool) -> Rollout:
        """Room for a rollout."""
        world = self.world
        shape = (slots, *self._shape, world.num_auvs)

        def empty(*entries: int, dtype: torch.dtype = torch.float32) -> Tensor:
            return torch.empty(*shape, *entries, dtype=dtype, device=self.device)

        observed = self.observe().shape[-1]
        inputs = empty(observed)
        seen = self.observe_for_critic()
        return Rollout(
            observation=empty(observed),
            privileged=None if seen is None else empty(seen.shape[-1]),
            inputs=inputs,
            critic_inputs=inputs if seen is None else empty(observed + seen.shape[-1]),
            mask=empty(sum(world.action_sizes), dtype=torch.bool) if use_mask else None,
            action=empty(len(world.action_sizes), dtype=torch.int64),
            log_probability=empty(),
            value=empty(),
            reward=empty(),
            truncated=torch.zeros(slots, dtype=torch.bool, device=self.device),
            next_value=empty(),
        )

    def _play(self, network: ActorCritic, course: _Course, t: int | Tensor, laps: Laps) -> State:
        """One slot, written to row `t` of the rollout: the state after it.

        Args:
            network: the policy, or all of them.
            course: the rollout, and what is drawn for it.
            t: which slot of it; where one recording serves all, (1,) int64 on the device.
            laps: books the time.
        """
        world, rollout = self.world, course.rollout
        observation = self.observe()
        seen = self.observe_for_critic()
        mask = None if rollout.mask is None else self._tensor(world.action_mask(self.state))
        laps("environment")
        scaled = network.scaler(observation)
        scores = network.scores(scaled, mask)
        action, log_probability = network.sample(scores, _row(course.noise, t))
        _write(rollout.log_probability, t, log_probability)
        laps("inference")
        _write(rollout.inputs, t, scaled)
        _write(rollout.observation, t, observation)
        _write(rollout.action, t, action)
        if rollout.privileged is not None and seen is not None:
            _write(rollout.privileged, t, seen)
        if rollout.mask is not None and mask is not None:
            _write(rollout.mask, t, mask)
        laps("rollout")
        world_action = action.reshape(world.num_envs, *action.shape[-2:])
        state, events = world.step(
            self.state, world_action.numpy() if world.backend.xp is np else world_action
        )
        terms = world.reward_terms(state, events)
        _write(rollout.reward, t, self._tensor(world.total_reward(terms)))
        for name, term in terms.items():
            if name in course.totals:
                course.totals[name] += term
            else:
                course.totals[name] = term + 0.0
        laps("environment")
        return state

    def _judge(self, network: ActorCritic, rollout: Rollout) -> None:
        """Fill in what the critic sees, its values, and those of what followed each slot.

        The latter but for the last slot, and as if no episode had ended.
        """
        if rollout.privileged is not None:
            seen = self.policies_first(rollout.privileged)
            inputs = network.critic_inputs(self.policies_first(rollout.inputs), seen)
            rollout.critic_inputs.copy_(self.policies_first(inputs))
        for first in range(0, len(rollout.value), _SLOTS_AT_ONCE):
            slots = slice(first, first + _SLOTS_AT_ONCE)
            value = network.value(self.policies_first(rollout.critic_inputs[slots]))
            rollout.value[slots] = self.policies_first(value)
        rollout.next_value[:-1] = rollout.value[1:]

    def policies_first(self, values: Tensor) -> Tensor:
        """(slots, replicas, …) as (replicas, slots, …), and back; as it is for a lone policy."""
        return values.movedim(1, 0) if self.replicas else values

    def _means(self, values: Mapping[str, Any]) -> dict[str, Tensor]:
        """Mean of each of the world's (envs, …) arrays over all environments: ()."""
        axes = len(self.replicas)
        own = [self._tensor(array).flatten(axes).mean(-1) for array in values.values()]
        means = self.group.sum(torch.stack(own) / self.group.size)
        return dict(zip(values, means, strict=True))

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """State and streams of one policy's environments, as tensors and plain values.

        All of a group have to ask together; they get the same.
        """
        policies = (len(self.generators), self._shape[-1])
        tensors = {k: torch.as_tensor(array) for k, array in self.state._asdict().items()}
        whole = {
            name: self.group.join(t.reshape(*policies, *t.shape[1:])[policy].clone()).cpu()
            for name, t in tensors.items()
        }
        sums = whole.pop("sums").unbind(-1)
        names = [metric.name for metric in self.world.summed]
        return {
            "state": whole,
            **({"sums": dict(zip(names, sums, strict=True))} if names else {}),
            "layout_rng": self.layout_rngs[policy].bit_generator.state,
            "generator": self.generators[policy].get_state(),
        }

    def load_state_dict(self, saved: Sequence[dict[str, Any]]) -> None:
        """Go on from the `state_dict` of each policy.

        Of metrics that were not summed when it was made, the sums begin at 0.
        """
        states = [one["state"] | {"sums": self._sums_of(one)} for one in saved]
        joined = State(*(torch.cat([s[name][self._own] for s in states]) for name in State._fields))
        if self.world.backend.xp is np:
            state = joined.map(lambda tensor: tensor.numpy())
        else:
            state = joined.map(lambda tensor: tensor.to(self.device))
        self._go_on_from(state.map(self.world.backend.with_envs_inside))
        self._slot = int(self.state.slot[0])
        for one, rng, generator in zip(saved, self.layout_rngs, self.generators, strict=True):
            rng.bit_generator.state = one["layout_rng"]
            generator.set_state(one["generator"])

    def _sums_of(self, saved: dict[str, Any]) -> Tensor:
        none = torch.zeros_like(saved["state"]["mean_age"])
        sums = [saved.get("sums", {}).get(m.name, none) for m in self.world.summed]
        return torch.stack(sums, dim=-1) if sums else none[:, None][:, :0]


def _row(rows: Tensor, t: int | Tensor) -> Tensor:
    """The row at a number, or at a (1,) tensor."""
    return rows[t] if isinstance(t, int) else rows.index_select(0, t)[0]


def _write(rows: Tensor, t: int | Tensor, values: Tensor) -> None:
    """Write the row at a number, or at a (1,) tensor."""
    if isinstance(t, int):
        rows[t] = values
    else:
        rows.index_copy_(0, t, values[None])
