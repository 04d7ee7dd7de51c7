"""MAPPO from TorchRL's own parts: all AUVs share one policy and a critic that sees everything.

    pip install torchrl
    python examples/train_torchrl.py [--scenario best/k10-fdd] [--auvs 3] [--steps 30_000]

`PettingZooWrapper` puts the AUVs, by their names, into one group "auv": its tensors have an
axis for the AUVs after that of time. TorchRL has no distribution for MultiDiscrete actions:
one is made of torch's.
"""

from __future__ import annotations

from typing import Any

import torch
from common import MultiCategorical, mean_aoi, parse, tell
from tensordict import TensorDict
from tensordict.nn import TensorDictModule
from torchrl.envs import ExplorationType, PettingZooWrapper
from torchrl.modules import MultiAgentMLP, ProbabilisticActor
from torchrl.objectives import ClipPPOLoss, ValueEstimators

from iout_marl import Scenario, iout_v0

OBSERVATION, LOGITS, ACTION, LOG_PROB = (
    ("auv", key) for key in ("observation", "logits", "action", "log_prob")
)
VALUE, REWARD, DONE, TERMINATED = (
    ("auv", key) for key in ("state_value", "reward", "done", "terminated")
)


class MAPPO:
    """The environment, an actor, a centralised critic, and PPO's loss over both."""

    def __init__(self, scenario: Scenario, seed: int = 0) -> None:
        torch.manual_seed(seed)
        env = iout_v0.parallel_env(scenario)
        self.env = PettingZooWrapper(env, seed=seed)
        self.slots, self.auvs = scenario.num_slots, scenario.num_auvs
        entries = env.observation_space("auv_0").shape[0]
        sizes = env.action_space("auv_0").nvec.tolist()

        def network(outputs: int, key: Any, *, centralised: bool) -> TensorDictModule:
            mlp = MultiAgentMLP(
                entries, outputs, self.auvs, centralized=centralised, share_params=True,
                depth=2, num_cells=64, activation_class=torch.nn.Tanh,
            )  # fmt: skip
            return TensorDictModule(mlp, [OBSERVATION], [key])

        self.actor = ProbabilisticActor(
            network(len(sizes) * max(sizes), LOGITS, centralised=False),
            in_keys=[LOGITS], out_keys=[ACTION], spec=self.env.full_action_spec,
            distribution_class=MultiCategorical, distribution_kwargs={"sizes": sizes},
            return_log_prob=True, log_prob_key=LOG_PROB,
            default_interaction_type=ExplorationType.RANDOM,
        )  # fmt: skip
        self.loss = ClipPPOLoss(
            self.actor, network(1, VALUE, centralised=True), clip_epsilon=0.2,
            entropy_coeff=0.003, critic_coeff=0.5, normalize_advantage=True,
            normalize_advantage_exclude_dims=(-2,),
        )  # fmt: skip
        self.loss.set_keys(
            action=ACTION, sample_log_prob=LOG_PROB, value=VALUE, reward=REWARD, done=DONE,
            terminated=TERMINATED,
        )  # fmt: skip
        self.loss.make_value_estimator(ValueEstimators.GAE, gamma=0.97, lmbda=0.95)
        self.optimiser = torch.optim.Adam(self.loss.parameters(), lr=2e-3)

    def learn(self, steps: int, episodes: int = 4, epochs: int = 4, minibatches: int = 4) -> None:
        """Rollouts of whole episodes and updates from them, until `steps` actions were taken."""
        for _ in range(0, steps, episodes * self.slots * self.auvs):
            with torch.no_grad():
                rollouts = [self.env.rollout(self.slots, self.actor) for _ in range(episodes)]
                batch = torch.stack(rollouts)
                batch["next", *REWARD] /= 100  # returns of the order of one, as critics like them
                samples = self.loss.value_estimator(batch).reshape(-1)
            for _ in range(epochs):
                for rows in torch.randperm(len(samples)).chunk(minibatches):
                    losses = self.loss(samples[rows])
                    parts = ("objective", "critic", "entropy")
                    self.optimiser.zero_grad()
                    sum(losses[f"loss_{part}"] for part in parts).backward()
                    torch.nn.utils.clip_grad_norm_(self.loss.parameters(), 0.5)
                    self.optimiser.step()

    def policy(self, observations: Any) -> Any:
        """What `iout_marl.evaluate` takes: (envs, auvs, entries) observations to actions."""
        batch = TensorDict({OBSERVATION: torch.as_tensor(observations)}, observations.shape[:1])
        with torch.no_grad():
            return self.actor(batch)[ACTION].numpy()


def main(arguments: list[str] | None = None) -> tuple[float, float]:
    """Trains, prints and returns the mean AoI before and after."""
    options, scenario = parse(__doc__, arguments)
    mappo = MAPPO(scenario, options.seed)
    before = mean_aoi(scenario, mappo.policy)
    mappo.learn(options.steps)
    after = mean_aoi(scenario, mappo.policy)
    return tell("TorchRL MAPPO", before, after, options.steps)


if __name__ == "__main__":
    main()
