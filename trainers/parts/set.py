"""Networks for any number of nodes and AUVs."""

from __future__ import annotations

from typing import Annotated, Any

from iout_marl.parts import Network, NetworkSizes, networks
from iout_marl.scenario import Scenario
from iout_marl.scenario.fields import Count, Plausible, invalid
from iout_marl.scenario.parts import Settings as PartSettings


@networks.register("set")
class SetNetwork(Network):
    """One network for node tables of any size: rows of nodes and AUVs are treated alike.

    Actor and critic do not depend on the order of rows, and their weights not on how many there
    are. The actor chooses a direction, then nodes given the direction.
    """

    class Settings(PartSettings):
        #: Features of a node in the actor.
        width: Annotated[Count, Plausible(1, 4096, "features")] = 48
        #: Rounds in which nodes learn of one another, in the actor.
        blocks: Annotated[int, Plausible(0, 100, "blocks")] = 2
        #: Weighted means over nodes (attention) in each round; they divide `width`. 0 for none.
        heads: Annotated[int, Plausible(0, 64, "heads")] = 4
        #: Features of each pair of a node and a direction.
        pair_width: Annotated[Count, Plausible(1, 1024, "features")] = 12
        #: Features of a node in the critic.
        critic_width: Annotated[Count, Plausible(1, 4096, "features")] = 32
        #: Rounds in the critic.
        critic_blocks: Annotated[int, Plausible(0, 100, "blocks")] = 1

    settings: Settings
    is_for_any_size = True

    def check(self, scenario: Scenario) -> None:
        chosen, seen = self.settings, scenario.observation
        for name in ("width", "critic_width"):
            width = getattr(chosen, name)
            if chosen.heads and width % chosen.heads:
                raise invalid(
                    ("training", "network", "heads"), f"{chosen.heads} must divide {name}, {width}"
                )
        if not seen.part.is_table:
            raise invalid(
                ("observation", "kind"),
                f"must be table for training.network: set, not {seen.kind}",
                beside=("training", "network"),
            )
        if scenario.reward.part.is_credited_apart:
            raise invalid(
                ("reward", "credit"),
                "must be team for training.network: set, whose critic sees the table alone",
                beside=("training", "network"),
            )
        if scenario.training.critic == "central" and seen.view_range_m is not None:
            raise invalid(
                ("training", "critic"),
                "must be own for training.network: set with observation.view_range_m",
                beside=("training", "network"),
            )

    def make_actor(self, sizes: NetworkSizes) -> Any:
        """See `Network.make_actor`."""
        from trainers.sets import SetActor

        chosen, layout = self.settings, sizes.table
        assert layout is not None, "checked with the scenario"
        return SetActor(
            layout,
            sizes.action_sizes,
            width=chosen.width,
            blocks=chosen.blocks,
            heads=chosen.heads,
            pair_width=chosen.pair_width,
        )

    def make_critic(self, sizes: NetworkSizes) -> Any:
        """See `Network.make_critic`."""
        from trainers.sets import SetCritic

        chosen, layout = self.settings, sizes.table
        assert layout is not None, "checked with the scenario"
        return SetCritic(
            layout,
            width=chosen.critic_width,
            blocks=chosen.critic_blocks,
            heads=chosen.heads,
        )
