"""Adam."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from iout_marl.parts import Optimizer, optimizers
from iout_marl.scenario import Training


@optimizers.register("adam")
class Adam(Optimizer):
    """Adam (Kingma and Ba, 2015), with `training.adam_epsilon`."""

    is_stacked: ClassVar[bool] = True

    def make(self, parameters: Sequence[Any], training: Training) -> Any:
        """See `Optimizer.make`."""
        from trainers.optimizers import Adam as StackedAdam

        return StackedAdam(parameters, training.adam_epsilon)
