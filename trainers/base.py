"""What a trainer is made of, and what it saves: all but the algorithm."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from pathlib import Path
from typing import Any
from weakref import WeakKeyDictionary

import torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.scenario import AnyScenario, Overrides, Scenario, Training, load_scenario
from iout_marl.whole import seed_argument, whole_argument
from iout_marl.world import pin_layout
from trainers.accel import Runtime
from trainers.accel.group import ProcessGroup
from trainers.collector import NUMPY_DEVICES, Collector
from trainers.factory import make_network
from trainers.imitation import Teacher
from trainers.memory import enough_memory
from trainers.minibatches import Minibatches
from trainers.networks import ActorCritic, stacked
from trainers.optimizers import make_optimizer
from trainers.over import Turn, Turns
from trainers.returns import RewardScale, standardised
from trainers.rollout import Rollout
from trainers.trained import TrainedPolicy


class BaseTrainer(ABC):
    """Trains one policy, shared by all AUVs, on a scenario; or several side by side.

    Args:
        scenario: whatever `load_scenario` takes; its `training` section has
            the settings. A layout that is drawn once for a run is drawn from the seed.
        seed: seeds weights, layouts, actions and minibatches; the i-th policy's is seed + i.
        device: where to train.
        replicas: how many policies.
        group: the processes that share the environments.
        use_graphs: capture the work as graphs, where the device can.
        overrides: changes of the scenario, as for `load_scenario`.
        network: in place of `training.network`: a kind, or a mapping with it.
        start: what the weights begin with: `pretrained`, or the folder of a run whose networks
            are for any size; see `trainers.starting`. None for random ones.

    Attributes:
        seeds: of each policy.
        scenarios: the scenario of each policy, its layout pinned.
        network: actor and critic, `stacked`.
        env_steps: environment steps taken so far, for each policy.

    Raises:
        InputError: no seed; settings that several policies or processes cannot be trained with,
            or that need more memory than there is; or a network or an optimizer that does not work.
    """

    @enough_memory()
    def __init__(
        self,
        scenario: AnyScenario,
        seed: int = 0,
        device: str | torch.device = "cpu",
        replicas: int = 1,
        group: ProcessGroup | None = None,
        *,
        use_graphs: bool = True,
        overrides: Overrides = None,
        network: str | dict[str, Any] | None = None,
        start: str | None = None,
    ) -> None:
        replicas = whole_argument("replicas", replicas, 1)
        seed = seed_argument(seed, replicas)
        weights = None
        if start is None:
            self.source = load_for_training(scenario, overrides, network)
        else:
            from trainers.starting import started_from  # reads runs, which are of trainers

            self.source, weights = started_from(start, scenario, overrides, network)
        self.settings: Training = self.source.training
        # Graphs are of one size.
        self.runtime = Runtime(device, group, use_graphs=use_graphs and not self.settings.over)
        self.runtime.check(self.settings, replicas)
        if self.settings.target_kl is not None and replicas > 1:
            raise InputError(
                "training.target_kl: policies trained side by side cannot stop their epochs "
                "apart; set it to null, or train them one after the other"
            )
        if self.settings.over and replicas > 1:
            raise InputError(
                "--replicas: policies side by side play the same scenario, which training.over "
                "draws; train them one after the other"
            )
        self.seeds = range(seed, seed + replicas)
        self.scenarios = [pin_layout(self.source, each) for each in self.seeds]
        self.collector = Collector(
            self.scenarios, self.settings.environments, self.seeds, self.runtime
        )
        world = self.collector.world
        self.network = stacked([self._make_network(each) for each in self.seeds])
        if weights is not None:
            for name, tensor in self.network.state_dict().items():
                tensor.copy_(weights[name])
        self.network.to(self.runtime.device)
        self.optimizer = make_optimizer(
            self.settings, [p for p in self.network.parameters() if p.requires_grad]
        )
        minibatches = Minibatches(
            self.settings, world.num_auvs, self.collector.generators, self.runtime
        )
        self.turn = Turn(self.collector, self.network, minibatches, self.settings.rollout_slots)
        self._turns = None
        if self.settings.over:
            self._turns = Turns(self.source, self.collector, self.network, seed, self.runtime)
        self.reward_scale = RewardScale(
            self.settings.reward_scaling, self.settings.discount, replicas, self.runtime
        )
        self._capture()
        self.env_steps = 0
        self._teachers: WeakKeyDictionary[Collector, Teacher] = WeakKeyDictionary()
        #: How many steps imitation takes: no more in a training that is resumed for longer.
        self._imitation_steps = self.settings.imitation_share * self.settings.steps
        #: What PPO plays, and what a teacher does: whole episodes, in minibatches of like size.
        self._turn_of_ppo = self._turn_of_teacher = self.turn
        if self.settings.imitate is not None:
            slots, settings = self.source.num_slots, self.settings
            parts = max(round(settings.minibatches * slots / settings.rollout_slots), 1)
            cut = Minibatches(
                settings.model_copy(update={"minibatches": parts}),
                world.num_auvs,
                self.collector.generators,
                self.runtime,
            )
            self._turn_of_teacher = self.turn._replace(minibatches=cut, slots=slots)

    def _make_network(self, seed: int) -> ActorCritic:
        world = self.collector.world
        # Weights come from torch's global generator, which is put back as it was.
        with torch.random.fork_rng(devices=[]):
            torch.default_generator.manual_seed(seed)
            return make_network(world.observer, world.action_sizes, self.settings)

    def _capture(self) -> None:
        """Capture learning, unless the host has a say in it."""
        is_captured = self.optimizer.can_be_captured and self.settings.target_kl is None
        self._captured_update = self.runtime.capture(self._update) if is_captured else self._update

    @property
    def scenario(self) -> Scenario:
        """The scenario of the first policy."""
        return self.scenarios[0]

    def next_turn(self) -> Turn:
        """What the next iteration plays: always the same, or what is drawn of `training.over`."""
        if self._turns is not None:
            return self._turns.next()
        return self._turn_of_teacher if self._imitates else self._turn_of_ppo

    def finish_turn(self, figures: dict[str, float]) -> dict[str, float]:
        """What else there is to log of the turn, by what is logged of it anyway."""
        return {} if self._turns is None else self._turns.finish(self.turn, figures)

    def check_imitation(self) -> None:
        """Refuse a teacher that cannot show anything, before there is anything to lose.

        Raises:
            InputError: there is no such policy, or it does not fit.
        """
        name = self.settings.imitate
        if name is None:
            return
        if self.runtime.device.type not in NUMPY_DEVICES:
            raise InputError(
                "training.imitate: other policies play on a CPU: train with --device cpu"
            )
        collector = self.collector
        teacher = self._new_teacher(collector, self.scenario)
        if self.runtime.group.size > 1 and not teacher.is_deterministic:
            raise InputError(
                f"training.imitate: {name} leaves actions to chance, which several processes "
                "would draw alike: train in one"
            )
        world = collector.world
        actions = torch.zeros(
            *collector.shape, world.num_auvs, len(world.action_sizes), dtype=torch.int64
        )
        try:
            teacher.shows(collector.state, actions, collector.num_envs, slice(collector.shape[1]))
        except InputError as error:
            raise InputError(f"training.imitate: {error}") from None

    @property
    def _imitates(self) -> bool:
        """Whether the next iteration learns what a teacher does."""
        return self.settings.imitate is not None and self.env_steps < self._imitation_steps

    def _teacher(self) -> Teacher | None:
        """Whose actions this iteration learns; None where it is PPO's."""
        collector = self.turn.collector
        if not self._imitates:
            return None
        if collector not in self._teachers:
            draw = self.turn.draw
            scenario = self.scenario if draw is None else draw.scenario
            self._teachers[collector] = self._new_teacher(collector, scenario)
        teacher = self._teachers[collector]
        teacher.begin(self.env_steps, self.env_steps / self._imitation_steps)
        return teacher

    def _new_teacher(self, collector: Collector, scenario: Scenario) -> Teacher:
        name = self.settings.imitate
        assert name is not None
        return Teacher(scenario, collector.shape[1], name, self.seeds)

    def scaled_reward(self, rollout: Rollout) -> Tensor:
        """A rollout's rewards, of the scale on which the critic works."""
        if self._turns is None:
            return self.reward_scale.scaled(rollout.reward, rollout.truncated)
        discount, group = self.settings.discount, self.runtime.group
        return standardised(rollout.reward, rollout.truncated, discount, group)

    def next_value(self, rollout: Rollout) -> Tensor:
        """Values of what follows each slot of a rollout.

        With `training.over`, what follows an episode counts as the mean, as in `standardised`. No
        rollout holds the last states of episodes, so nothing would keep a critic that sees the time
        from valuing them higher and higher, one target after the other.
        """
        if self._turns is None:
            return rollout.next_value
        return rollout.next_value.masked_fill(rollout.truncated[:, None, None, None], 0.0)

    @property
    def steps_per_iteration(self) -> int:
        """Environment steps of a rollout, for each policy; with `training.over` about so many."""
        return self.settings.environments * self.settings.rollout_slots

    @property
    def finished(self) -> bool:
        """Whether the scenario's number of steps has been taken."""
        return self.env_steps >= self.settings.steps

    @abstractmethod
    def _update(
        self, rollout: Rollout, orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """Learn from a rollout: what there is to log, (policies,) each.

        Args:
            rollout: the rollout.
            orders: of its samples in each epoch, see `Minibatches.orders`.
            learning_rate: of this iteration.
        """

    def _learning_rate(self) -> float:
        rate = self.settings.learning_rate
        if self.settings.learning_rate_schedule == "linear":
            rate *= max(1 - self.env_steps / self.settings.steps, 0.0)
        return rate

    def policy(self, policy: int = 0, name: str = "ppo") -> TrainedPolicy:
        """One policy as it is now, to be evaluated.

        Args:
            policy: which.
            name: what tables call it.
        """
        # On the CPU, where evaluations and environments play.
        network = self._make_network(self.seeds[policy])
        network.load_state_dict(self.weights(policy))
        return TrainedPolicy(
            network.eval(),
            name,
            use_mask=self.settings.mask_actions,
            num_auvs=self.collector.world.num_auvs,
            observation=self.collector.world.scenario.observation.model_dump(),
        )

    def weights(self, policy: int = 0) -> dict[str, Tensor]:
        """The `state_dict` of one policy's networks."""
        return {k: v[policy].clone() for k, v in self.network.state_dict().items()}

    def state_dict(self, policy: int = 0) -> dict[str, Any]:
        """All that the training of one policy continues from, as tensors and plain values.

        It is the same whatever was trained beside it, and by how many processes; these have
        to ask for it together.
        """
        return {
            "network": self.weights(policy),
            "optimizer": self.optimizer.state_dict(policy),
            "reward_scale": self.reward_scale.state_dict(policy),
            "collector": self.collector.state_dict(policy),
            "env_steps": self.env_steps,
            "seed": self.seeds[policy],
            "side_by_side": [self.seeds.start, len(self.seeds)],
            **({} if self._turns is None else {"over": self._turns.state_dict()}),
            **({} if self.settings.imitate is None else {"imitation": self._imitation_steps}),
        }

    def load_state_dict(self, *saved: dict[str, Any]) -> None:
        """Continue from the `state_dict` of each policy; on a CPU, as if never stopped.

        Raises:
            InputError: they are of other seeds, with other layouts.
        """
        seeds = range(saved[0]["seed"], saved[0]["seed"] + len(saved))
        if [pin_layout(self.source, seed) for seed in seeds] != self.scenarios:
            raise InputError(
                f"seed: this training has the layout of seed {self.seeds.start}, what was saved "
                f"that of seed {seeds.start}: train with the latter"
            )
        weights = [one["network"] for one in saved]
        self.network.load_state_dict({k: torch.stack([w[k] for w in weights]) for k in weights[0]})
        self.optimizer.load_state_dict([one["optimizer"] for one in saved])
        self.reward_scale.load_state_dict([one["reward_scale"] for one in saved])
        self.collector.load_state_dict([one["collector"] for one in saved])
        if self._turns is not None:
            self._turns.load_state_dict(saved[0]["over"])
        self._imitation_steps = saved[0].get("imitation", 0.0)
        self._capture()
        self.env_steps = saved[0]["env_steps"]
        self.seeds = seeds

    def save(self, path: str | Path) -> None:
        """Save a run that can be resumed, evaluated and loaded as a policy; several in one folder.

        Args:
            path: the run's folder: a new one, or one that this training has been saved in.

        Raises:
            InputError: it holds anything else, or cannot be written.
        """
        from trainers.runs.writing import save_trainer

        save_trainer(self, path)


def load_for_training(
    scenario: AnyScenario, overrides: Overrides, network: str | dict[str, Any] | None
) -> Scenario:
    """`load_scenario`, with a network in place of that of the scenario unless it is None."""
    loaded = load_scenario(scenario, overrides)
    return loaded if network is None else load_scenario(loaded, {"training.network": network})
