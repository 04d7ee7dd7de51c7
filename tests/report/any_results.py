"""Results as nobody would make them, but for which there must be a report: drawn at random."""

import math
import random

from fake_results import episode

from iout_marl.report.names import BASELINES, BEST, LONGER_TDD, TRAINED, in_fdd
from iout_marl.study.records import Emissions, Record, TrainingRecord, metrics_of
from iout_marl.study.results import CellResult, Failure, Results
from iout_marl.study.schema import Axis

#: What must be shown as it is, wherever a user may write it.
NASTY = (
    "q[/lr] [bold]x",
    "<script>alert(1)</script>",
    "</script><img src=x onerror=alert(2)>",
    "<b>bold</b>&amp;&lt;",
    "$x_1$ and $\\frac{",
    "_under_ __score__",
    "*star* **s** ~~gone~~",
    "a|b||c",
    "`code` ``two`` `",
    "# heading #",
    "- list",
    "1. list",
    "back\\slash \\n",
    "%{x} %{customdata[0]} {{ 7 * 7 }} {% if %}",
    "two\nlines\r\nthree\tx",
    "nul\0bell\x07escape\x1b[31m",
    "right \u202eto left",
    "العربية و עברית",
    "能量 エネルギー 에너지 ऊर्जा",
    "👩‍🚀🚀",
    "\ufdd0\uffff\U0001fffe",
    "=1+1",
    "![image](x.png) [link](javascript:alert(3))",
    ":smile: &copy; &#36;",
    "--- ***",
    "'\"><svg/onload=alert(4)>",
    "word " * 2000,
    "x" * 10_000,
    "",
    " ",
)
NUMBERS = (0.0, -0.0, 1.0, 2.5, 51.0, -3.0, 1e-300, 5e-324, 1e200, 1.7e308, -1.7e308, 1e15)
CURVES = ("env_steps", "aoi/mean", "fairness/jain", "reward/total", "energy/harvested_kj")
PLACES = (3.0, 5.0, 7.0, 10.0, 0.0, -2.0, 0.5, 2_304_000.0, 1e-9, 1e300, -1e300, math.inf, math.nan)


class _Draw:
    """Parts of results, drawn by a generator."""

    def __init__(self, rng, texts):
        self.rng, self.texts = rng, texts

    def text(self):
        return self.rng.choice(self.texts)

    def number(self):
        return self.rng.choice(NUMBERS) if self.rng.random() < 0.3 else self.rng.uniform(0, 40)

    def numbers(self, count):
        same = self.number() if self.rng.random() < 0.3 else None
        return [self.number() if same is None else same for _ in range(count)]

    def curve(self):
        length = self.rng.randrange(6)
        return {
            name: self.numbers(length + self.rng.randrange(2))
            for name in CURVES
            if self.rng.random() < 0.9
        }

    def walk(self):
        heard = [self.rng.randrange(3) for _ in range(self.rng.randrange(4))]
        made = episode(self.rng.randrange(4), heard)
        if self.rng.random() < 0.3:
            made[self.rng.choice([*made, "more"])] = self.rng.choice([None, "x", 3, [], [[1]]])
        return made

    def training(self):
        emissions = Emissions(
            energy_kwh=self.number(), co2_kg=self.number(), codecarbon=self.text()
        )
        return TrainingRecord(
            settings={
                "learning_rate": self.rng.choice([0.1, "x", None, {}]),
                "hidden_units": self.rng.choice([[64, 64], [[1], 2], 3]),
                "steps": self.rng.choice([3, 0.5, self.text()]),
            },
            env_steps=self.rng.choice([0, 1, -5, 10**9, 10**400]),
            seconds=self.number(),
            curve=self.curve(),
            emissions=self.rng.choice([emissions, None]),
        )

    def record(self):
        policy = self.rng.choice(["ppo", "ppo", "greedy", "planner", "bound"])
        trained = policy == "ppo" and self.rng.random() < 0.9
        episodes = self.rng.choice([0, 1, 1, 1, 2, 5])
        return Record(
            key=self.text(),
            scenario=self.text(),
            scenario_hash=self.text(),
            world_hash=self.rng.choice(["a", "b", self.text()]),
            duplex=self.rng.choice(["tdd", "fdd", self.text()]),
            nodes=self.rng.randrange(-1, 12),
            auvs=1,
            maximum_age=self.number(),
            minimum_jain=self.number(),
            policy=policy,
            seed=self.rng.randrange(3),
            episodes=episodes,
            samples={name: self.numbers(episodes) for name in metrics_of(policy)},
            training=self.training() if trained else None,
            episode=self.walk() if trained else None,
            machine={"cores": self.rng.choice(["1", "?", self.text()]), self.text(): self.text()},
            date=self.text(),
            search=self.rng.choice(["", self.text()]),
        )

    def failure(self):
        place = self.rng.choice(PLACES)
        return Failure(series=self.text(), axis=place, seed=1, error=self.text())


def any_results(seed, texts=NASTY, report=None):
    """Results that validate, and little more can be said of them."""
    rng = random.Random(seed)
    draw = _Draw(rng, texts)
    names = [*BASELINES, *TRAINED, *BEST, LONGER_TDD, *map(in_fdd, BASELINES), *texts]
    places = rng.sample(PLACES, rng.randrange(1, 5))
    cells = [
        CellResult(group=draw.text(), series=series, axis=place, record=draw.record())
        for series in rng.sample(names, rng.randrange(1, 9))
        for place in places
        for _ in range(rng.randrange(4))
    ]
    return Results(
        name=draw.text(),
        title=draw.text(),
        description=draw.text(),
        report=report or rng.choice(["paper", "plain"]),
        axis=Axis(key=draw.text(), label=draw.text()),
        front=rng.random() < 0.5,
        carbon_g_per_kwh=draw.number(),
        quick=rng.random() < 0.3,
        command=draw.text(),
        cells=tuple(cells),
        failures=tuple(draw.failure() for _ in range(rng.randrange(3))),
    )
