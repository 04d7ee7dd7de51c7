"""A made-up report that uses all a report can hold. Its numbers mean nothing."""

import math

from iout_marl.report.document import Answer, Answers, Report, Section, Table
from iout_marl.report.figure import Axis, Line, Plot, TrajectoryPlot
from iout_marl.trajectory import Trajectory

NAN = math.nan
COMMAND = "iout reproduce --seeds 1-5 --only 'fig5 & fig6' --out runs/<name>"
AWKWARD = 'Claims about "K < 10" & `mean AoI > 3` with <b>no</b> markup, ω̄ ≥ 0.5, $5'


def wave(phase, points=60, scale=1.0):
    """A noisy-looking curve that is the same everywhere."""
    return tuple(
        scale * (20 + 30 * math.exp(-i / 14) + 2.5 * math.sin(i / 2 + phase)) for i in range(points)
    )


def banded(name, phase, holes=(), **options):
    """A curve with intervals, but for the points in `holes`."""
    y = wave(phase)
    low = tuple(NAN if i in holes else value - 2 - i / 40 for i, value in enumerate(y))
    high = tuple(NAN if i in holes else value + 2 + i / 40 for i, value in enumerate(y))
    return Line(name, tuple(1e5 * i for i in range(len(y))), y, low, high, **options)


TRAINING = Plot(
    key="fig4-training",
    title="Training curves: PPO in FDD & TDD",
    caption="Mean AoI of 5 seeds, 20 episodes each; bands are 95 % intervals of the mean over "
    "seeds (Student's t, `df = 4`). Where a seed has failed, no interval is drawn.",
    command=COMMAND,
    x=Axis("environment steps"),
    y=Axis("mean AoI in slots"),
    lines=(
        banded("PPO, FDD", 0),
        banded("PPO, TDD", 1.5, holes=(20, 21, 22, 40)),
        Line("greedy <charge first> & hear", (0.0, 5.9e6), (27.0, 27.0), dashed=True, colour=2),
        Line("random walk", (0.0, 5.9e6), (46.0, 46.0), dashed=True, colour=3),
    ),
)
NODES = Plot(
    key="fig5-nodes",
    title="Mean AoI over the number of nodes K",
    caption="Bars are 95 % intervals; K = 10 of `round-robin` was run once and has none.",
    command=COMMAND,
    x=Axis("number of nodes K", ticks_at_values=True),
    y=Axis("mean AoI in slots", limits=(0, 40)),
    lines=tuple(
        Line(
            f"{name}, {duplex}",
            (3, 5, 7, 10),
            tuple(base + 2.1 * i for i in range(4)),
            (*tuple(base + 2.1 * i - 0.9 for i in range(3)), NAN),
            (*tuple(base + 2.1 * i + 0.9 for i in range(3)), NAN),
            dashed=duplex == "TDD",
            colour=colour,
            in_legend=True,
        )
        for colour, (name, start) in enumerate(
            (("PPO", 8.0), ("greedy", 12.0), ("round-robin", 18.0), ("random walk", 27.0))
        )
        for duplex, base in (("FDD", start), ("TDD", start + 1.2))
    ),
)
BARS = Plot(
    key="fig6-energy",
    title="Harvested energy by method",
    caption="Total of an episode. ηₑ = 0.7; intervals over seeds.",
    command="iout reproduce --only fig6",
    x=Axis("number of nodes K", scale="categories"),
    y=Axis("energy in kJ"),
    lines=(
        Line("PPO", (3, 5, 10), (12.0, 19.0, 31.0), (11.0, 17.5, 29.0), (13.0, 20.5, 33.0)),
        Line("greedy", (3, 5, 10), (9.0, 14.0, 22.0), (8.0, NAN, 20.0), (10.0, NAN, 24.0)),
        Line("random walk", (3, 5, 10), (2.0, 3.1, 4.2), dashed=True),
    ),
)
LOG_BARS = Plot(
    key="speed",
    title="Steps per second",
    caption="Batched and unbatched, on a logarithmic scale.",
    command="make bench",
    x=Axis("environments at once", scale="categories"),
    y=Axis("steps per second", scale="log"),
    lines=(
        Line("this environment", (1, 64, 4096), (310.0, 14_000.0, 210_000.0)),
        Line("scalar loops", (1, 64, 4096), (290.0, 300.0, 301.0)),
    ),
)
LOG = Plot(
    key="appendix.power_law",
    title="Received power over range",
    caption="Both axes are logarithmic; the interval of the last points reaches below 0.",
    command="iout reproduce --only ranges",
    x=Axis("range in m", scale="log", limits=(1, 2000)),
    y=Axis("received power in W", scale="log"),
    lines=(
        Line(
            "spherical spreading, 20·log₁₀(r) + α·r",
            tuple(2.0**i for i in range(11)),
            tuple(3.0 / 4**i for i in range(11)),
            tuple(3.0 / 4**i * (0.8 if i < 8 else -0.5) for i in range(11)),
            tuple(3.0 / 4**i * 1.3 for i in range(11)),
        ),
        Line("measured in a basin", (1, 10, 100), (2.0, 0.03, 0.0), colour=4, dashed=True),
        Line("measured in a basin", (200, 900), (1e-5, 1e-6), colour=4, in_legend=False),
    ),
)


def _trajectory(slots=120):
    nodes = ((2, 2, 4), (9, 3, 3), (5, 9, 5), (8, 8, 1))
    x, y, z = 5, 5, 2
    path, charged, heard, delivered, ages = [[(x, y, z)]], [], [], [], []
    age = [1] * len(nodes)
    for slot in range(slots):
        goal = nodes[slot // 15 % len(nodes)]
        x += (goal[0] > x) - (goal[0] < x)
        y += ((goal[1] > y) - (goal[1] < y)) * (slot % 2)
        z += ((goal[2] > z) - (goal[2] < z)) * (slot % 3 == 0)
        near = slot // 15 % len(nodes) + 1
        hears = near if slot % 4 == 3 else 0
        arrived = hears > 0 and slot % 12 != 11
        age = [1 if arrived and i + 1 == hears else value + 1 for i, value in enumerate(age)]
        path.append([(x, y, z)])
        charged.append([near if slot % 4 < 3 and slot % 7 else 0])
        heard.append([hears])
        delivered.append([arrived])
        ages.append(age)
    return TrajectoryPlot(
        key="trajectory",
        title="An episode of the trained policy",
        caption="Seed 1, the first 120 slots: the path of the AUV, coloured by slot. Cells are "
        "50 m wide; turn the figure by dragging it.",
        command="iout trajectory --seed 1",
        episode=Trajectory([10, 10, 5], 50, nodes, path, charged, heard, delivered, ages),
    )


TRAJECTORY = _trajectory()
FIGURES = (TRAINING, NODES, BARS, LOG_BARS, LOG, TRAJECTORY)

RESULTS = Table(
    key="results",
    title="All methods, K = 3 to 10",
    caption="Mean ± half the 95 % interval; the best of each column stands out.",
    command=COMMAND,
    columns=("method", "K = 3", "K = 5", "K = 7", "K = 10", "Jain's index", "energy in kJ", "note"),
    rows=(
        ("PPO", "8.0 ± 0.9", "10.1 ± 0.9", "12.2 ± 0.9", "14.3", "0.97", "31.0", "5 seeds"),
        (
            "greedy",
            "12.0 ± 0.9",
            "14.1",
            "16.2",
            "18.3",
            "0.91",
            "22.0",
            "`greedy` <deterministic>",
        ),
        (
            "random walk",
            "27.0",
            "29.1",
            "31.2",
            "33.3",
            "0.88",
            "4.2",
            "lower bound, of little use",
        ),
    ),
    numeric=frozenset(range(1, 7)),
    marked=frozenset({(0, 1), (0, 2), (0, 5)}),
)
LONG_TABLE = Table(
    key="seeds",
    title="Every run",
    caption="One line a run, its seed first.",
    command="iout runs --all",
    columns=("seed", "scenario", "hash", "mean AoI"),
    rows=tuple(
        (str(i), "paper/k3-fdd", f"`{i * 2654435761 % 2**32:08x}`", f"{8 + i % 7 / 3:.2f}")
        for i in range(1, 61)
    ),
    numeric=frozenset({0, 3}),
)
ANSWERS = Answers(
    key="claims",
    caption="Each claim of the paper with what was measured.",
    command="iout claims",
    answers=(
        Answer(
            claim="C1",
            source="Figure 5 (a)",
            text="PPO keeps a lower mean AoI than every baseline for all K.",
            value="8.1 slots for K = 3",
            verdict="reproduced",
            measured=("K = 3: 8.0 slots [7.1, 8.9]", "K = 10: 14.3 slots (one seed)"),
        ),
        Answer(
            claim="C2",
            source="Figure 6",
            text="TDD harvests α ≥ 20 % more energy & loses < 5 % of the packets.",
            value="23 %",
            verdict="reproduced in part",
            measured=("18 % [12, 24] more energy with `duplex: tdd`", "3.1 % of packets lost"),
            explanation=("The interval holds 20 %: five seeds cannot tell.",),
        ),
        Answer(
            claim="C3",
            source="Table 2",
            text="Training takes fewer than 10⁶ steps to come within 5 % of its final value.",
            value="",
            verdict="not reproduced",
            measured=("2.4·10⁶ steps [1.9, 3.0]",),
            explanation=(
                (
                    "With the paper's learning rate the value network lags: its explained variance "
                    "passes 0.5 only after 1.1·10⁶ steps."
                ),
                "Twice the rate needs 0.9·10⁶, but two of five seeds then collapse.",
            ),
        ),
        Answer(
            claim="C4",
            source="Section V-B",
            text="The policy was tried in a lake.",
            value="",
            verdict="not measured",
            measured=(),
            explanation=("A lake is not part of the simulation.",),
        ),
        Answer(
            claim="C5",
            source="Figure 4",
            text="Curves of FDD lie below those of TDD.",
            value="",
            verdict="reproduced",
            measured=("1.2 slots [0.4, 2.0] lower",),
        ),
    ),
)

SAMPLE = Report(
    title=f"Sample report. {AWKWARD}",
    lead=(
        (
            "Of five claims of the paper two were reproduced, one in part, one not, and one can "
            "not be measured. PPO keeps the mean AoI at 8.0 slots [7.1, 8.9] for K = 3."
        ),
        "Everything here is made up; `make demo` gives real figures.",
    ),
    facts=(
        ("Date", "2025-01-31"),
        ("Commit", "`0123456789abcdef0123456789abcdef01234567`"),
        ("Machine", "4 cores, 8 GB, no GPU"),
        ("torch, numpy", "2.13.0, 2.3.1"),
        ("Seeds", "1 to 5"),
    ),
    sections=(
        Section(
            "answers", "Answers to the paper's claims", ("Each was put to a test.",), (ANSWERS,)
        ),
        Section(
            "learning",
            "Training",
            (
                "A long paragraph shows how text is set. " * 8,
                "Runs came from `iout train paper/k3-fdd --out runs/a`; a lone ` is a backtick.",
            ),
            (TRAINING, RESULTS),
        ),
        Section("size", "More nodes & more energy", (), (NODES, BARS, LOG_BARS)),
        Section("episode", "One episode", ("Cells are counted from 1.",), (TRAJECTORY,)),
        Section("appendix", "Appendix", (), (LOG, LONG_TABLE)),
    ),
)
