"""Who hears whom: AUVs that decide at the same time agree not to ask the same node.

Of several that ask one node only one gets its packet. AUVs that see the same network each know
what the others would choose, since they play the same policy; so they can tell who gives way.
"""

from __future__ import annotations

import torch
from torch import Tensor

from trainers.networks import IMPOSSIBLE


def agreed(choice: Tensor, log_probability: Tensor, nodes: int) -> Tensor:
    """The nodes that AUVs hear once they have agreed.

    The AUV for which its choice is most probable keeps it, and so on; one whose node was kept by
    another takes the most probable one that nobody has asked for, where there is one. So it does
    not matter which AUV is called the first.

    Args:
        choice: (envs, auvs) what each would hear: a node, or `nodes` for none.
        log_probability: (envs, auvs, choices) of all choices, `networks.IMPOSSIBLE` where masked.
        nodes: how many nodes there are.

    Returns:
        (envs, auvs).
    """
    env = torch.arange(len(choice), device=choice.device)
    is_node = torch.arange(log_probability.shape[-1], device=choice.device) < nodes
    kept = torch.zeros_like(log_probability[:, 0], dtype=torch.bool)
    asked = kept.scatter(-1, choice, value=True)
    result = choice.clone()
    own = log_probability.gather(-1, choice[..., None]).squeeze(-1)
    for auv in own.argsort(dim=-1, descending=True, stable=True).T:
        mine = choice[env, auv]
        others = log_probability[env, auv].masked_fill(asked & is_node, IMPOSSIBLE)
        best, other = others.max(-1)
        gives_way = (kept & is_node)[env, mine] & (best > IMPOSSIBLE / 2)
        mine = torch.where(gives_way, other, mine)
        result[env, auv] = mine
        kept[env, mine] = asked[env, mine] = True
    return result
