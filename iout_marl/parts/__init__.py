"""Parts: whatever a scenario chooses by its kind. Each is a file of its own, in `parts/<role>/`.

A part of your own is registered from your own file, and named by your scenario:

    from iout_marl import parts

    @parts.rewards.register("peak_age", version=1)
    class PeakAge(parts.Reward):
        class Settings(parts.Settings):
            weight: parts.Positive = 1.0

        def __call__(self, state, events):
            worst = self.xp.max(state.age, axis=-1, keepdims=True)
            return {"age": -self.settings.weight * worst}
"""

import importlib
import pkgutil

from iout_marl.core.reasons import Reason
from iout_marl.parts.absorption import Absorption, absorptions
from iout_marl.parts.access import Access, Request, Uplinks, access_rules
from iout_marl.parts.base import Context, Part, at_work
from iout_marl.parts.beta_rule import BetaRule, beta_rules
from iout_marl.parts.channel import Channel, channels
from iout_marl.parts.current import Current, Frames, Wander, currents
from iout_marl.parts.duplex import Duplex, duplexes
from iout_marl.parts.entry import Entry, entries
from iout_marl.parts.fading import Fading, fadings
from iout_marl.parts.harvester import Harvester, harvesters
from iout_marl.parts.hearing import Call, Heard, Hearing, hearings
from iout_marl.parts.loss import Loss, losses
from iout_marl.parts.motion import Motion, motions
from iout_marl.parts.network import Network, NetworkSizes, networks
from iout_marl.parts.observation import Representation, representations
from iout_marl.parts.optimizer import Optimizer, optimizers
from iout_marl.parts.placement import Placement, placements
from iout_marl.parts.reward import Reward, rewards
from iout_marl.parts.storage import Rest, Storage, storages
from iout_marl.parts.transmission import Transmission, transmissions
from iout_marl.parts.uplink import Uplink, uplinks
from iout_marl.parts.vehicle import Vehicle, vehicles
from iout_marl.parts.wind import Blowing, Wind, winds
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import read_arrays
from iout_marl.scenario.fields import (
    Count,
    Decibels,
    Fraction,
    NonNegative,
    Plausible,
    Positive,
    invalid,
)
from iout_marl.scenario.parts import PartOf, Settings

__all__ = [
    "Absorption",
    "Access",
    "BetaRule",
    "Blowing",
    "Call",
    "Channel",
    "Context",
    "Count",
    "Current",
    "DataFile",
    "Decibels",
    "Duplex",
    "Entry",
    "Fading",
    "Fraction",
    "Frames",
    "Harvester",
    "Heard",
    "Hearing",
    "Loss",
    "Motion",
    "Network",
    "NetworkSizes",
    "NonNegative",
    "Optimizer",
    "Part",
    "PartOf",
    "Placement",
    "Plausible",
    "Positive",
    "Reason",
    "Representation",
    "Request",
    "Rest",
    "Reward",
    "Settings",
    "Storage",
    "Transmission",
    "Uplink",
    "Uplinks",
    "Vehicle",
    "Wander",
    "Wind",
    "absorptions",
    "access_rules",
    "at_work",
    "beta_rules",
    "channels",
    "currents",
    "duplexes",
    "entries",
    "fadings",
    "harvesters",
    "hearings",
    "invalid",
    "losses",
    "motions",
    "networks",
    "optimizers",
    "placements",
    "read_arrays",
    "representations",
    "rewards",
    "storages",
    "transmissions",
    "uplinks",
    "vehicles",
    "winds",
]

# Whatever lies in the folder of a role registers itself; so do the trainer's own parts.
for _name, _path in (
    (__name__, __path__),
    ("trainers.parts", importlib.import_module("trainers.parts").__path__),
):
    for _found in pkgutil.walk_packages(_path, f"{_name}."):
        importlib.import_module(_found.name)
