"""A network of one's own: attention over the nodes, so that the actor treats all nodes alike.

Used by a scenario, or in Python by `train(…, network=…)`:

    training: {network: {kind: node_attention, width: 32}}

    iout train mine.yaml --import examples/extending/network.py

Run as a script, it trains on the paper's smallest scenario, beside perceptrons.
"""

from __future__ import annotations

import argparse

import torch
from torch import Tensor, nn

from iout_marl import Trainer, evaluate, load_scenario, parts

SCENARIO = "paper/k3-fdd"


class NodeAttention(nn.Module):
    """(…, entries) to (…, outputs): what there is of each node attends to that of all others."""

    def __init__(self, sizes: parts.NetworkSizes, width: int) -> None:
        super().__init__()
        self.node_entries = sizes.node_entries
        first = self.node_entries[0].start
        self.others = [i for i in range(sizes.observation_entries) if i < first]
        self.embed = nn.Linear(len(sizes.node_entries) + len(self.others), width)
        self.attend = nn.MultiheadAttention(width, 4, batch_first=True)
        self.norm = nn.LayerNorm(width)

    def forward(self, inputs: Tensor) -> Tensor:
        """(samples, nodes, width) of (samples, entries)."""
        nodes = torch.stack([inputs[:, entries] for entries in self.node_entries], dim=-1)
        others = inputs[:, None, self.others].expand(-1, nodes.shape[1], -1)
        embedded = self.embed(torch.cat([nodes, others], dim=-1)).tanh()
        attended, _ = self.attend(embedded, embedded, embedded, need_weights=False)
        return self.norm(embedded + attended)


class Actor(nn.Module):
    """Logits of nodes from each node's own, those of directions and of nobody from all together."""

    def __init__(self, sizes: parts.NetworkSizes, width: int) -> None:
        super().__init__()
        self.body = NodeAttention(sizes, width)
        self.direction = nn.Linear(width, sizes.action_sizes[0])
        entries = len(sizes.action_sizes) - 1
        self.node = nn.Linear(width, entries)
        num_nodes = sizes.node_entries[0].stop - sizes.node_entries[0].start
        names_nobody = sizes.action_sizes[-1] > num_nodes
        self.nobody = nn.Linear(width, entries) if names_nobody else None

    def forward(self, inputs: Tensor) -> Tensor:
        """(…, choices) of (…, entries)."""
        nodes = self.body(inputs.flatten(0, -2))
        together, by_node = nodes.mean(1), self.node(nodes).mT  # (samples, entries, nodes)
        if self.nobody is not None:  # `auvs.idle_choices`
            by_node = torch.cat([by_node, self.nobody(together)[..., None]], dim=-1)
        logits = torch.cat([self.direction(together), by_node.flatten(1)], dim=-1)
        return logits.reshape(*inputs.shape[:-1], -1)


class Critic(nn.Module):
    """The value, from all nodes together; what the critic alone sees is left out."""

    def __init__(self, sizes: parts.NetworkSizes, width: int) -> None:
        super().__init__()
        self.entries = sizes.observation_entries
        self.body = NodeAttention(sizes, width)
        self.value = nn.Linear(width, 1)

    def forward(self, inputs: Tensor) -> Tensor:
        """(…, 1) of (…, entries)."""
        nodes = self.body(inputs[..., : self.entries].flatten(0, -2))
        return self.value(nodes.mean(1)).reshape(*inputs.shape[:-1], 1)


@parts.networks.register("node_attention", version=1)
class NodeAttentionNetwork(parts.Network):
    """Actor and critic by attention over the nodes."""

    class Settings(parts.Settings):
        width: parts.Count = 16

    def make_actor(self, sizes: parts.NetworkSizes) -> nn.Module:
        """See `parts.Network.make_actor`."""
        return Actor(sizes, self.settings.width)

    def make_critic(self, sizes: parts.NetworkSizes) -> nn.Module:
        """See `parts.Network.make_critic`."""
        return Critic(sizes, self.settings.width)


def main(options: list[str] | None = None) -> dict[str, float]:
    """Mean AoI in slots, of greedy decoding, by network."""
    torch.set_num_threads(1)  # more cost time on networks of this size
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", type=int, default=128_000)
    steps = parser.parse_args(options).steps
    scenario = load_scenario(
        SCENARIO,
        {
            "training.steps": steps,
            "training.environments": 64,
            "training.rollout_slots": 50,
            "training.mask_actions": True,
        },
    )
    found = {}
    print("network         weights  untrained  trained")
    for network in ("mlp", "node_attention"):
        trainer = Trainer(scenario, network=network)
        before = evaluate(scenario, trainer.policy(), 20).metrics["mean_aoi"].mean
        while not trainer.finished:
            trainer.iterate()
        found[network] = evaluate(scenario, trainer.policy(), 20).metrics["mean_aoi"].mean
        weights = sum(p.numel() for p in trainer.network.parameters())
        print(f"{network:14}  {weights:7}  {before:9.2f}  {found[network]:7.2f}")
    return found


if __name__ == "__main__":
    main()
