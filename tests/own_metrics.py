"""Metrics of a user's: one of the state, two summed over slots, of flags and of numbers."""

from iout_marl import metrics

OWN = ("worst_wait", "failed", "drained_j")


def register_own():
    @metrics.register(
        "worst_wait", unit="slots", definition="Highest age at the end.", better="less", low=0
    )
    def worst_wait(world, state):
        return world.backend.xp.max(state.age, axis=1)

    @metrics.register("failed", unit="", definition="Uplinks that fail.", per_slot=True, digits=0)
    def failed(world, state, events):
        return world.backend.xp.sum(~events.delivered, axis=1)

    @metrics.register(
        "drained_j",
        unit="J",
        definition="Energy that is left, less what was harvested, slot by slot.",
        per_slot=True,
        heading="<b>drained",
    )
    def drained_j(world, state, events):
        xp = world.backend.xp
        return xp.sum(state.energy_j, axis=1) - 2 * xp.sum(events.harvested_j, axis=1)
