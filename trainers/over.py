"""Training over families of scenarios: whose turn it is, and what is played in it.

Each iteration draws a scenario (`training.over`) and plays whole episodes of it, with as many
environments as make about as many samples as the settings say. Networks are those of all scenarios,
in the sizes of the one that is drawn.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, NamedTuple

import numpy as np

from iout_marl.bounds.scheduling import delivery_bound
from iout_marl.errors import InputError
from iout_marl.metrics import described
from iout_marl.scenario import Scenario
from iout_marl.scenario.drawing import Draw, Families
from iout_marl.world import World
from trainers.accel import Runtime
from trainers.collector import Collector
from trainers.curriculum import Curriculum
from trainers.minibatches import Minibatches
from trainers.networks import ActorCritic

#: Environments of a turn are a multiple of this: as many processes, or a divisor, share them.
ENVIRONMENTS = 8
#: Collectors that are kept for when their scenario is drawn again.
_MOST_KEPT = 8
#: Tells the stream of draws from those of layouts and actions, which have the same seed.
_STREAM = 0x0FE2


class Turn(NamedTuple):
    """What an iteration plays and learns from.

    Attributes:
        collector: plays it.
        network: the networks in its sizes.
        minibatches: cut its rollout.
        slots: of the rollout.
        draw: where it was drawn, the scenario and its family.
    """

    collector: Collector
    network: ActorCritic
    minibatches: Minibatches
    slots: int
    draw: Draw | None = None

    @property
    def env_steps(self) -> int:
        """Environment steps of the rollout, for each policy."""
        return self.slots * self.collector.num_envs


class Turns:
    """Draws the scenario of each iteration.

    Args:
        scenario: the one that is trained, with `training.over`.
        collector: of that scenario; turns share its streams of layouts and actions.
        network: the networks, in its sizes.
        seed: of what is drawn.
        runtime: the processes that share the environments, all of which draw the same.

    Raises:
        InputError: the networks do not take any size, or families need others than the scenario.
    """

    def __init__(
        self,
        scenario: Scenario,
        collector: Collector,
        network: ActorCritic,
        seed: int,
        runtime: Runtime,
    ) -> None:
        _check_any_size(scenario, network)
        if ENVIRONMENTS % runtime.group.size:
            raise InputError(
                f"training.over: plays multiples of {ENVIRONMENTS} environments, which "
                f"{runtime.group.size} processes cannot share evenly"
            )
        self._network, self._runtime, self._main = network, runtime, collector
        settings = scenario.training
        self._samples = settings.environments * settings.rollout_slots * scenario.num_auvs
        self.families = Families.from_scenario(scenario)
        _check_alike(self.families, collector.world)
        self.curriculum = Curriculum(self.families, settings.curriculum)
        self._rng = np.random.default_rng([seed, _STREAM])
        self._kept: OrderedDict[Scenario, Collector] = OrderedDict()

    def next(self) -> Turn:
        """The turn of the next iteration, at the first slot of new episodes."""
        family, stratum = self.curriculum.choose(self._rng)
        draw = self.families.draw(self._rng, family=family, stratum=stratum)
        scenario = self._sized(draw.scenario)
        collector = self._collector(scenario)
        collector.restart()
        world = collector.world
        assert world.observer.layout is not None
        network = self._network.sized_for(world.observer.layout, world.action_sizes)
        minibatches = Minibatches(
            scenario.training, world.num_auvs, collector.generators, self._runtime
        )
        slots = scenario.training.rollout_slots
        return Turn(collector, network.to(self._runtime.device), minibatches, slots, draw)

    def finish(self, turn: Turn, figures: dict[str, float]) -> dict[str, float]:
        """Take in how a turn went: what there is to log of its family, by tag."""
        assert turn.draw is not None
        aoi = figures[described("mean_aoi").tag]
        gap = aoi / delivery_bound(turn.draw.scenario) - 1
        self.curriculum.update(turn.draw, gap)
        tag = f"family/{turn.draw.name}"
        return {f"{tag}/aoi": aoi, f"{tag}/gap": gap}

    def _sized(self, scenario: Scenario) -> Scenario:
        """A drawn scenario with the rollouts that its turns have: whole episodes."""
        slots = scenario.num_slots
        groups = self._samples / (slots * scenario.num_auvs * ENVIRONMENTS)
        sizes = {"environments": max(round(groups), 1) * ENVIRONMENTS, "rollout_slots": slots}
        return scenario.model_copy(update={"training": scenario.training.model_copy(update=sizes)})

    def _collector(self, scenario: Scenario) -> Collector:
        kept = self._kept
        if scenario not in kept:
            if len(kept) == _MOST_KEPT:
                kept.popitem(last=False)
            kept[scenario] = Collector(
                [scenario], scenario.training.environments, [0], self._runtime, self._main
            )
        kept.move_to_end(scenario)
        return kept[scenario]

    def state_dict(self) -> dict[str, Any]:
        """What `load_state_dict` continues from."""
        return {"rng": self._rng.bit_generator.state, "gaps": self.curriculum.gaps}

    def load_state_dict(self, saved: dict[str, Any]) -> None:
        """Continue from a `state_dict`."""
        self._rng.bit_generator.state = saved["rng"]
        self.curriculum.gaps = list(saved["gaps"])


def _check_any_size(scenario: Scenario, network: ActorCritic) -> None:
    if network.layout is None or network.privileged is not None:
        raise InputError(
            "training.network: must be one whose weights do not depend on the sizes of a scenario, "
            f"such as set, for training.over, not {scenario.training.network.kind}"
        )


def _check_alike(families: Families, world: World) -> None:
    """Refuse families whose tables have other columns, or whose actions have other entries."""
    wanted = _interface(world)
    for i, family in enumerate(families.members):
        variants = [(f"[{i}]", family.base)]
        for key, inside, value in family.ends():
            place = "".join(f"[{p}]" if isinstance(p, int) else f".{p}" for p in inside)
            variants.append((f"[{i}].vary.{key}{place}", family.scenario({key: value})))
        for place, scenario in variants:
            found = _interface(World(scenario, 1, dtype="float32"))
            for what, number in wanted.items():
                if found[what] != number:
                    raise InputError(
                        f"training.over{place}: has {found[what]} {what}, but the scenario that "
                        f"is trained {number}: one network cannot serve both"
                    )


def _interface(world: World) -> dict[str, int]:
    layout = world.observer.layout
    assert layout is not None
    return {
        "choices in an action": len(world.action_sizes),
        "columns of context": layout.context,
        "columns of AUVs": layout.auv_columns,
        "columns of nodes": layout.node_columns,
        "columns of moves": layout.move_columns,
    }
