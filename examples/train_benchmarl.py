"""BenchMARL's MAPPO: the environment as a task, so that every algorithm there can be compared.

    pip install benchmarl
    python examples/train_benchmarl.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

BenchMARL's algorithms know Discrete actions with one entry, so that a wrapper numbers all
combinations of direction, node to charge and node to hear: 6 · 10 · 10 = 600. The critic
sees the observations of all AUVs.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from typing import Any

import numpy as np
import torch
from benchmarl.algorithms import MappoConfig
from benchmarl.environments.pettingzoo.common import PettingZooClass
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models.mlp import MlpConfig
from common import mean_aoi, parse, tell
from gymnasium import spaces
from pettingzoo.utils import BaseParallelWrapper
from tensordict import TensorDict
from torchrl.envs import EnvBase, ExplorationType, PettingZooWrapper, set_exploration_type

from iout_marl import Scenario, iout_v0

ENVIRONMENTS = 4


class FlatActions(BaseParallelWrapper[str, Any, Any]):
    """Numbers for MultiDiscrete actions, and smaller rewards."""

    def __init__(self, env: Any) -> None:
        super().__init__(env)
        self.sizes = tuple(env.action_space(env.possible_agents[0]).nvec)
        self.action_spaces = {
            agent: spaces.Discrete(int(np.prod(self.sizes))) for agent in env.possible_agents
        }

    def action_space(self, agent: str) -> spaces.Discrete:
        return self.action_spaces[agent]

    def step(self, actions: dict[str, Any]) -> Any:
        entries = {a: np.array(np.unravel_index(n, self.sizes)) for a, n in actions.items()}
        observations, rewards, *rest = super().step(entries)
        return observations, {agent: r / 10 for agent, r in rewards.items()}, *rest


class Task(PettingZooClass):
    """Any scenario of this package as a task of BenchMARL."""

    def get_env_fun(
        self, num_envs: int, continuous_actions: bool, seed: int | None, device: Any
    ) -> Callable[[], EnvBase]:
        def make() -> EnvBase:
            env = FlatActions(iout_v0.parallel_env(self.config["scenario"]))
            return PettingZooWrapper(env, seed=seed, device=device)

        return make

    def supports_continuous_actions(self) -> bool:
        return False

    def supports_discrete_actions(self) -> bool:
        return True

    def has_state(self) -> bool:
        return False

    def has_render(self, env: EnvBase) -> bool:
        return False

    def max_steps(self, env: EnvBase) -> int:
        return self.config["scenario"].num_slots


def make_experiment(scenario: Scenario, folder: str, steps: int, seed: int = 0) -> Experiment:
    """MAPPO with shared policy and shared critic; frames are slots."""
    config = ExperimentConfig.get_from_yaml()
    frames = ENVIRONMENTS * scenario.num_slots
    config.max_n_frames = steps // scenario.num_auvs
    config.on_policy_collected_frames_per_batch = frames
    config.on_policy_n_envs_per_worker = ENVIRONMENTS
    config.on_policy_minibatch_size = frames // 4
    config.on_policy_n_minibatch_iters = 10
    config.lr, config.gamma, config.clip_grad_val = 2e-3, 0.97, 0.5
    config.evaluation, config.loggers, config.create_json = False, [], False
    config.save_folder = folder
    algorithm = MappoConfig.get_from_yaml()
    algorithm.entropy_coef, algorithm.lmbda = 0.003, 0.95
    model = MlpConfig(
        num_cells=[64, 64], activation_class=torch.nn.Tanh, layer_class=torch.nn.Linear
    )
    return Experiment(
        task=Task("IOUT", {"scenario": scenario}),
        algorithm_config=algorithm,
        model_config=model,
        critic_model_config=model,
        seed=seed,
        config=config,
    )


def policy_of(experiment: Experiment) -> Callable[[Any], Any]:
    """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""
    scenario = experiment.task.config["scenario"]
    sizes = iout_v0.parallel_env(scenario).action_space("auv_0").nvec

    def policy(observations: Any) -> Any:
        group = {("auv", "observation"): torch.as_tensor(observations)}
        with torch.no_grad(), set_exploration_type(ExplorationType.RANDOM):
            numbers = experiment.policy(TensorDict(group, observations.shape[:1]))["auv", "action"]
        return np.stack(np.unravel_index(numbers.numpy(), sizes), axis=-1)

    return policy


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments)
    with tempfile.TemporaryDirectory() as folder:
        experiment = make_experiment(scenario, folder, options.steps, options.seed)
        before = mean_aoi(scenario, policy_of(experiment))
        experiment.run()
        after = mean_aoi(scenario, policy_of(experiment))
    return tell("BenchMARL MAPPO", before, after, options.steps)


if __name__ == "__main__":
    main()
