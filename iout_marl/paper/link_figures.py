"""The link's figures: energies by distance, β* by distance, the appendix's table."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from iout_marl import physics
from iout_marl.paper.paper_data import printed_energies
from iout_marl.report.document import Table
from iout_marl.report.figure import Axis, Line, Plot
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.world import LinkBudget

Floats = npt.NDArray[np.float64]

BETAS = (0.1, 0.5, 0.9)
FREQUENCIES_KHZ = (10, 20, 30, 40, 50, 60)
#: The paper's world in TDD; charging and uplink do not depend on the number of nodes.
SCENARIO = "paper/k10-tdd"
#: Distances of the figure of energies in m.
DISTANCES_M = np.linspace(1, 600, 300)


class TddLink:
    """Charging and uplink of a node in TDD, by distance and β.

    Args:
        frequency_khz: of the band; by default the paper's.
    """

    def __init__(self, frequency_khz: float | None = None) -> None:
        changes = {} if frequency_khz is None else {"duplex.frequency_khz": frequency_khz}
        self.scenario: Scenario = load_scenario(SCENARIO, changes)
        self.budget = LinkBudget(self.scenario)

    def harvested_j(self, distance_m: npt.ArrayLike, beta: float) -> Floats:
        """Energy harvested in a slot, in J."""
        return beta * self.scenario.slot_s * self.budget.harvested_power_w(np.asarray(distance_m))

    def required_j(self, distance_m: npt.ArrayLike, beta: float) -> Floats:
        """Energy that an uplink in the rest of the slot takes, in J."""
        cost = self.budget.power_per_snr_w(np.asarray(distance_m))
        return self.budget.required_energy_j(cost, (1 - beta) * self.scenario.slot_s)

    def balance_distance_m(self, beta: npt.ArrayLike) -> Floats:
        """d*: where an uplink takes just what the same slot harvests, g(β) = h(d)."""
        s = self.scenario
        source_level = physics.source_level_db(
            s.charging.power_w, s.charging.efficiency, s.charging.directivity_index_db
        )
        noise = s.channel.noise_level_db
        kappa_2 = physics.kappa_2(
            float(source_level),
            noise,
            s.harvester.sensitivity_db,
            s.harvester.load_resistance_ohm,
            s.harvester.efficiency,
            s.harvester.hydrophones,
        )
        g = physics.g(np.asarray(beta), s.slot_s, s.uplink.packet_bits, s.uplink.bandwidth_hz)
        attenuation = physics.attenuation_at_balance_db(
            g, float(physics.kappa_3(float(kappa_2), noise))
        )
        absorption = physics.thorp_absorption_db_per_km(self.budget.uplink_frequency_khz)
        return physics.attenuation_distance_m(
            attenuation, float(absorption), s.channel.spreading_factor
        )

    def approximate_j(self, distance_m: npt.ArrayLike) -> Floats:
        """The paper's approximation κ·10^(AL/10), with κ as it prints it, in J."""
        s = self.scenario
        kappa = physics.kappa(s.uplink.packet_bits, s.uplink.bandwidth_hz, s.channel.noise_level_db)
        loss = self.budget.attenuation_db(np.asarray(distance_m), self.budget.uplink_frequency_khz)
        return physics.approximate_required_energy_j(loss, round(float(kappa), 3))


def energies_figure(command: str) -> Plot:
    """Energy harvested and required by distance, for three values of β."""
    link = TddLink()
    x = tuple(DISTANCES_M.tolist())
    lines = [
        Line(f"harvested, β = {beta}", x, tuple(link.harvested_j(x, beta).tolist()), colour=i)
        for i, beta in enumerate(BETAS)
    ]
    lines += [
        Line(
            f"required, β = {beta}",
            x,
            tuple(link.required_j(x, beta).tolist()),
            colour=i,
            dashed=True,
        )
        for i, beta in enumerate(BETAS)
    ]
    crossings = ", ".join(f"{link.balance_distance_m(b):.0f} m for β = {b}" for b in BETAS)
    return Plot(
        key="energies",
        title="Energy harvested and required by distance",
        caption=(
            f"A slot of {link.scenario.slot_s:g} s in TDD at 40 kHz: a share β of it charges, the "
            f"rest is the uplink. They balance at {crossings}. Computed, without chance."
        ),
        command=command,
        x=Axis("Distance in m", limits=(0, 600)),
        y=Axis("Energy in J", scale="log"),
        lines=tuple(lines),
    )


@dataclass(frozen=True)
class BetaStar:
    """β* by distance at one frequency."""

    frequency_khz: float
    beta: Floats
    distance_m: Floats

    @property
    def rises(self) -> bool:
        """Whether d* rises strictly with β, and so β* with distance."""
        return all(near < far for near, far in pairwise(self.distance_m))


@functools.cache
def beta_star_curves() -> tuple[BetaStar, ...]:
    """β* against d* at each frequency, β from 0.1 to 0.9."""
    beta = np.linspace(0.1, 0.9, 161)
    return tuple(BetaStar(f, beta, TddLink(f).balance_distance_m(beta)) for f in FREQUENCIES_KHZ)


def beta_star_figure(command: str) -> Plot:
    """β* against d* for 10 to 60 kHz."""
    curves = beta_star_curves()
    ends = ", ".join(f"{c.distance_m[-1]:.0f} m at {c.frequency_khz:g} kHz" for c in curves)
    return Plot(
        key="beta-star",
        title="β* by distance, at six frequencies",
        caption=(
            "The share of a slot that must charge for the rest of it to pay an uplink "
            f"(g(β) = h(d)). β* reaches 0.9 at {ends}. Computed, without chance."
        ),
        command=command,
        x=Axis("Distance d* in m", scale="log"),
        y=Axis("β*", limits=(0, 1)),
        lines=tuple(
            Line(f"{c.frequency_khz:g} kHz", tuple(c.distance_m.tolist()), tuple(c.beta.tolist()))
            for c in curves
        ),
    )


@dataclass(frozen=True)
class EnergyCell:
    """A cell of the appendix's table: printed and computed."""

    row: int
    column: int
    printed: str
    computed_j: float

    @property
    def agrees(self) -> bool:
        """Whether every printed digit does."""
        decimals = len(self.printed.partition(".")[2])
        return f"{self.computed_j:.{decimals}f}" == self.printed


def energy_cells() -> list[EnergyCell]:
    """All cells of the appendix's table, row by row; column 0 is the approximation."""
    link = TddLink()
    cells = []
    for i, row in enumerate(printed_energies()):
        d = row.distance_m
        cells.append(EnergyCell(i, 0, row.approximated_j, float(link.approximate_j(d))))
        for j, (beta, printed) in enumerate(row.true_j.items(), start=1):
            cells.append(EnergyCell(i, j, printed, float(link.required_j(d, beta))))
    return cells


def normalised_square_error() -> dict[float, float]:
    """The error of the approximation, by β: Σ (E − Ê)²/Σ E² over the table's distances."""
    link = TddLink()
    rows = printed_energies()
    d = [row.distance_m for row in rows]
    errors = {}
    for beta in rows[0].true_j:
        true = link.required_j(d, beta)
        errors[beta] = float(((true - link.approximate_j(d)) ** 2).sum() / (true**2).sum())
    return errors


def energy_table(command: str) -> Table:
    """The appendix's table, printed against computed."""
    rows = printed_energies()
    cells = energy_cells()
    betas = list(rows[0].true_j)
    columns = ["Distance", "Approximation", *(f"β = {beta}" for beta in betas)]
    table = []
    for i, row in enumerate(rows):
        here = [cell for cell in cells if cell.row == i]
        table.append((f"{row.distance_m:g} m, printed", *(cell.printed for cell in here)))
        table.append(("computed", *(f"{cell.computed_j:.4f}" for cell in here)))
    wrong = frozenset((2 * c.row + 1, c.column + 1) for c in cells if not c.agrees)
    agreeing = sum(cell.agrees for cell in cells)
    return Table(
        key="energy-table",
        title="Required energy, printed and computed, in J",
        caption=(
            f"The paper's comparison of true and approximated energy: {agreeing} of {len(cells)} "
            "cells agree in every printed digit; those that do not stand out."
        ),
        command=command,
        columns=tuple(columns),
        rows=tuple(table),
        numeric=frozenset(range(1, len(columns))),
        marked=wrong,
    )


def harvest_and_requirement() -> tuple[bool, bool, float]:
    """What the figure of energies shows.

    Returns:
        whether harvested energy rises with β at every distance; whether it falls with
        distance at every β; the largest relative change of the required energy over β.
    """
    link = TddLink()
    harvested = np.stack([link.harvested_j(DISTANCES_M, beta) for beta in BETAS])
    required = np.stack([link.required_j(DISTANCES_M, beta) for beta in BETAS])
    change = float((required.max(axis=0) / required.min(axis=0) - 1).max())
    rises = bool((np.diff(harvested, axis=0) > 0).all())
    falls = bool((np.diff(harvested, axis=1) < 0).all())
    assert not math.isnan(change)
    return rises, falls, change
