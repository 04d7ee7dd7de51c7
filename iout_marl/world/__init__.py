"""The world as a batched functional core: `State` and its transition."""

from iout_marl.core.budget import LinkBudget
from iout_marl.core.chance import Chance, Draw
from iout_marl.core.grid import Grid
from iout_marl.core.state import Events, State
from iout_marl.world.chance import ChanceStream
from iout_marl.world.placement import (
    draws_layout_once,
    has_chance,
    node_codes,
    pin_layout,
    redraws_every_episode,
)
from iout_marl.world.world import WORLD_VERSION, World

__all__ = [
    "WORLD_VERSION",
    "Chance",
    "ChanceStream",
    "Draw",
    "Events",
    "Grid",
    "LinkBudget",
    "State",
    "World",
    "draws_layout_once",
    "has_chance",
    "node_codes",
    "pin_layout",
    "redraws_every_episode",
]
