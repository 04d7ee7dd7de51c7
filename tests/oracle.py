"""The world a second time, in scalars and loops, for tests to hold the package against.

Written from the equations of the paper alone (arXiv 2601.08491; the labels below are
those of its source) and the readings that make them reproduce its tables. It shares
nothing with the package but the `Scenario`, from which it takes its numbers. Slow on
purpose: one episode at a time, one node after the other.

Cells are tuples (x, y, z) counted from 1; nodes, AUVs and directions count from 0. Behind the
nodes comes nobody.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from oracle_chance import Sea
from oracle_currents import Water
from oracle_losses import Losses
from oracle_polling import Polls
from oracle_stores import Stores
from oracle_team import Notebook
from oracle_vehicles import Vehicles

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from iout_marl.scenario import Scenario

    Cell = tuple[int, int, int]

#: Steps +x, −x, +y, −y, +z, −z, in the order of eq. `direction`; the last one hovers.
SIX = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1))
REST = (0, 0, 0)
STEPS = {"six": SIX, "hover": (*SIX, REST), "planar": (*SIX[:4], REST)}


def thorp(f: float) -> float:
    """α in dB/km at f kHz, eq. `alpha(f)`."""
    return 0.11 * f**2 / (f**2 + 1) + 44 * f**2 / (f**2 + 4100) + 2.75e-4 * f**2 + 0.003


def francois_garrison(f: float, t: float, s: float, depth: float, ph: float) -> float:
    """α in dB/km at f kHz, after Francois and Garrison (JASA 72, 1982), part II.

    Boric acid, magnesium sulphate and pure water, each a factor for the amount, one
    for the pressure and, but for water, a relaxation frequency in kHz.
    """
    c = 1412 + 3.21 * t + 1.19 * s + 0.0167 * depth
    boric = 8.86 / c * 10 ** (0.78 * ph - 5)
    boric_khz = 2.8 * math.sqrt(s / 35) * 10 ** (4 - 1245 / (273 + t))
    sulphate = 21.44 * s / c * (1 + 0.025 * t) * (1 - 1.37e-4 * depth + 6.2e-9 * depth**2)
    sulphate_khz = 8.17 * 10 ** (8 - 1990 / (273 + t)) / (1 + 0.0018 * (s - 35))
    if t <= 20:
        water = 4.937e-4 - 2.59e-5 * t + 9.11e-7 * t**2 - 1.50e-8 * t**3
    else:
        water = 3.964e-4 - 1.146e-5 * t + 1.45e-7 * t**2 - 6.5e-10 * t**3
    water *= 1 - 3.83e-5 * depth + 4.9e-10 * depth**2
    return (
        boric * boric_khz * f**2 / (boric_khz**2 + f**2)
        + sulphate * sulphate_khz * f**2 / (sulphate_khz**2 + f**2)
        + water * f**2
    )


def ambient_noise_db(f: float, shipping: float, wind_m_per_s: float) -> float:
    """Wenz's noise at f kHz after Coates, in dB re 1 µPa²/Hz."""
    parts = (
        17 - 30 * math.log10(f),  # turbulence
        40 + 20 * (shipping - 0.5) + 26 * math.log10(f) - 60 * math.log10(f + 0.03),
        50 + 7.5 * math.sqrt(wind_m_per_s) + 20 * math.log10(f) - 40 * math.log10(f + 0.4),
        -15 + 20 * math.log10(f),  # thermal
    )
    return 10 * math.log10(sum(10 ** (part / 10) for part in parts))


def integral(function: Callable[[float], float], low: float, high: float) -> float:
    """Simpson's rule in 1000 strips."""
    strip = (high - low) / 1000
    inner = sum((4 if i % 2 else 2) * function(low + i * strip) for i in range(1, 1000))
    return (function(low) + inner + function(high)) * strip / 3


def sign_change(function: Callable[[float], float], low: float, high: float) -> float:
    """Where `function` changes its sign between `low` and `high`, by bisection."""
    sign = function(low) > 0
    for _ in range(55):
        middle = (low + high) / 2
        if (function(middle) > 0) == sign:
            low = middle
        else:
            high = middle
    return high


def summit(function: Callable[[float], float], low: float, high: float) -> float:
    """Where the concave `function` is highest between `low` and `high`, by thirds."""
    for _ in range(60):
        left, right = low + (high - low) / 3, high - (high - low) / 3
        if function(left) < function(right):
            low = left
        else:
            high = right
    return max((low, high), key=function)


def edges(scenario: Scenario) -> tuple[float, ...]:
    """The edges of a cell along x, y and z in m."""
    spacing = scenario.grid.spacing_m
    return tuple(spacing) if isinstance(spacing, tuple) else (spacing,) * 3


def mean_within(a: float, b: float, c: float) -> float:
    """The mean distance of two points in a box.

    With differences u ≥ 0 of density 2 (1 − u) along each edge of length 1, in polar coordinates
    about the corner at which they are 0, where the distance has its tip: the radius by hand, the
    two shares of the far faces by Gauss and Legendre.
    """
    points, weights = np.polynomial.legendre.leggauss(40)
    points, weights = (points + 1) / 2, weights / 2
    total = 0.0
    for face in range(3):  # where the largest difference is the one of this axis
        lengths = [(a, b, c)[(face + i) % 3] for i in range(3)]
        for s, ws in zip(points, weights, strict=True):
            for t, wt in zip(points, weights, strict=True):
                slope = math.sqrt(lengths[0] ** 2 + (s * lengths[1]) ** 2 + (t * lengths[2]) ** 2)
                # ∫ r³ (1 − r)(1 − r s)(1 − r t) dr from 0 to 1
                radial = 1 / 4 - (1 + s + t) / 5 + (s + t + s * t) / 6 - s * t / 7
                total += 8 * ws * wt * slope * radial
    return total


class Way(float):
    """A distance in m that knows its two cells: that of the listener at sea, and the other."""

    cells: tuple[Cell, Cell]

    @classmethod
    def between(cls, metres: float, one: Cell, other: Cell) -> Way:
        way = cls(metres)
        way.cells = one, other
        return way


class Sound:
    """Energies that the channel of a scenario carries over a distance d in m."""

    def __init__(self, scenario: Scenario) -> None:
        self.scenario = scenario
        duplex, channel, uplink = scenario.duplex, scenario.channel, scenario.uplink
        fdd = duplex.kind == "fdd"
        self.charging_khz = duplex.charging_frequency_khz if fdd else duplex.frequency_khz
        self.uplink_khz = duplex.uplink_frequency_khz if fdd else duplex.frequency_khz
        alone = scenario.num_auvs == 1 or channel.access.kind != "orthogonal"
        self.bandwidth_hz = uplink.bandwidth_hz / (1 if alone else scenario.num_auvs)
        self.losses = Losses.from_scenario(scenario)
        self.absorption_db_per_km = {f: self.alpha(f) for f in (self.charging_khz, self.uplink_khz)}
        if channel.kind == "sonar":
            self.noise_level_db = self.noise_band_db(channel.wind_m_per_s)
        else:
            self.noise_level_db = channel.noise_level_db
        # Looking for β asks for the same distance a hundred times. With tables there is more to a
        # way than its length.
        known = (lambda function: function) if self.losses else functools.cache
        self.harvested_w = known(self._harvested_w)
        self.watts_per_snr = known(self._watts_per_snr)

    @functools.cache  # noqa: B019
    def noise_band_db(self, wind_m_per_s: float) -> float:
        """Wenz's noise in the band of an uplink, in dB re 1 µPa²."""
        half_khz, shipping = self.bandwidth_hz / 2000, self.scenario.channel.shipping

        def density(f: float) -> float:
            return 10 ** (ambient_noise_db(f, shipping, wind_m_per_s) / 10)

        band = integral(density, self.uplink_khz - half_khz, self.uplink_khz + half_khz)
        return 10 * math.log10(band * 1000)  # the band in Hz, not kHz

    def alpha(self, f: float) -> float:
        """α in dB/km at f kHz, in the water of the scenario."""
        water = self.scenario.channel.absorption
        if water.kind == "thorp":
            return thorp(f)
        t, s = water.temperature_c, water.salinity_psu
        return francois_garrison(f, t, s, water.depth_m, water.ph)

    def attenuation_db(self, d: float, f: float) -> float:
        """AL: eq. `AL`; `table` without its factor 10, as the appendix has it."""
        if self.losses:
            return self.losses.between_db(*d.cells, f)
        factor = 1 if self.scenario.channel.kind == "table" else 10
        spreading = 0.0
        if d > 1:
            spreading = self.scenario.channel.spreading_factor * factor * math.log10(d)
        return spreading + self.absorption_db_per_km[f] * d / 1000

    def harvested_j(self, d: float, duration_s: float) -> float:
        """Eq. `E harvested`."""
        return self.harvested_w(d) * duration_s

    def _harvested_w(self, d: float) -> float:
        return self.harvested_after_w(self.attenuation_db(d, self.charging_khz))

    def harvested_after_w(self, loss_db: float) -> float:
        """Eqs. `SL`, `RL` and `p harvested`, for all hydrophones, or an aperture."""
        source, harvester = self.scenario.charging, self.scenario.harvester
        sl = 170.8 + 10 * math.log10(source.power_w) + 10 * math.log10(source.efficiency)
        sl += source.directivity_index_db
        rl = sl - loss_db
        if self.scenario.channel.kind != "sonar":
            rl -= self.noise_level_db
        # A plane wave of so many µPa, in sea water of 1025 kg/m³ and 1500 m/s.
        pascal = 10 ** (rl / 20) * 1e-6
        passing_w = math.inf
        if harvester.area_m2 is not None:
            passing_w = harvester.area_m2 * pascal**2 / (1025 * 1500)
            passing_w = min(passing_w, source.power_w * source.efficiency)
        if harvester.kind == "aperture":
            rectified_w = passing_w if passing_w >= harvester.threshold_w else 0.0
            return harvester.efficiency * rectified_w
        available_w = 10 ** ((rl + harvester.sensitivity_db) / 10)
        available_w *= harvester.hydrophones / (4 * harvester.load_resistance_ohm)
        return harvester.efficiency * min(available_w, passing_w)

    def required_j(self, d: float, duration_s: float) -> float:
        """Eqs. `snr`, `p transmit` and `E transmited`; `sonar` through a real projector."""
        if self.scenario.uplink.kind == "modem":
            return self.modem_j(d, duration_s)
        throughput = self.scenario.uplink.packet_bits / duration_s
        snr = 2 ** (throughput / self.bandwidth_hz) - 1
        return snr * self.watts_per_snr(d) * duration_s

    def modem_s(self, d: float) -> float:
        """A packet at the bit rate of a part of the band, and the way there and back."""
        uplink = self.scenario.uplink
        rate = uplink.bit_rate_bps * self.bandwidth_hz / uplink.bandwidth_hz
        return uplink.packet_bits / rate + d / 1500 + d / 1500

    def modem_j(self, d: float, duration_s: float) -> float:
        """Electronics and projector for the airtime; infinite out of reach, or without the time."""
        uplink, channel = self.scenario.uplink, self.scenario.channel
        level = self.noise_level_db + self.attenuation_db(d, self.uplink_khz)
        level += uplink.required_snr_db
        if level > uplink.maximum_source_level_db or self.modem_s(d) > duration_s * (1 + 1e-12):
            return math.inf
        level = min(level + uplink.margin_db, uplink.maximum_source_level_db)
        if not uplink.power_control:
            level = uplink.maximum_source_level_db
        acoustic_w = 10 ** ((level - 170.8 - channel.uplink_directivity_index_db) / 10)
        watts = uplink.electronics_w + acoustic_w / channel.uplink_efficiency
        return watts * (self.modem_s(d) - 2 * d / 1500)

    def _watts_per_snr(self, d: float) -> float:
        """The power with which a node d away is as loud as the noise."""
        channel = self.scenario.channel
        level = self.attenuation_db(d, self.uplink_khz) + self.noise_level_db
        if channel.kind == "sonar":
            level -= 170.8 + channel.uplink_directivity_index_db
            return 10 ** (level / 10) / channel.uplink_efficiency
        return 10 ** (level / 10)

    def charger_watts(self) -> float:
        """An AUV that charges, off its beam, as the power of a node at the same place."""
        charging, channel = self.scenario.charging, self.scenario.channel
        watts = charging.power_w * charging.efficiency
        if channel.kind == "sonar":
            watts /= channel.uplink_efficiency * 10 ** (channel.uplink_directivity_index_db / 10)
        return watts


@dataclass
class Slot:
    """What one AUV did in one slot."""

    charged: int
    heard: int
    left_grid: bool = False
    blocked: bool = False
    #: It could not pay for the next slot of a move that was not over.
    gave_up: bool = False
    beta: float = 0.0
    harvested_j: float = 0.0
    delivered: bool = False
    spent_j: float = 0.0
    #: A node could have paid an uplink to this AUV, after charging.
    some_node_able: bool = False
    #: Two or more AUVs took this node's uplink, among them this one.
    contested: bool = False
    #: Nodes polled beside, nobody where there was no further one; an entry for each round.
    polled: list[int] = field(default_factory=list)
    polled_delivered: list[bool] = field(default_factory=list)
    polled_j: list[float] = field(default_factory=list)
    #: By node: seconds from the start of its packet to the end of the slot, where AUVs poll.
    began_s: dict[int, float] = field(default_factory=dict)

    @property
    def received(self) -> list[int]:
        """The nodes whose packets have arrived."""
        pairs = zip(self.polled, self.polled_delivered, strict=True)
        return [self.heard] * self.delivered + [node for node, arrived in pairs if arrived]


class Oracle:
    """One episode of a scenario with its nodes at `node_cells`."""

    def __init__(self, scenario: Scenario, node_cells: Sequence[Cell]) -> None:
        self.scenario, self.sound = scenario, Sound(scenario)
        self.steps = STEPS[scenario.auvs.motion.kind]
        self.node_cells = [tuple(cell) for cell in node_cells]
        self.auv_cells = [tuple(cell) for cell in scenario.auvs.start_cells[: scenario.num_auvs]]
        while len(self.auv_cells) < scenario.num_auvs:
            self.auv_cells.append(self.loneliest_cell())
        self.nodes, self.auvs = range(scenario.num_nodes), range(scenario.num_auvs)
        self.own_cell_m = 0.0
        if scenario.grid.own_cell_distance == "mean":
            self.own_cell_m = mean_within(*edges(scenario))
        #: Of a distance and a credit.
        self.best_betas: dict[tuple[float, float], float] = {}
        self.slot = 0
        #: Of each AUV under way: its direction, and the slots until it arrives.
        self.transit: list[tuple[int, int] | None] = [None for _ in self.auvs]
        self.age = [scenario.age.initial for _ in self.nodes]
        self.stores = Stores(self)
        self.energy_j = [self.stores.initial_j for _ in self.nodes]
        self.deliveries = [0 for _ in self.nodes]
        self.harvested_j = self.spent_j = 0.0
        self.age_sum = 0.0  # over the slots, of the mean over the nodes
        self.peak_age = self.capped_ages = 0
        self.events: list[Slot] = []
        self.nobody = scenario.num_nodes
        self.vehicles, self.water = Vehicles(self), Water(self)
        self.asked = 0  # uplinks asked for
        self.silenced = 0  # uplinks that fell silent so that others could be heard
        self.sea = Sea(self)
        self.notebooks = [Notebook(self, auv) for auv in self.auvs]

    def loneliest_cell(self) -> Cell:
        """The cell farthest from every AUV so far, the first of them in x, y, z."""
        best, cell = -1, (0, 0, 0)
        nx, ny, nz = self.scenario.grid.cells
        for x in range(1, nx + 1):
            for y in range(1, ny + 1):
                for z in range(1, nz + 1):
                    nearest = min(
                        (x - u) ** 2 + (y - v) ** 2 + (z - w) ** 2 for u, v, w in self.auv_cells
                    )
                    if nearest > best:
                        best, cell = nearest, (x, y, z)
        return cell

    def distance_m(self, auv: int, node: int) -> float:
        return self.between_m(self.auv_cells[auv], self.node_cells[node])

    def between_m(self, one: Cell, other: Cell) -> float:
        """Between the centres of two cells; within a cell what the scenario takes it for."""
        metres = self.own_cell_m
        if one != other:
            metres = math.sqrt(self.squared_shortest(one, other)) * min(edges(self.scenario))
        return Way.between(metres, one, other)

    def squared_shortest(self, one: Cell, other: Cell) -> float:
        """Squared distance of two cells in shortest edges: of cubes a whole number."""
        lengths = edges(self.scenario)
        far = [
            edge / min(lengths) * (a - b) for edge, a, b in zip(lengths, one, other, strict=True)
        ]
        return far[0] ** 2 + far[1] ** 2 + far[2] ** 2

    def step(self, action: Sequence[Sequence[int]], drawn: dict | None = None) -> None:
        """One slot: move, charge, uplink, age. `action` has (direction, nodes…) per AUV."""
        self.sea.begin(drawn or {})
        self.events = [Slot(charged=a[1], heard=a[-1]) for a in action]
        self.vehicles.begin()
        self.water.begin()
        self.move([direction for direction, *_ in action])
        self.vehicles.pay_for_moves()
        if self.scenario.duplex.kind == "tdd":
            for auv, event in enumerate(self.events):
                if event.charged != self.nobody:
                    event.beta = self.splitting(auv, event.charged)
        self.vehicles.pay_for_charging()
        self.charge()
        self.stores.fill()
        able = self.able()
        for auv, event in enumerate(self.events):
            event.some_node_able = any(able[auv])
        self.uplink(able)
        self.stores.rest()
        self.vehicles.dock()
        self.grow_older()
        self.slot += 1
        for notebook in self.notebooks:
            notebook.turn_page()

    def move(self, directions: Sequence[int]) -> None:
        """Eq. `direction`; a move out of the grid leaves the AUV where it is.

        AUVs whose moves end too near one another or swap cells stay, and those that would
        run into one that stays, and so on. A long move is made at its end, one over several cells
        cell by cell.
        """
        walks = []
        for auv, named in enumerate(directions):
            direction, slots_left = self.transit[auv] or (named, self.slots_and_cells(named)[0])
            target, inside = self.ahead(self.auv_cells[auv], direction)
            # In a grid of one cell every direction stays.
            nowhere_to_go = tuple(self.scenario.grid.cells) == (1, 1, 1)
            self.events[auv].left_grid = not (inside or nowhere_to_go)
            if not self.vehicles.can_move(auv, direction):
                self.events[auv].left_grid = False
                self.events[auv].gave_up = self.transit[auv] is not None
                self.transit[auv] = None
                walks.append(self.water.adrift(auv, self.auv_cells[auv]))
                continue
            is_over = slots_left == 1 or target == self.auv_cells[auv]
            self.transit[auv] = None if is_over else (direction, slots_left - 1)
            walks.append([direction] * self.slots_and_cells(direction)[1] if is_over else [])
        while any(walks):
            targets = [
                self.ahead(self.auv_cells[auv], walk.pop())[0] if walk else self.auv_cells[auv]
                for auv, walk in enumerate(walks)
            ]
            while stopped := self.collisions(targets):
                for auv in stopped:
                    self.events[auv].blocked = True
                    targets[auv] = self.auv_cells[auv]
                    walks[auv] = []
            self.auv_cells = targets

    def ahead(self, cell: Cell, direction: int) -> tuple[Cell, bool]:
        """The next cell in a direction, and whether there is one."""
        sizes = self.scenario.grid.cells
        target = tuple(c + step for c, step in zip(cell, self.steps[direction], strict=True))
        inside = all(1 <= c <= n for c, n in zip(target, sizes, strict=True))
        return (target if inside else cell), inside

    def slots_and_cells(self, direction: int) -> tuple[int, int]:
        """How many slots a move takes, and how many cells it covers."""
        way_m = math.hypot(
            *(s * e for s, e in zip(self.steps[direction], edges(self.scenario), strict=True))
        )
        if self.scenario.episode.slot_s is None or not way_m:
            return 1, 1
        a_slot = self.scenario.auvs.speed_m_per_s * self.scenario.episode.slot_s / way_m
        return math.ceil(round(1 / a_slot, 9)), max(math.floor(round(a_slot, 9)), 1)

    def collisions(self, targets: Sequence[Cell]) -> list[int]:
        """AUVs that move and must not."""
        separation, found = self.scenario.auvs.separation_cells, []
        for auv in self.auvs:
            if targets[auv] == self.auv_cells[auv]:
                continue
            for other in self.auvs:
                swap = targets[auv] == self.auv_cells[other] and (
                    targets[other] == self.auv_cells[auv]
                )
                near = math.dist(targets[auv], targets[other]) < separation
                if other != auv and separation > 0 and (swap or near):
                    found.append(auv)
                    break
        return found

    def splitting(self, auv: int, node: int) -> float:
        """β, from the energy stored at the start of the slot (TDD).

        E_harv(β) − E_req(β) is concave in β. Of two roots the smaller one counts.
        """
        return self.splitting_at(self.distance_m(auv, node), self.energy_j[node])

    def splitting_at(self, d: float, stored: float) -> float:
        """`splitting` of a node that is d away and has so much stored."""
        duplex, tau = self.scenario.duplex, self.scenario.slot_s
        low, high = duplex.beta_min, duplex.beta_max
        if duplex.beta_rule.kind == "airtime":
            beta = min(1 - self.sound.modem_s(d) / tau, high)
            has = stored + self.sound.harvested_j(d, beta * tau)
            return beta if beta >= low and has > self.sound.modem_j(d, tau) else 1.0
        suffices = stored > self.sound.required_j(d, tau)
        credit = stored if duplex.beta_rule.kind == "stored" else 0.0

        def surplus(beta: float) -> float:
            harvested = self.sound.harvested_j(d, beta * tau)
            return credit + harvested - self.sound.required_j(d, (1 - beta) * tau)

        if duplex.beta_rule.kind == "stored":
            if suffices:
                return 0.0
            if surplus(low) >= 0:
                return low
            best = self.best_beta(surplus, d, credit)
            return sign_change(surplus, low, best) if surplus(best) >= 0 else 1.0
        best = self.best_beta(surplus, d, credit)
        if surplus(low) <= 0 <= surplus(best):
            return sign_change(surplus, low, best)
        return 0.0 if suffices else 1.0

    def best_beta(self, surplus: Callable[[float], float], d: float, credit: float) -> float:
        """The β of the largest surplus, which is searched for once at a distance and a credit."""
        if (d, credit) not in self.best_betas:
            duplex = self.scenario.duplex
            self.best_betas[d, credit] = summit(surplus, duplex.beta_min, duplex.beta_max)
        return self.best_betas[d, credit]

    def charge(self) -> None:
        """Eq. `energy updating`, e_r: a node takes from every AUV that charges it."""
        tau = self.scenario.slot_s
        fdd = self.scenario.duplex.kind == "fdd"
        for auv, event in enumerate(self.events):
            if event.charged == self.nobody:
                continue
            duration_s = tau if fdd else event.beta * tau
            d = self.distance_m(auv, event.charged)
            event.harvested_j = self.sound.harvested_j(d, duration_s)
            if self.sea.fades:
                loss_db = self.sound.attenuation_db(d, self.sound.charging_khz)
                loss_db = self.sea.harvest_loss_db(auv, event.charged, loss_db)
                event.harvested_j = self.sound.harvested_after_w(loss_db) * duration_s
            self.energy_j[event.charged] += event.harvested_j
            self.harvested_j += event.harvested_j

    def able(self) -> list[list[bool]]:
        """For every AUV and node: could the node pay an uplink over a whole slot?"""
        tau = self.scenario.slot_s

        def pays(auv: int, node: int) -> bool:
            return self.energy_j[node] > self.sound.required_j(self.distance_m(auv, node), tau)

        return [[pays(auv, node) for node in self.nodes] for auv in self.auvs]

    def uplink(self, able: list[list[bool]]) -> None:
        """Each node sends at most once, to the nearest AUV that hears it, on the shared band."""
        fdd = self.scenario.duplex.kind == "fdd"
        self.asked += sum(event.heard != self.nobody for event in self.events)
        sending: dict[int, int] = {}  # AUV: node
        for node in self.nodes:
            takers = []
            for auv, event in enumerate(self.events):
                sends = able[auv][node] if fdd else event.beta < 1
                if self.sea.fades:
                    sends = sends and self.energy_j[node] >= self.alone_j(auv, node)
                if event.heard == node and sends and self.stores.can_send(auv, node):
                    takers.append((self.distance_m(auv, node), self.auv_cells[auv], auv))
            if takers:
                for *_, auv in takers:
                    self.events[auv].contested = len(takers) > 1
                sending[min(takers)[-1]] = node
        if self.scenario.hearing.kind == "polling":
            self.polls = Polls(self, able)
            self.polls.hear(sending)
            self.asked += sum(n != self.nobody for event in self.events for n in event.polled)
            return
        access = self.scenario.channel.access.kind
        alone = {auv: self.alone_j(auv, node) for auv, node in sending.items()}
        if access == "interference" and len(self.auvs) > 1:
            self.share_the_band(sending, alone)
            return
        collided = access == "exclusive" and len(sending) > 1
        for auv, node in sending.items():
            self.pay(auv, node, alone[auv], delivered=not collided)

    def duration_s(self, auv: int) -> float:
        fdd, tau = self.scenario.duplex.kind == "fdd", self.scenario.slot_s
        return tau if fdd else (1 - self.events[auv].beta) * tau

    def alone_j(self, auv: int, node: int) -> float:
        return self.sound.required_j(self.distance_m(auv, node), self.duration_s(auv))

    def pay(self, auv: int, node: int, energy_j: float, *, delivered: bool) -> None:
        event = self.events[auv]
        self.count_sent()
        delivered = delivered and self.sea.arrives(auv, node, 0)
        event.delivered, event.spent_j = delivered, energy_j
        self.take(node, energy_j)

    def count_sent(self) -> None:
        if self.sea.loses:
            self.sea.packets[0] += 1

    def packet_j(self, auv: int, node: int) -> float:
        """Energy of a packet that takes a time of its own."""
        return self.sound.required_j(self.distance_m(auv, node), self.scenario.slot_s)

    def take(self, node: int, energy_j: float) -> None:
        self.energy_j[node] = max(0.0, self.energy_j[node] - energy_j)
        self.spent_j += energy_j

    def share_the_band(self, sending: dict[int, int], alone: dict[int, float]) -> None:
        """Powers raised step by step until all are heard; if they cannot be, one falls silent."""
        while sending:
            energy = {auv: alone[auv] for auv in sending}
            failed = False
            for _ in range(10_000):
                before = dict(energy)
                for auv in sending:
                    noise = 1.0 + self.charging_noise(auv)
                    for other, node in sending.items():
                        if other != auv:
                            watts = before[other] / self.duration_s(other)
                            noise += watts / self.sound.watts_per_snr(self.distance_m(auv, node))
                    energy[auv] = alone[auv] * noise
                # The powers only rise: what is too dear now is too dear in the end.
                failed = any(
                    energy[auv] > alone[auv] and energy[auv] > self.energy_j[node]
                    for auv, node in sending.items()
                )
                if failed or all(energy[a] <= before[a] * (1 + 1e-15) for a in sending):
                    break
            if not failed:
                break
            ways = {a: self.distance_m(a, node) for a, node in sending.items()}
            weak = {a: self.sound.watts_per_snr(way) for a, way in ways.items()}
            silent = min(sending, key=lambda a: (-weak[a], self.auv_cells[a]))
            self.silenced += 1
            sending = {auv: node for auv, node in sending.items() if auv != silent}
        for auv, node in sending.items():
            self.pay(auv, node, energy[auv], delivered=True)

    def charging_noise(self, auv: int) -> float:
        """What AUVs that still charge while this one listens add to the noise (TDD)."""
        duplex = self.scenario.duplex
        if duplex.kind == "fdd" or duplex.synchronised:
            return 0.0
        noise = 0.0
        for other in self.auvs:
            if self.events[other].beta > self.events[auv].beta:
                apart = self.between_m(self.auv_cells[auv], self.auv_cells[other])
                noise += self.sound.charger_watts() / self.sound.watts_per_snr(apart)
        return noise

    def grow_older(self) -> None:
        """Eq. `AOI_CALC`, ages held at A_max; D_T(k) of eq. `jain fairness J`."""
        maximum = self.scenario.age.maximum
        over_time, integral_of_ages = self.scenario.age.sampling == "packet_start", 0.0
        for node in self.nodes:
            before = self.age[node]
            if over_time:
                integral_of_ages += integral(lambda t, a=before: min(a + t, maximum), 0, 1)
                self.peak_age = max(self.peak_age, min(before + 1, maximum))
            takers = [a for a, e in enumerate(self.events) if node in e.received]
            if takers:
                self.age[node] = self.packet_age(takers[0], node) if over_time else 1
                self.deliveries[node] += 1
            else:
                self.capped_ages += before + 1 > maximum
                self.age[node] = min(before + 1, maximum)
        if over_time:
            self.age_sum += integral_of_ages / len(self.nodes)
        else:
            self.age_sum += sum(self.age) / len(self.nodes)
            self.peak_age = max(self.peak_age, *self.age)

    def packet_age(self, auv: int, node: int) -> float:
        """Slots from the start of a packet to the end of the slot, and of its last packet."""
        if self.scenario.hearing.kind == "polling":
            return self.events[auv].began_s[node] / self.scenario.slot_s
        own_s = self.scenario.uplink.kind == "modem" and self.sound.modem_s(
            self.distance_m(auv, node)
        )
        return (own_s or self.duration_s(auv)) / self.scenario.slot_s

    def jain(self) -> float:
        """Eq. `jain fairness J`; 0 before any delivery."""
        squares = sum(n**2 for n in self.deliveries)
        return sum(self.deliveries) ** 2 / (len(self.nodes) * squares) if squares else 0.0

    def reward_terms(self) -> dict[str, list[float]]:
        """Eqs. `reward function` and `penalty …` for the slot just stepped, for each AUV."""
        reward = self.scenario.reward
        ages = [self.age_term(self.age, self.jain()) for _ in self.auvs]
        jains = [self.jain() - 1 for _ in self.auvs]
        if reward.credit == "difference":
            for auv, book in enumerate(self.notebooks):
                ages[auv] -= self.age_term(book.age_without, book.jain_without())
                jains[auv] -= book.jain_without() - 1
        if reward.kind == "mean_age":
            fairness = [reward.fairness_weight * jain for jain in jains]
            terms = {"age": ages} | ({"fairness": fairness} if reward.fairness_weight else {})
            return terms | self.vehicles.reward_terms()
        fair_share = self.scenario.num_slots / len(self.nodes)
        terms = {
            "age": ages,
            "location": [-reward.location_penalty * e.left_grid for e in self.events],
            "information": [-self.information_penalty(event) for event in self.events],
            "occurrence": [
                -reward.occurrence_penalty
                * sum(self.deliveries[node] > fair_share for node in event.received)
                for event in self.events
            ],
        }
        if len(self.auvs) > 1:
            terms["separation"] = [-reward.separation_penalty * e.blocked for e in self.events]
        if reward.unserved_penalty:
            unserved = self.deliveries.count(0)
            terms["unserved"] = [-reward.unserved_penalty * unserved for _ in self.auvs]
        return terms | self.vehicles.reward_terms()

    def age_term(self, age: Sequence[float], jain: float) -> float:
        """The first term of eq. `reward function`, or the mean age alone."""
        reward, weights = self.scenario.reward, self.scenario.node_weights
        mean = sum(weights[k] * age[k] for k in self.nodes) / len(self.nodes)
        return -mean if reward.kind == "mean_age" else -reward.age_weight * (1 - jain) * mean

    def information_penalty(self, event: Slot) -> float:
        """Eqs. `penalty for missed information fdd` and `… tdd`."""
        reward = self.scenario.reward
        if event.heard == self.nobody:
            return 0.0
        if self.scenario.duplex.kind == "tdd":
            penalties = {1.0: reward.only_charging_penalty, 0.0: reward.only_transmitting_penalty}
            return penalties.get(event.beta, 0.0)
        if event.delivered:
            return 0.0
        return reward.wrong_node_penalty if event.some_node_able else reward.no_able_node_penalty

    def metrics(self) -> dict[str, float]:
        """Figures of the episode so far, after at least one slot."""
        jain = self.jain()
        return {
            "mean_aoi": self.age_sum / self.slot,
            "final_aoi": sum(self.age) / len(self.nodes),
            "peak_aoi": self.peak_age,
            "jain": jain,
            "harvested_kj": self.harvested_j / 1000,
            "spent_kj": self.spent_j / 1000,
            "uplink_success": sum(self.deliveries) / max(self.asked, 1),
            "age_violations": self.capped_ages,
            "jain_violation": float(jain < self.scenario.fairness.minimum_jain),
            **self.stores.metrics(),
            **self.seconds(),
            **self.vehicles.metrics(),
            **self.sea.metrics(),
        }

    def seconds(self) -> dict[str, float]:
        """Figures of worlds whose slots say little."""
        scenario = self.scenario
        if scenario.episode.slot_s is None and scenario.age.sampling == "slot_end":
            return {}
        return {"mean_aoi_s": self.age_sum / self.slot * scenario.slot_s}

    def observe(self) -> list[list[float]]:
        """What each AUV sees."""
        return [notebook.observation() for notebook in self.notebooks]
