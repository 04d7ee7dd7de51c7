"""What an episode is judged by: one description for each metric, in the order of reports.

The world, evaluations, TensorBoard, `metrics.jsonl`, tables, studies, reports and
`docs/metrics.md` take names, units, headings, digits, bounds and tags from here. A user's own
metrics come after the built-in ones, and are shown wherever those are:

    from iout_marl import metrics

    @metrics.register("worst_wait", unit="slots", definition="Highest age of any node at the end.")
    def worst_wait(world, state):
        return world.backend.xp.max(state.age, axis=1)

    @metrics.register("charges", unit="AUV-slots", per_slot=True, definition="Charge.")
    def charges(world, state, events):
        xp = world.backend.xp
        return xp.sum(events.harvested_j > 0, axis=1)
"""

from iout_marl.metrics.builtin import (
    ALL,
    BUILTIN,
    DRAWN,
    OF_TIME,
    TABLED,
)
from iout_marl.metrics.losses import OF_LOSSES
from iout_marl.metrics.metric import Metric
from iout_marl.metrics.registry import curve_title, described, register, registered, unregister
from iout_marl.metrics.stores import OF_STORES
from iout_marl.metrics.vehicles import OF_VEHICLES

__all__ = [
    "ALL",
    "BUILTIN",
    "DRAWN",
    "OF_LOSSES",
    "OF_STORES",
    "OF_TIME",
    "OF_VEHICLES",
    "TABLED",
    "Metric",
    "curve_title",
    "described",
    "register",
    "registered",
    "unregister",
]
