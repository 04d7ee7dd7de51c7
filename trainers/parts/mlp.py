"""Multi-layer perceptrons."""

from __future__ import annotations

from typing import Any

from iout_marl.parts import Network, NetworkSizes, networks


@networks.register("mlp")
class Mlp(Network):
    """Perceptrons of `training.hidden_units` with `training.activation`, orthogonal at first."""

    def make_actor(self, sizes: NetworkSizes) -> Any:
        """See `Network.make_actor`; gives logits in the form that `ActorCritic` keeps them in."""
        from trainers.networks import perceptron

        training, width = sizes.training, max(sizes.action_sizes)
        # Small first logits make the first policy all but uniform.
        return perceptron(
            sizes.observation_entries,
            training.hidden_units,
            len(sizes.action_sizes) * width,
            training.activation,
            0.01,
        )

    def make_critic(self, sizes: NetworkSizes) -> Any:
        """See `Network.make_critic`."""
        from trainers.networks import perceptron

        training = sizes.training
        return perceptron(sizes.critic_entries, training.hidden_units, 1, training.activation, 1.0)
