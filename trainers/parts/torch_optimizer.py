"""Any optimizer of torch, by the name of its class."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from pydantic import Field, field_validator

from iout_marl import parts
from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario import Training
from iout_marl.scenario.fields import Text, invalid
from iout_marl.scenario.places import MAX_SHOWN, show_value


@cache
def _classes() -> tuple[str, ...]:
    """The classes of `torch.optim`, as its source has them: to import it takes seconds."""
    spec = find_spec("torch")
    if spec is None or spec.origin is None:
        return ()
    try:
        text = Path(spec.origin).with_name("optim").joinpath("__init__.py").read_text("utf-8")
    except OSError:
        return ()
    return tuple(re.findall(r"^from \S+ import ([A-Z]\w*)\b(?<!\bOptimizer)", text, re.MULTILINE))


@parts.optimizers.register("torch")
class TorchOptimizer(parts.Optimizer):
    """A class of `torch.optim`: `optimizer: RMSprop` is short for its name alone.

    Of several policies side by side each has one of its own.
    """

    class Settings(parts.Settings):
        """Which, and with which options."""

        #: Name of the class: `AdamW`, `SGD`, say.
        name: Text
        #: What it takes beside parameters and learning rate: `weight_decay: 0.01`, say.
        options: dict[str, Any] = Field(default_factory=dict)

        @field_validator("name")
        @classmethod
        def _is_no_slip(cls, name: str) -> str:
            # A name like no other may be one of another version's, in the scenario of a run.
            known = _classes()
            near = did_you_mean(name[:MAX_SHOWN], known, or_list=False)
            if near and name not in known:
                raise invalid((), f"torch.optim has no optimizer {show_value(name)}{near}")
            return name

    @property
    def name(self) -> str:
        """The class."""
        return f"torch.optim.{self.settings.name}"

    def make(self, parameters: Sequence[Any], training: Training) -> Any:
        """See `Optimizer.make`.

        Raises:
            InputError: torch has no such class.
        """
        import torch

        found: dict[str, Any] = {
            name: item
            for name, item in vars(torch.optim).items()
            if isinstance(item, type)
            and issubclass(item, torch.optim.Optimizer)
            and item is not torch.optim.Optimizer
        }
        name = self.settings.name
        if name not in found:
            raise InputError(
                f"training.optimizer: torch.optim has no optimizer {name!r}"
                f"{did_you_mean(name, found)}"
            )
        return found[name](parameters, lr=training.learning_rate, **self.settings.options)
