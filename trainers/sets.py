"""Networks whose weights do not depend on how many nodes and AUVs there are.

They see node tables (`observation: table`): what they make of a row is the same for every row, and
rows meet in means, maxima and weighted means alone. A permutation of the nodes, or of the other
AUVs, therefore permutes what comes out likewise (Zaheer et al., 2017), and the cost grows in
proportion to the rows.

Inside, arrays are (…, features, rows, samples) with the samples last, where the processor takes
many at once; the axes before are those of networks side by side, see `trainers.networks.stacked`.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import NamedTuple, Self

import torch
from torch import Tensor, nn

from iout_marl.core.table import TableLayout
from trainers.set_ops import mixed, pooled
from trainers.stepwise import Choose, StepwiseActor

#: Small first logits make the first policy all but uniform.
_LOGIT_GAIN = 0.01


class Mix(nn.Module):
    """A linear layer of several inputs whose rows broadcast, see `set_ops.mixed`.

    Args:
        inputs: features of each, the one with the most rows first.
        outputs: features of the result.
        gain: of the orthogonal weights.
        relu: whether negative numbers become 0.
    """

    def __init__(
        self, inputs: Sequence[int], outputs: int, gain: float = math.sqrt(2), *, relu: bool = False
    ) -> None:
        super().__init__()
        self.relu = relu
        self.weight = nn.Parameter(torch.empty(outputs, sum(inputs)))
        self.bias = nn.Parameter(torch.zeros(outputs))
        nn.init.orthogonal_(self.weight, gain)

    def forward(self, *inputs: Tensor, onto: Tensor | None = None) -> Tensor:
        """(…, features, rows…, samples) each, to (…, outputs, rows…, samples).

        Args:
            inputs: the inputs.
            onto: what the result is added to.
        """
        return mixed(self.weight, self.bias, inputs, relu=self.relu, onto=onto)


class Pools(nn.Module):
    """Maximum and mean over rows, or weighted means of them, see `set_ops.pooled`.

    Args:
        width: features of a row.
        heads: weighted means, each of an equal part of the features, by weights that are a
            softmax over rows of a linear function of the row; 0 for the mean alone.
    """

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.outputs = width * 2
        self.weigh = Mix([width], heads, 1.0) if heads else None

    def forward(self, rows: Tensor, replicas: int) -> Tensor:
        """(…, width, …, rows, samples) to (…, outputs, …, 1, samples)."""
        share = None if self.weigh is None else self.weigh(rows).softmax(-2)
        return pooled(rows, share, replicas)


class Block(nn.Module):
    """Adds to every row what a layer makes of it, of all rows together and of the context."""

    def __init__(self, width: int, heads: int, context: int) -> None:
        super().__init__()
        self.pools = Pools(width, heads)
        self.hidden = Mix([width, self.pools.outputs, context], width, relu=True)
        self.output = Mix([width], width, 1.0)

    def forward(self, rows: Tensor, context: Tensor) -> Tensor:
        """(…, width, rows, samples), with (…, context, 1, samples)."""
        replicas = self.hidden.bias.ndim - 1
        hidden = self.hidden(rows, self.pools(rows, replicas), context)
        return self.output(hidden, onto=rows)


class Rows(NamedTuple):
    """A node table, samples last."""

    context: Tensor  # (…, columns, 1, samples)
    auvs: Tensor  # (…, columns, auvs, samples)
    nodes: Tensor  # (…, columns, nodes, samples)
    moves: Tensor  # (…, columns, directions, nodes, samples)

    @classmethod
    def from_flat(cls, layout: TableLayout, inputs: Tensor) -> Self:
        """Of (…, entries, samples) observations."""
        ends = layout.ends
        context, auvs, nodes, moves = (
            inputs[..., begin:end, :] for begin, end in zip((0, *ends), ends, strict=False)
        )
        return cls(
            context.unsqueeze(-2),
            torch.unflatten(auvs, -2, (layout.auv_columns, layout.auvs)),
            torch.unflatten(nodes, -2, (layout.node_columns, layout.nodes)),
            torch.unflatten(moves, -2, (layout.move_columns, layout.moves, layout.nodes)),
        )


class Trunk(nn.Module):
    """What actor and critic have in common in kind: features of every node, and of the whole.

    Args:
        layout: of the tables; only its numbers of columns count.
        width: features of a node.
        blocks: how many `Block`s.
        heads: of each `Pools`.
    """

    def __init__(self, layout: TableLayout, width: int, blocks: int, heads: int) -> None:
        super().__init__()
        of_auvs = max(width // 2, 1)
        self.auvs = Mix([layout.auv_columns, layout.context], of_auvs, relu=True)
        self.context = Mix([layout.context, 2 * of_auvs], width, relu=True)
        self.nodes = Mix([layout.node_columns, layout.move_columns, width], width, relu=True)
        self.blocks = nn.ModuleList(Block(width, heads, width) for _ in range(blocks))

    def forward(self, rows: Rows) -> tuple[Tensor, Tensor]:
        """Of nodes (…, width, nodes, samples), and of the whole (…, width, 1, samples)."""
        context = self.context(rows.context, self._of_auvs(rows))
        best = rows.moves.amax(-3)
        nodes = self.nodes(rows.nodes, best, context)
        for block in self.blocks:
            nodes = block(nodes, context)
        return nodes, context

    def _of_auvs(self, rows: Rows) -> Tensor:
        """Mean and maximum of what is made of each other AUV; 0 of a lone one."""
        if rows.auvs.shape[-2] == 0:
            of_auvs = self.auvs.bias.shape[-1]
            shape = rows.context.shape
            return rows.context.new_zeros(*shape[:-3], 2 * of_auvs, *shape[-2:])
        return pooled(self.auvs(rows.auvs, rows.context), None, self.auvs.bias.ndim - 1)


class SetActor(StepwiseActor):
    """Chooses a direction, then nodes given the direction, each given those before.

    For every pair of a direction and a node there is a small vector, made of the node's features
    and of what the move would make of the node. A direction's logit is made of its vectors, pooled
    over the nodes; a node's logit of its vector for the direction taken.

    Args:
        layout: of the tables.
        action_sizes: number of choices of each entry of an action.
        width, blocks, heads: see `Trunk`.
        pair_width: size of the vectors.
    """

    def __init__(
        self,
        layout: TableLayout,
        action_sizes: Sequence[int],
        *,
        width: int,
        blocks: int,
        heads: int,
        pair_width: int,
    ) -> None:
        super().__init__()
        self.layout, self.action_sizes = layout, tuple(action_sizes)
        self.trunk = Trunk(layout, width, blocks, heads)
        self.pairs = Mix([layout.move_columns, width, width], pair_width, relu=True)
        self.pools = Pools(pair_width, min(heads, 1))
        self.direction_hidden = Mix([self.pools.outputs, width], pair_width, relu=True)
        self.direction = Mix([pair_width], 1, _LOGIT_GAIN)
        self.node_hidden = Mix([pair_width, width], pair_width)
        entries = range(1, len(action_sizes))
        self.node = nn.ModuleList(Mix([pair_width], 1, _LOGIT_GAIN) for _ in entries)
        self.nobody = nn.ModuleList(Mix([width], 1, _LOGIT_GAIN) for _ in entries)
        #: What a node's vector changes by once it was chosen by an entry before.
        self.chosen = nn.Parameter(torch.zeros(pair_width))

    def sized_for(self, layout: TableLayout, action_sizes: Sequence[int]) -> Self:
        """The same weights for tables and actions of other sizes."""
        result = copy.copy(self)
        result.layout, result.action_sizes = layout, tuple(action_sizes)
        return result

    def decide(self, inputs: Tensor, choose: Choose) -> None:
        """See `StepwiseActor.decide`."""
        self.decide_by(Rows.from_flat(self.layout, inputs), choose)

    def decide_by(self, rows: Rows, choose: Choose) -> None:
        """Decide by rows, of which there may be others than `layout` and `action_sizes` say."""
        nodes, context = self.trunk(rows)
        # (…, pair, directions, nodes, samples)
        pairs = self.pairs(rows.moves, nodes.unsqueeze(-3), context.unsqueeze(-3))
        seen = self.pools(pairs, self.direction.bias.ndim - 1).squeeze(-2)
        hidden = self.direction_hidden(seen, context)
        direction = choose(self.direction(hidden).squeeze(-3))
        taken = direction[..., None, None, None, :].expand(*pairs.shape[:-3], 1, *pairs.shape[-2:])
        vectors = self.node_hidden(pairs.gather(-3, taken).squeeze(-3), nodes)
        for size, node, nobody in zip(self.action_sizes[1:], self.node, self.nobody, strict=True):
            logits = node(vectors.relu()).squeeze(-3)
            if size > self.layout.nodes:
                logits = torch.cat([logits, nobody(context).squeeze(-3)], dim=-2)
            choice = choose(logits)
            if node is not self.node[-1]:
                one = torch.ones_like(choice, dtype=logits.dtype).unsqueeze(-2)
                is_chosen = torch.zeros_like(logits).scatter(-2, choice.unsqueeze(-2), one)
                is_chosen = is_chosen.narrow(-2, 0, nodes.shape[-2])
                vectors = vectors + self.chosen[..., None, None] * is_chosen.unsqueeze(-3)


class SetCritic(nn.Module):
    """The value of an AUV's table.

    Args:
        layout, width, blocks, heads: see `Trunk`.
    """

    def __init__(self, layout: TableLayout, *, width: int, blocks: int, heads: int) -> None:
        super().__init__()
        self.layout = layout
        self.trunk = Trunk(layout, width, blocks, heads)
        self.pools = Pools(width, heads)
        self.hidden = Mix([self.pools.outputs, width], width, relu=True)
        self.output = Mix([width], 1, 1.0)

    def sized_for(self, layout: TableLayout) -> Self:
        """The same weights for tables of another size."""
        result = copy.copy(self)
        result.layout = layout
        return result

    def forward(self, inputs: Tensor) -> Tensor:
        """(…, entries) to (…, 1)."""
        replicas = self.output.bias.ndim - 1
        samples = inputs.flatten(replicas, -2).mT
        rows = Rows.from_flat(self.layout, samples)
        nodes, context = self.trunk(rows)
        value = self.output(self.hidden(self.pools(nodes, replicas), context))
        return value.reshape(*inputs.shape[:-1], 1)
