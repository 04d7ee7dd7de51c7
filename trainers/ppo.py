"""Proximal policy optimisation (Schulman et al., 2017) on the batched world.

Read it from `Trainer.iterate_all` on: collect a rollout → estimate advantages → take the
clipped-surrogate steps, epoch by epoch → log. Every setting is explained in
`iout_marl.scenario.Training`.

Several policies are trained side by side in one batch, each from a seed of its own, as it would
be trained alone: the first axis of weights and samples is that of the policies, and losses are
(policies,). What happens on which device and in which process is the `Runtime`'s business.
"""

from __future__ import annotations

from collections.abc import Iterable

import torch
from torch import Tensor

from trainers.base import BaseTrainer
from trainers.imitation import imitation_loss
from trainers.memory import enough_memory
from trainers.moments import Moments
from trainers.networks import Scaler
from trainers.ops import policy_loss
from trainers.optimizers import clip_gradient
from trainers.returns import advantages
from trainers.rollout import Rollout, samples_of
from trainers.timing import PhaseTimer


class Trainer(BaseTrainer):
    """Trains by PPO: its arguments and attributes are those of `BaseTrainer`."""

    def iterate(self) -> dict[str, float]:
        """`iterate_all` for a lone policy."""
        (log,) = self.iterate_all()
        return log

    @enough_memory()
    def iterate_all(self) -> list[dict[str, float]]:
        """One iteration: a rollout, and the epochs of learning from it.

        Returns:
            what there is to log of each policy, by TensorBoard tag:

            - `aoi/…`, `fairness/…`, `energy/…`, `uplink/…`, `constraints/…`: metrics of
              the episodes that ended in the rollout, see `iout_marl.metrics`; `metrics/…`:
              those of users;
            - `family/NAME/aoi`, `family/NAME/gap`: mean AoI of the family that was drawn of
              `training.over`, and by how much it exceeds the scheduling bound, relatively;
            - `reward/…`: mean of each term of the reward a slot, and their `total`;
            - `ppo/loss`, and its terms `ppo/policy_loss` (of a teacher's actions the
              cross-entropy), `ppo/value_loss`, `ppo/entropy`;
              `ppo/kl`: mean Kullback-Leibler divergence from the policy of the rollout,
              (r − 1) − log r; `ppo/clip_fraction`: share of ratios that were clipped;
              `ppo/explained_variance`: of the returns, by the critic of the rollout;
              `ppo/gradient_norm`: before clipping; `ppo/learning_rate`;
            - `speed/env_steps_per_s`, of all policies together; `speed/rollout_share`, of
              the iteration's time, within it `speed/environment_share` (step, reward,
              observation) and `speed/inference_share` (networks and sampling), of a
              captured slot neither; and `speed/learn_share`.
        """
        settings, timer = self.settings, PhaseTimer()
        learning_rate = self._learning_rate()
        turn = self.turn = self.next_turn()
        teacher = self._teacher()
        rollout = turn.collector.collect(
            turn.network,
            turn.slots,
            use_mask=settings.mask_actions,
            timer=timer,
            teacher=teacher,
        )
        epochs = settings.epochs if teacher is None else settings.imitation_epochs
        orders = turn.minibatches.orders(turn.slots, epochs)
        figures = {**rollout.log(), **self._captured_update(rollout, orders, learning_rate)}
        columns = torch.stack([f.double() for f in figures.values()]).cpu()
        self.env_steps += turn.env_steps
        timer("learn")
        common = {
            **timer.log(turn.env_steps * len(self.seeds)),
            "ppo/learning_rate": learning_rate,
        }
        logs = [
            {**dict(zip(figures, values, strict=True)), **common} for values in columns.T.tolist()
        ]
        return [{**log, **self.finish_turn(log)} for log in logs]

    def _update(
        self, rollout: Rollout, orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """See `BaseTrainer._update`."""
        settings, network = self.settings, self.turn.network
        advantage = advantages(
            self.scaled_reward(rollout),
            rollout.value,
            self.next_value(rollout),
            rollout.truncated,
            settings.discount,
            settings.gae_lambda,
        )
        returns = advantage + rollout.value
        return_moments = self._moments(returns)
        if settings.normalise_value and not settings.over:  # whose rewards are standardised
            network.update_popart(return_moments)
        data = {
            **rollout.samples(),
            "advantage": samples_of(advantage),
            "returns": network.normalised_return(samples_of(returns)),
        }
        losses = self._epochs(data, orders, learning_rate)
        self._update_scaler(network.scaler, rollout.observation)
        self._update_scaler(network.privileged, rollout.privileged)
        unexplained = self._moments(returns - rollout.value).variance
        explained = 1 - unexplained / return_moments.variance.clamp_min(1e-12)
        return {**losses, "ppo/explained_variance": explained}

    def _epochs(
        self, data: dict[str, Tensor], orders: Iterable[Tensor], learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """Pass over the samples again and again, a step for each minibatch."""
        limit = self.settings.target_kl
        logs: list[dict[str, Tensor]] = []
        for order in orders:
            for batch, samples in self.turn.minibatches.cut(data, order):
                logs.append(self._step(batch, samples, learning_rate))
            if limit is not None and float(self.runtime.sum(logs[-1]["kl"].clone())) > limit:
                break
        norms = torch.stack([log.pop("gradient_norm") for log in logs])
        sums = self.runtime.sum(torch.stack([torch.stack([*log.values()]) for log in logs]))
        figures = dict(zip(logs[0], sums.mean(0), strict=True))
        return {f"ppo/{k}": v for k, v in {**figures, "gradient_norm": norms.mean(0)}.items()}

    def _step(
        self, batch: dict[str, Tensor], samples: int, learning_rate: float | Tensor
    ) -> dict[str, Tensor]:
        """One step of the optimizer on a minibatch (eq. `total loss function`).

        What it returns for the log are this process's parts of sums over all.

        Args:
            batch: this process's part of the minibatch, the advantages normalised.
            samples: size of the whole minibatch, of each policy.
            learning_rate: of this step.
        """
        settings, network = self.settings, self.turn.network
        logits = network.logits(batch["inputs"], batch.get("mask"), batch["action"])
        if "log_probability" in batch:
            actor = policy_loss(
                logits,
                batch["action"],
                batch["log_probability"],
                batch["advantage"],
                settings.clip,
                settings.entropy_coefficient,
                samples,
            )
        else:  # a teacher's action
            actor = imitation_loss(logits, batch["action"], settings.entropy_coefficient, samples)
        value = network.normalised_value(batch.get("critic_inputs", batch["inputs"]))
        value_loss = (value - batch["returns"]).square().sum(-1) / samples
        loss = actor.loss + settings.value_coefficient * value_loss
        loss.sum().backward()  # type: ignore[no-untyped-call]
        gradient = self.runtime.sum(self.optimizer.gradient())
        gradient, norm = clip_gradient(gradient, settings.max_gradient_norm)
        self.optimizer.step(gradient, learning_rate)
        log = {**actor._asdict(), "value_loss": value_loss, "loss": loss}
        return {**{name: value.detach() for name, value in log.items()}, "gradient_norm": norm}

    def _moments(self, values: Tensor) -> Moments:
        """Mean and variance of (slots, policies, envs, auvs) values: (policies,) each."""
        return Moments.from_values(values, (0, -2, -1), self.runtime.group)

    def _update_scaler(self, scaler: Scaler | None, seen: Tensor | None) -> None:
        """Take in (slots, policies, envs, auvs, entries) of what networks have seen."""
        if scaler is not None and scaler.running and seen is not None:
            scaler.update(Moments.from_values(seen, (0, -3, -2), self.runtime.group))


if __name__ == "__main__":  # `torchrun -m trainers.ppo SCENARIO …` is `iout train SCENARIO …`
    import sys

    from iout_marl.cli import main

    main(["train", *sys.argv[1:]])
