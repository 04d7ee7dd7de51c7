"""The section of a scenario file that says how a policy is trained."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import Field, field_validator

from iout_marl.scenario.fields import (
    Count,
    Fraction,
    NonNegative,
    Plausible,
    Positive,
    Section,
    Text,
    invalid,
)
from iout_marl.scenario.over import Varied
from iout_marl.scenario.parts import PartOf, Settings
from iout_marl.scenario.places import shorten


class Training(Section):
    """Settings of PPO. `preset` names the file that gives whatever is not given here."""

    #: File of training settings: a bundled one (`fast`, `short`, `paper`), or a path.
    preset: Text
    #: Environment steps (one slot of one environment) to train for.
    steps: Annotated[Count, Plausible(1, 10**11, "steps")]
    #: Environments that are played side by side.
    environments: Annotated[Count, Plausible(1, 100_000, "environments")]
    #: Slots of each environment between two updates.
    rollout_slots: Annotated[Count, Plausible(1, 100_000, "slots")]
    #: Passes over a rollout.
    epochs: Annotated[Count, Plausible(1, 1000, "epochs")]
    #: Parts into which a rollout is cut in each epoch.
    minibatches: Annotated[Count, Plausible(1, 10**6, "minibatches")]
    #: What changes the weights: `adam`, a class of `torch.optim` (`AdamW`), or one from outside.
    optimizer: Annotated[Settings, PartOf("optimizer", is_word=True, by_name="torch")] = Field(
        "adam", validate_default=True
    )
    #: Step size of the optimizer. Of any size: a training that diverges says so itself.
    learning_rate: Annotated[float, Field(gt=0, le=1e30)]
    #: Whether the learning rate stays as it is; `linear` falls to 0 over the training.
    learning_rate_schedule: Literal["constant", "linear"]
    #: What Adam adds to the root of the mean square of a gradient.
    adam_epsilon: Annotated[Positive, Plausible(0, 1)]
    #: Discount γ of future rewards.
    discount: Fraction
    #: λ of generalised advantage estimation.
    gae_lambda: Fraction
    #: How far the ratio of probabilities, new to old, counts from 1.
    clip: Annotated[Positive, Plausible(0, 10)]
    #: Weight of the entropy of the policy, which keeps it exploring.
    entropy_coefficient: Annotated[NonNegative, Plausible(0, 10)]
    #: Weight of the error of the critic.
    value_coefficient: Annotated[NonNegative, Plausible(0, 1000)]
    #: Norm at which gradients are clipped.
    max_gradient_norm: Annotated[Positive, Plausible(0, 1e6)]
    #: Bring the advantages of each minibatch to mean 0 and standard deviation 1.
    normalise_advantage: bool
    #: Let the critic work on returns of mean 0 and standard deviation 1 (PopArt).
    normalise_value: bool
    #: Leave the epochs of an update once the policy has moved this far; null for never.
    target_kl: Annotated[Positive, Plausible(0, 100)] | None
    #: What actor and critic are made of: `mlp`, or one from outside.
    network: Annotated[Settings, PartOf("network", is_word=True)] = Field(
        "mlp", validate_default=True
    )
    #: Units of each hidden layer, of actor and critic alike.
    hidden_units: Annotated[
        tuple[Annotated[Count, Plausible(1, 16_384, "units")], ...],
        Field(min_length=1, max_length=100, strict=False),
    ]
    #: Function behind each hidden layer.
    activation: Literal["tanh", "relu"]
    #: What the critic sees: `own`, the AUV's observation (IPPO), or `central`, the state of the
    #: whole network beside it (MAPPO). With difference rewards it also sees what they are made
    #: of. AUVs share one actor and one critic in either.
    critic: Literal["own", "central"] = "own"
    #: Add to the actor's logit of every node what a small network, the same for all nodes, makes
    #: of its age and energy: for many nodes. Without effect on node tables.
    node_network: bool = False
    #: Inputs of the networks: `none`, `fixed` (by the observation's ranges) or
    #: `running` (by mean and standard deviation of what was seen).
    observation_scaling: Literal["none", "fixed", "running"]
    #: Divisor of the rewards: `none`, `first_rollout` (their standard deviation in it) or
    #: `running` (the standard deviation of the discounted return so far).
    reward_scaling: Literal["none", "first_rollout", "running"]
    #: Forbid what is useless (leaving the grid, hearing a node that cannot pay).
    mask_actions: bool
    #: Environment steps between two checkpoints.
    checkpoint_steps: Count
    #: Scenarios, by name or path, and families of them, one of which is drawn for each rollout:
    #: `{scenario: …, vary: {key: …}, weight: …, name: …}`. Networks must take any size.
    over: Annotated[tuple[Varied, ...], Field(strict=False, max_length=1000)] = ()
    #: How families of `over` are drawn: `none`, by their weights; `gap`, the more often the
    #: further the mean AoI is from the scheduling bound.
    curriculum: Literal["none", "gap"] = "none"

    #: Policy, as `--policy` names it (`tour`, `return`, the folder of a run), whose actions are
    #: learnt before PPO begins; null for none.
    imitate: Text | None = None
    #: Share of the steps in which that is done.
    imitation_share: Fraction = 0.1
    #: Passes over a rollout in these steps.
    imitation_epochs: Annotated[Count, Plausible(1, 1000, "epochs")] = 10

    #: Keys that are written only where they say something.
    written_if_set: ClassVar[dict[str, Any]] = {
        "over": [],
        "curriculum": "none",
        "imitate": None,
        "imitation_share": 0.1,
        "imitation_epochs": 10,
    }

    @field_validator("over")
    @classmethod
    def _have_names_of_their_own(cls, over: tuple[Varied, ...]) -> tuple[Varied, ...]:
        seen: dict[str, int] = {}
        for i, entry in enumerate(over):
            name = entry.name or str(i)
            if name in seen:
                raise invalid(
                    (i, "name"), f"{shorten(name)!r} is that of over[{seen[name]}] too: name both"
                )
            seen[name] = i
        return over

    hash_defaults: ClassVar[dict[str, Any]] = {
        "critic": "own",
        "network": "mlp",
        "node_network": False,
        "optimizer": "adam",
        **written_if_set,
    }
