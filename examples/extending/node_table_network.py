"""A network of one's own on node tables: it learns with five nodes, and plays with ten.

What it makes of a node's row is the same for every row, and rows meet in a weighted mean
(attention) alone, so its weights serve any number of nodes. It learns what the policy `pretrained`
does.

    python examples/extending/node_table_network.py
"""

import numpy as np
import torch
from torch import nn

from iout_marl import evaluate, iout_v0, make_baseline, pretrained
from iout_marl.policies import BasePolicy
from iout_marl.world import World

TABLE = {"observation": "table", "nodes.redraw": "episode"}


class Network(nn.Module):
    """Logits of directions and of nodes, from a node table.

    Args:
        context, node: columns of the context and of a node's row.
        directions: how many there are.
    """

    def __init__(self, context: int, node: int, directions: int, width: int = 64) -> None:
        super().__init__()
        self.row = nn.Sequential(nn.Linear(context + node, width), nn.Tanh())
        self.share = nn.Linear(width, 1)
        self.direction = nn.Linear(width, directions)
        self.node = nn.Sequential(nn.Linear(2 * width, width), nn.Tanh(), nn.Linear(width, 1))

    def forward(self, context: torch.Tensor, nodes: torch.Tensor) -> list[torch.Tensor]:
        """(…, context) and (…, nodes, columns) to (…, directions) and (…, nodes)."""
        beside = context.unsqueeze(-2).expand(*nodes.shape[:-1], -1)
        rows = self.row(torch.cat([beside, nodes], dim=-1))
        seen = (rows * self.share(rows).softmax(-2)).sum(-2)
        both = torch.cat([rows, seen.unsqueeze(-2).expand_as(rows)], dim=-1)
        return [self.direction(seen), self.node(both).squeeze(-1)]


class Learnt(BasePolicy):
    """Plays what the network finds most probable; one node for both charging and hearing."""

    name = "network"

    def __init__(self, network: Network) -> None:
        self.network = network

    @torch.no_grad()
    def act(self, world: World, state, rng: np.random.Generator):
        rows = world.observer.layout.rows(world.observe(state).astype(np.float32))
        logits = self.network(torch.as_tensor(rows["context"]), torch.as_tensor(rows["nodes"]))
        return torch.stack([each.argmax(-1) for each in logits], dim=-1).numpy()


def lessons(episodes: int) -> tuple[list[torch.Tensor], torch.Tensor]:
    """What an AUV sees in episodes of a policy, and what that does."""
    env = iout_v0.parallel_env("random/k5-tdd", overrides=TABLE)
    teacher, seen, done = pretrained(), [], []
    for seed in range(episodes):
        observations, _ = env.reset(seed=seed)
        while env.agents:
            actions = teacher.predict(observations, env=env)
            seen.append(observations["auv_0"])
            done.append(actions["auv_0"])
            observations, *_ = env.step(actions)
    tables = [torch.as_tensor(np.stack([s[name] for s in seen])) for name in ("context", "nodes")]
    return tables, torch.as_tensor(np.stack(done))


def main() -> None:
    torch.manual_seed(0)
    torch.set_num_threads(1)
    (context, nodes), actions = lessons(episodes=15)
    network = Network(context.shape[-1], nodes.shape[-1], directions=6)
    optimizer = torch.optim.Adam(network.parameters(), 3e-3)
    for _ in range(250):
        batch = torch.randint(len(actions), (256,))
        logits = network(context[batch], nodes[batch])
        loss = sum(
            nn.functional.cross_entropy(each, actions[batch, i]) for i, each in enumerate(logits)
        )
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    print(f"{'mean AoI':14} {'K = 5':>8} {'K = 10':>8}")
    for policy in (make_baseline("random-walk"), make_baseline("greedy"), Learnt(network)):
        found = [
            evaluate(f"random/k{k}-tdd", policy, 20, seed=100, overrides=TABLE) for k in (5, 10)
        ]
        ages = [f"{each.metrics['mean_aoi'].mean:8.2f}" for each in found]
        print(f"{policy.name:14} {'  '.join(ages)}")


if __name__ == "__main__":
    main()
