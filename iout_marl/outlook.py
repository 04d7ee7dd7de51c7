"""Whether energy matters in a scenario at all: what the tables of its links say beforehand."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from iout_marl.arrays.backend import Backend
from iout_marl.core.grid import Grid
from iout_marl.core.limits import DEAREST_J
from iout_marl.core.link import Link, SlotEnergies
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario

#: Pairs of a cell and a node that are looked at one by one; of more, all that the grid has.
MAX_PAIRS = 5_000_000
#: Energies from which on a figure says no more, in J.
BEYOND_J = 1e36


def energy_outlook(scenario: Scenario) -> str | None:
    """One line where energy can never bind, or never suffice; None where it matters.

    It never binds where the harvest of any one slot pays for any uplink: charging the node that
    is heard is then always enough. By the paper's rule for β, which leaves a slot to one of the
    two where the least β harvests more than enough, the harvest of one slot must pay for an
    uplink in all of them. AUVs that disturb one another make uplinks dearer than they are here.

    Of stores and vehicles with limits, and of levels that fade, that is never said: what is
    harvested may not be kept, or be little, and an AUV may have nothing to charge with. Where
    stores hold less than the cheapest uplink takes, or lose in a slot what is harvested in it, or
    no battery pays for a slot of charging, it is said.

    It never suffices where an uplink takes more than a node could harvest in a whole episode.

    Args:
        scenario: any scenario that has been accepted.
    """
    grid = Grid.from_scenario(scenario)
    try:
        with np.errstate(all="ignore"):  # what overflows is too dear, what vanishes is nothing
            link = Link(scenario, grid, Backend.from_library())
            return _outlook(scenario, link, _offsets(scenario, grid, link))
    except InputError as error:
        return f"no world can be made of this scenario: {error}"


def _outlook(scenario: Scenario, link: Link, offsets: npt.NDArray[np.int64]) -> str | None:
    fading, harvested_w = scenario.channel.part.fading, link.harvested_w
    if fading.is_active:
        # The most that it ever is: all that is said of it then is that it is too little.
        loss_db = link.charging_loss_db - fading.most_db
        harvested_w = link.budget.harvested_after_loss_w(loss_db)
    harvest_j = np.nan_to_num(harvested_w[offsets] * link.slot_s)
    uplink_j = np.nan_to_num(link.slot_uplink_j[offsets], nan=np.inf)
    poorest, richest, dearest = harvest_j.min(), harvest_j.max(), uplink_j.max()
    slots = scenario.num_slots
    bounds = f"a slot harvests {_joules(poorest)} to {_joules(richest)}"
    energies = SlotEnergies(link, offsets, poorest, dearest, slots)
    storage, vehicle = scenario.storage.part, scenario.vehicle.part
    is_unlimited = not (storage.is_limited or vehicle.is_limited or fading.is_active)
    if is_unlimited and scenario.duplex.part.energy_never_binds(energies):
        disturbed = scenario.num_auvs > 1 and scenario.channel.part.access.uplinks_disturb
        when = "bind only where uplinks disturb one another" if disturbed else "never bind"
        uplink = f"the dearest uplink takes {_joules(dearest)}" + " alone" * disturbed
        return f"energy can {when}: {bounds}, and {uplink}"
    if richest == 0:
        return "no node can ever be charged: from no cell that AUVs reach does one harvest anything"
    if vehicle.is_limited and not scenario.duplex.part.splits_slot:
        battery_j = vehicle.capacity_j if vehicle.docks else vehicle.initial_j
        takes_j = (vehicle.hotel_w + scenario.charging.power_w) * link.slot_s
        if battery_j < takes_j:
            return (
                "no node can ever be charged: a slot of charging and hotel load takes "
                f"{_joules(takes_j)}, and the battery of an AUV has {_joules(battery_j)}"
            )
    has_range = not scenario.uplink.part.fills_its_time
    if has_range and uplink_j.min() >= DEAREST_J:
        return "no node can ever be heard: from every cell that AUVs reach each is out of range"
    if storage.capacity_j is not None and storage.capacity_j <= uplink_j.min():
        return (
            f"nothing can ever be delivered: a store holds {_joules(storage.capacity_j)}, and the "
            f"cheapest uplink takes {_joules(uplink_j.min())}"
        )
    # All AUVs may charge one node.
    together, drain_j = richest * scenario.num_auvs, storage.drain_w * link.slot_s
    if 0 < drain_j >= together:
        what, cheapest = "no node can save energy from slot to slot", ""
        if storage.most_j(together) <= uplink_j.min():
            what = "nothing can ever be delivered"
            cheapest = f", and the cheapest uplink takes {_joules(uplink_j.min())}"
        return (
            f"{what}: leakage and idle draw take {_joules(drain_j)} in a slot, which harvests at "
            f"most {_joules(together)}{cheapest}"
        )
    # They may do so through the whole episode.
    charges = slots * scenario.num_auvs
    most_j = storage.most_j(richest * charges)
    most = f"all {slots:,} slots of an episode bring"
    if most_j == storage.capacity_j:
        most = f"a store holds, {_joules(most_j)}"
    if most_j <= uplink_j.min():
        return (
            f"nothing can ever be delivered: {bounds}, and the cheapest uplink takes "
            f"{_joules(uplink_j.min())}, more than {most}"
        )
    away = link.way_m[offsets] > 0
    if not away.any():
        return None
    nearest_m = float(link.distance_m[offsets][away].min())
    if most_j <= uplink_j[away].min():
        takes = f"an uplink takes {_joules(uplink_j[away].min())}, more than {most}"
        if has_range and uplink_j[away].min() >= DEAREST_J:
            takes = "it is out of range"
        return (
            f"a node can be heard from its own cell alone: from the next one {takes} "
            f"({_loss(link, nearest_m, link.budget.uplink_frequency_khz)})"
        )
    if storage.most_j(harvest_j[away].max() * charges) <= uplink_j.min():
        return (
            f"a node can be charged from its own cell alone: from the next one a slot brings "
            f"{_joules(harvest_j[away].max())}, and the cheapest uplink takes "
            f"{_joules(uplink_j.min())} "
            f"({_loss(link, nearest_m, link.budget.charging_frequency_khz)})"
        )
    return None


def _offsets(scenario: Scenario, grid: Grid, link: Link) -> npt.NDArray[np.int64]:
    """Indices of the links between any cell that AUVs may reach and any node.

    Entries that no pair has are as within one cell.
    """
    placement = scenario.nodes.part
    every = np.arange(len(link.way_m))
    if placement.redraws != "never" or grid.num_cells * scenario.num_nodes > MAX_PAIRS:
        return every
    cells = grid.encode(_reached(scenario, grid))
    given = grid.encode(placement.draw(grid, np.random.default_rng(0)))
    return np.unique(link.offset(cells[:, None], given))


def _reached(scenario: Scenario, grid: Grid) -> npt.NDArray[np.int64]:
    """Coordinates of cells, (cells, 3), beside which AUVs reach no other.

    Along axes that no direction leads along they keep the coordinates of their starts.
    """
    cells, starts = grid.all_coordinates(), scenario.starts()
    for axis in np.flatnonzero(~np.array(scenario.auvs.motion.part.axes_moved)):
        cells = cells[np.isin(cells[:, axis], starts[:, axis])]
    return cells


def _loss(link: Link, distance_m: float, frequency_khz: float) -> str:
    loss_db = link.loss_db(distance_m, frequency_khz)
    return f"over {distance_m:g} m sound of {frequency_khz:g} kHz loses {loss_db:,.0f} dB"


def _joules(energy_j: float) -> str:
    return f"{energy_j:.3g} J" if energy_j < BEYOND_J else f"more than {BEYOND_J:g} J"
