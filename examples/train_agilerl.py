"""AgileRL's IPPO: every AUV learns networks of its own, which could also evolve.

    pip install agilerl peft
    python examples/train_agilerl.py [--scenario best/k10-fdd] [--auvs 3] [--steps 60_000]

AgileRL takes the ParallelEnv and MultiDiscrete actions as they are. This is a population of
one, without mutations: a longer list of agents and the arguments `selection_strategy` and
`mutation` of its training loop tune hyperparameters by evolution.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import supersuit
import torch
from agilerl.algorithms import IPPO
from agilerl.training.train_multi_agent_on_policy import train_multi_agent_on_policy
from common import mean_aoi, parse, tell

from iout_marl import Scenario, iout_v0


class OwnNetworks(IPPO):
    """IPPO that does not share networks among agents whose names differ by a number alone.

    AgileRL 2.58 would, but lays observations of such a group out agent by agent and their
    advantages slot by slot, so that they do not match.
    """

    def get_group_id(self, agent_id: str) -> str:
        return agent_id


def make_env(scenario: Scenario) -> Any:
    """The ParallelEnv, with returns of the order of one, as critics like them."""
    return supersuit.reward_lambda_v0(iout_v0.parallel_env(scenario), lambda r: r / 100)


def make_agent(scenario: Scenario, seed: int = 0, slots: int = 400) -> IPPO:
    """IPPO for all AUVs, with updates every `slots` slots."""
    np.random.seed(seed)  # noqa: NPY002 (AgileRL shuffles by the global generator)
    torch.manual_seed(seed)
    env = make_env(scenario)
    agents = env.possible_agents
    layers = {"hidden_size": [64, 64], "activation": "Tanh"}
    return OwnNetworks(
        [env.observation_space(agent) for agent in agents],
        [env.action_space(agent) for agent in agents],
        agent_ids=agents,
        net_config={"encoder_config": layers, "head_config": {"hidden_size": [64]}},
        learn_step=slots,
        batch_size=slots // 4,
        update_epochs=4,
        lr=2e-3,
        gamma=0.97,
        ent_coef=0.003,
    )


def learn(agent: IPPO, scenario: Scenario, steps: int) -> None:
    """Trains in this process, until `steps` actions were taken."""
    slots = steps // scenario.num_auvs
    train_multi_agent_on_policy(
        make_env(scenario), "iout", "IPPO", [agent],
        max_steps=slots, evo_steps=slots, eval_steps=scenario.num_slots, verbose=False,
    )  # fmt: skip


def policy_of(agent: IPPO) -> Callable[[Any], Any]:
    """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""

    def policy(observations: Any) -> Any:
        names = agent.agent_ids
        actions, *_ = agent.get_action({a: observations[:, i] for i, a in enumerate(names)})
        return np.stack([actions[name] for name in names], axis=1)

    return policy


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments, steps=60_000)
    agent = make_agent(scenario, options.seed)
    before = mean_aoi(scenario, policy_of(agent))
    learn(agent, scenario, options.steps)
    after = mean_aoi(scenario, policy_of(agent))
    return tell("AgileRL IPPO", before, after, options.steps)


if __name__ == "__main__":
    main()
