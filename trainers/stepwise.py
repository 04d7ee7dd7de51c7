"""Actors that choose the entries of an action one after the other."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable

from torch import Tensor, nn

#: Takes the logits of an entry, (…, choices, samples), and returns its choices, (…, samples).
Choose = Callable[[Tensor], Tensor]


class StepwiseActor(nn.Module, ABC):
    """An actor whose logits of an entry may depend on the choices of the entries before.

    The probability of an action is the product of those of its entries, each given those before.
    """

    @abstractmethod
    def decide(self, inputs: Tensor, choose: Choose) -> None:
        """Call `choose` with the logits of every entry of an action in turn.

        Args:
            inputs: (…, entries, samples) scaled observations; the axes before are those of
                networks side by side.
            choose: see `Choose`.
        """
