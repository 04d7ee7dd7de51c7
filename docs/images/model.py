"""Makes the figures of docs/model.md, in `model/` beside it, from the physics: `make images`."""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyArrowPatch, Rectangle
from PIL import Image

from iout_marl import World, load_scenario, physics
from iout_marl.core.budget import LinkBudget
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline
from iout_marl.render.style import COLOURS

FOLDER = Path(__file__).parent / "model"
BLUE, ORANGE, GREEN, RED = COLOURS[:4]
#: Distances in the paper's grid, of 1000 m × 1000 m × 400 m.
METRES = np.linspace(1, 1400, 400)


def _figure(columns: int = 1, height: float = 3.2) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(8, height), dpi=110, layout="constrained")
    axes = figure.subplots(1, columns, squeeze=False)[0]
    return figure, list(axes)


def _named(axes: Axes, x: str, y: str, title: str = "") -> None:
    axes.set(xlabel=x, ylabel=y, title=title)
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)


def system() -> Figure:
    """The system: what goes on in a slot, and what each quantity belongs to."""
    figure, (axes,) = _figure(height=3.8)
    axes.set(xlim=(0, 12), ylim=(0, 5.4))
    axes.axis("off")
    axes.add_patch(Rectangle((0, 0), 12, 0.4, color="#b8a88a"))
    axes.axhline(5.0, color="#5b8fb9", lw=2)
    axes.text(0.1, 5.08, "surface, z = 0", fontsize=8, va="bottom")
    axes.text(0.1, 0.2, "sea floor", fontsize=8, va="center")
    auv, charged, heard = (6.0, 3.9), (2.4, 0.9), (10.0, 0.9)
    axes.add_patch(Rectangle((5.2, 3.6), 1.6, 0.6, fc="#444444", ec="none"))
    axes.text(*auv, "AUV", color="white", ha="center", va="center", fontsize=9)
    for place, name in ((charged, "node k"), (heard, "node j")):
        axes.add_patch(Circle(place, 0.32, fc="white", ec="#444444", lw=1.5))
        axes.text(*place, name[-1], ha="center", va="center", fontsize=9)
    for start, end, colour in (((5.4, 3.5), (2.7, 1.2), ORANGE), ((9.7, 1.2), (6.6, 3.5), BLUE)):
        axes.add_patch(
            FancyArrowPatch(start, end, arrowstyle="-|>", mutation_scale=16, color=colour, lw=2.5)
        )
    texts = [
        (4.9, 4.35, "P_elec, η, DI → SL", ORANGE, "right"),
        (3.6, 2.75, "loss AL(d)", ORANGE, "right"),
        (2.0, 1.35, "RL, RVS → P_harv", ORANGE, "right"),
        (2.9, 0.72, "stores E_k, age A_k", "#444444", "left"),
        (8.6, 2.75, "loss AL(d), noise NL", BLUE, "left"),
        (10.3, 1.35, "P_trans → E_req", BLUE, "left"),
        (9.5, 0.72, "packet of L_t bits, age A_j → 1", "#444444", "right"),
        (7.0, 4.35, "SNR γ in the band B", BLUE, "left"),
    ]
    for x, y, text, colour, side in texts:
        axes.text(x, y, text, color=colour, ha=side, va="center", fontsize=9)
    axes.text(6.0, 4.75, "one cell a slot, τ = cell / speed", ha="center", va="center", fontsize=8)
    return figure


def slots() -> Figure:
    """What fills a slot in FDD and in TDD."""
    figure, (axes,) = _figure(height=2.2)
    axes.set(xlim=(-0.16, 1.06), ylim=(0, 3.4))
    axes.axis("off")
    bars = [
        (2.55, 0.0, 1.0, ORANGE, "charging of node k, at f_E"),
        (1.75, 0.0, 1.0, BLUE, "uplink of node j, at f_I"),
        (0.55, 0.0, 0.4, ORANGE, "charging, βτ"),
        (0.55, 0.4, 0.6, BLUE, "uplink, (1 − β)τ, of the same node"),
    ]
    for y, x, width, colour, text in bars:
        axes.add_patch(Rectangle((x, y), width, 0.65, fc=colour, ec="white", lw=2))
        axes.text(
            x + width / 2, y + 0.33, text, color="white", ha="center", va="center", fontsize=9
        )
    axes.text(-0.02, 2.5, "FDD", ha="right", va="center", weight="bold")
    axes.text(-0.02, 0.88, "TDD", ha="right", va="center", weight="bold")
    axes.annotate("", (1, 0.25), (0, 0.25), arrowprops={"arrowstyle": "<->"})
    axes.text(0.5, 0.02, "a slot of τ seconds", ha="center", va="center", fontsize=9)
    return figure


def loss() -> Figure:
    """Absorption by frequency, and the attenuation by distance in each convention."""
    figure, (left, right) = _figure(2)
    khz = np.logspace(0, 2.3, 200)
    left.loglog(khz, physics.thorp_absorption_db_per_km(khz), color=BLUE, label="thorp")
    sea = physics.francois_garrison_absorption_db_per_km(khz, 10.0, 35.0, 100.0, 8.0)
    left.loglog(khz, sea, "--", color=RED, label="francois_garrison, 10 °C, 35 PSU, 100 m")
    _named(left, "Frequency in kHz", "Absorption α in dB/km")
    left.legend(fontsize=7, frameon=False)
    alpha = float(physics.thorp_absorption_db_per_km(40.0))
    right.plot(
        METRES,
        physics.transmission_loss_db(METRES, alpha),
        "--",
        color=RED,
        label="equation, sonar: 10 k_s log₁₀ d + α d",
    )
    right.plot(
        METRES,
        physics.table_attenuation_db(METRES, alpha),
        color=BLUE,
        label="table: k_s log₁₀ d + α d",
    )
    _named(right, "Distance in m", "Attenuation in dB, at 40 kHz")
    right.legend(fontsize=7, frameon=False)
    return figure


def noise() -> Figure:
    """The ambient noise that `channel.kind: sonar` integrates over the uplink's band."""
    figure, (axes,) = _figure()
    khz = np.logspace(-1, 2.5, 300)
    looks = [(0.0, 0.0, BLUE, "-"), (0.5, 5.0, ORANGE, "--"), (1.0, 15.0, RED, "-.")]
    for shipping, wind, colour, dashes in looks:
        level = physics.ambient_noise_spectral_level_db(khz, shipping, wind)
        label = f"shipping {shipping:g}, wind {wind:g} m/s"
        axes.semilogx(khz, level, dashes, color=colour, label=label)
    axes.axvspan(28.5, 31.5, color="0.85")
    axes.text(27, 72, "a band of 3 kHz\naround 30 kHz", fontsize=8, ha="right")
    _named(axes, "Frequency in kHz", "Noise in dB re 1 µPa²/Hz")
    axes.legend(fontsize=8, frameon=False)
    return figure


def energy() -> Figure:
    """What a slot of charging brings, and what an uplink over a whole slot takes, by distance."""
    figure, both = _figure(2)
    worlds = {
        "table (the paper's)": [],
        "sonar, the same hardware": ["channel={kind: sonar}"],
    }
    for axes, (title, changes) in zip(both, worlds.items(), strict=True):
        scenario = load_scenario("paper/k10-fdd", changes)
        budget = LinkBudget(scenario)
        brought = budget.harvested_power_w(METRES) * scenario.slot_s
        taken = budget.required_energy_j(budget.power_per_snr_w(METRES), scenario.slot_s)
        axes.semilogy(METRES, brought, color=ORANGE, label="harvested in a slot")
        axes.semilogy(METRES, taken, "--", color=BLUE, label="taken by an uplink")
        _named(axes, "Distance in m", "Energy in J", title)
        axes.legend(fontsize=8, frameon=False)
    return figure


def beta() -> Figure:
    """The energy balance of TDD at one distance, and the root of it by distance."""
    figure, (left, right) = _figure(2)
    scenario = load_scenario("paper/k10-tdd")
    budget, uplink, slot_s = LinkBudget(scenario), scenario.uplink, scenario.slot_s
    shares = np.linspace(0.01, 0.97, 300)
    distance_m = 200.0
    harvested_w = float(budget.harvested_power_w(distance_m))
    cost_w = float(budget.power_per_snr_w(distance_m))
    left.plot(shares, shares * slot_s * harvested_w, color=ORANGE, label="E_harv(β)")
    required = budget.required_energy_j(cost_w, (1 - shares) * slot_s)
    left.plot(shares, required, "--", color=BLUE, label="E_req(β)")
    slot = slot_s, uplink.packet_bits, uplink.bandwidth_hz
    root = float(physics.beta_star(harvested_w, cost_w, *slot))
    if not np.isnan(root):
        left.axvline(root, color="0.5", lw=1)
        left.text(root + 0.02, 0.02, f"β* = {root:.2f}", transform=left.get_xaxis_transform())
    _named(left, "Share β of the slot", "Energy in J", f"{distance_m:g} m, empty store")
    left.legend(fontsize=8, frameon=False, loc="upper left")
    harvested, cost = budget.harvested_power_w(METRES), budget.power_per_snr_w(METRES)
    right.plot(METRES, physics.beta_star(harvested, cost, *slot), color=GREEN)
    right.set_ylim(0, 1)
    _named(right, "Distance in m", "β*, where there is one", "paper/k10-tdd")
    return figure


def episode() -> Figure:
    """Age and stored energy of one node, while the baseline `tour` plays."""
    figure, (above, below) = _figure(2)
    world = World(load_scenario("paper/k10-fdd"))
    node, states = 4, [state for state, _ in play(world, make_baseline("tour"), 0)]
    ages = [float(state.age[0, node]) for state in states]
    means = [float(state.mean_age[0]) for state in states]
    stored = [float(state.energy_j[0, node]) for state in states]
    above.step(range(len(ages)), ages, color=BLUE, label=f"node {node + 1}")
    above.plot(means, "--", color="0.4", label="mean of all nodes")
    _named(above, "Slot", "Age in slots")
    above.legend(fontsize=8, frameon=False)
    below.step(range(len(stored)), stored, color=ORANGE)
    _named(below, "Slot", f"Stored energy of node {node + 1} in J")
    return figure


FIGURES: dict[str, Callable[[], Figure]] = {
    figure.__name__: figure for figure in (system, slots, loss, noise, energy, beta, episode)
}


def pixels(name: str) -> npt.NDArray[np.uint8]:
    """A figure as (height, width, 3)."""
    stream: Any = io.BytesIO()
    FIGURES[name]().savefig(stream, format="png")
    return np.asarray(Image.open(stream).convert("RGB"))


def main() -> None:
    """Make all figures."""
    for name in FIGURES:
        Image.fromarray(pixels(name)).quantize(64).save(FOLDER / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
