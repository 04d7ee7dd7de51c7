"""An entry of observations of one's own: how far away every node is.

Where this file is imported, scenarios can name it:

    observation: {entries: [{kind: distances, farthest_m: 600}]}

python examples/extending/observation_entry.py [--steps 20000]

checks it, trains with it, and prints how old data become, beside a training without it.
"""

from __future__ import annotations

import argparse
from typing import Any

import torch

from iout_marl import Trainer, evaluate, iout_v0, load_scenario, parts
from iout_marl.testing import check_part
from iout_marl.world import State


@parts.entries.register("distances", version=1)
class Distances(parts.Entry):
    """Distance from the AUV to every node, up to a farthest one."""

    class Settings(parts.Settings):
        farthest_m: parts.Positive = 1000.0

    unit = "m"
    #: One number for each node: a network for every node alike (`training.node_network`) takes it.
    feeds_node_network = True

    @property
    def size(self) -> int:
        """How many numbers."""
        return self.world.scenario.num_nodes

    @property
    def high(self) -> float:
        """The largest; the observation space has it. `low` is 0 unless something else is said."""
        return self.settings.farthest_m

    @property
    def scale(self) -> float:
        """What makes them of order one, for networks."""
        return self.settings.farthest_m

    def setup(self, world: parts.Context) -> None:
        super().setup(world)
        self._farthest_m = world.backend.floats(self.settings.farthest_m)

    def __call__(self, state: State) -> Any:
        """(envs, auvs, size); (envs, 1, size) would be for all AUVs alike."""
        link = self.world.link
        offset = link.offset(state.cell[:, :, None], state.node_cell[:, None, :])
        return self.xp.minimum(link.at(link.distance_m, offset), self._farthest_m)


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI in slots, by what is played."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=20_000)
    steps = parser.parse_args(options).steps

    check_part(parts.entries, "distances", {"farthest_m": 200.0})
    training = {
        "training.steps": steps,
        "training.environments": 10,
        "training.rollout_slots": 50,
    }
    found = {}
    print("policy                      numbers seen  mean AoI")
    for name, entries in {"as it is": [], "and distances": [{"kind": "distances"}]}.items():
        # Nodes lie elsewhere in every episode, where only the new entry says.
        scenario = load_scenario("random/k3-tdd", {"observation.node_positions": False})
        scenario = load_scenario(scenario, {"observation.entries": entries, **training})
        numbers = iout_v0.parallel_env(scenario).observation_space("auv_0").shape[0]
        trainer = Trainer(scenario, seed=0)
        while not trainer.finished:
            trainer.iterate()
        for policy in ("greedy", trainer.policy()):
            evaluation = evaluate(scenario, policy, 50)
            label = f"{evaluation.policy}, {name}"
            found[label] = evaluation.metrics["mean_aoi"].mean
            print(f"{label:26}  {numbers:12}  {found[label]:8.2f}")
    return found


if __name__ == "__main__":
    main()
