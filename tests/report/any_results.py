"""Results as nobody would make them, but for which there must be a report: drawn at random."""

import random

from fake_results import episode

from iout_marl.metrics import described
from iout_marl.paper.names import BASELINES, BEST, LONGER_TDD, TRAINED, in_fdd
from iout_marl.study.fields import LARGEST, LONGEST
from iout_marl.study.records import (
    CURVES,
    Emissions,
    Record,
    TrainingRecord,
    metrics_of,
)
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
    "right \u202eto left",
    "العربية و עברית",
    "能量 エネルギー 에너지 ऊर्जा",
    "👩‍🚀🚀",
    "\ufdd0\U0001fffe",
    "=1+1",
    "![image](x.png) [link](javascript:alert(3))",
    ":smile: &copy; &#36;",
    "--- ***",
    "'\"><svg/onload=alert(4)>",
    "word " * (LONGEST // 5),
    "x" * LONGEST,
    "",
    " ",
)
#: What no name may be.
REFUSED = (
    "two\nlines\r\nthree\tx",
    "nul\0bell\x07escape\x1b[31m",
    "half \ud800",
    "line\u2028end",
    "\ufdd0\uffff\U0001fffe",
    "word " * 2000,
    "x" * 10_000,
)
#: What only a description may be.
LONG = ("two\nlines\n\n\tthree", "word " * 2000, "x" * 10_000)
NUMBERS = (0.0, -0.0, 1.0, 2.5, 51.0, -3.0, 1 / LARGEST, 5e-324, LARGEST, -LARGEST, 1e15)
PLACES = (3.0, 5.0, 7.0, 10.0, 0.0, -2.0, 0.5, 2_304_000.0, 1e-9, LARGEST, -LARGEST)


class _Draw:
    """Parts of results, drawn by a generator."""

    def __init__(self, rng, texts):
        self.rng, self.texts = rng, texts

    def text(self):
        return self.rng.choice(self.texts)

    def number(self, low=-LARGEST, high=LARGEST):
        if self.rng.random() < 0.3:
            return min(max(self.rng.choice(NUMBERS), low), high)
        return self.rng.uniform(max(low, 0), min(high, 40))

    def positive(self):
        return self.number(1 / LARGEST)

    def numbers(self, count, low=-LARGEST, high=LARGEST):
        same = self.number(low, high) if self.rng.random() < 0.3 else None
        return [self.number(low, high) if same is None else same for _ in range(count)]

    def samples(self, metric, count):
        known = described(metric)
        low = 1 / LARGEST if known.is_positive else max(known.low, -LARGEST)
        return self.numbers(count, low, min(known.high, LARGEST))

    def curve(self):
        length = self.rng.randrange(6)
        made = {name: self.numbers(length) for name in ("env_steps", *CURVES)}
        if self.rng.random() < 0.3:
            made[self.text()] = self.numbers(self.rng.randrange(6))
        return made

    def walk(self, nodes):
        heard = [self.rng.randrange(nodes + 1) for _ in range(self.rng.randrange(1, 5))]
        made = episode(nodes, heard)
        if self.rng.random() < 0.3:
            made["spacing_m"] = self.positive()
        if self.rng.random() < 0.3:
            made["more"] = self.rng.choice([None, "x", 3, [], [[1]]])
        return made

    def training(self):
        emissions = Emissions(
            energy_kwh=self.positive(), co2_kg=self.number(low=0), codecarbon=self.text()
        )
        return TrainingRecord(
            settings={
                "discount": self.number(),
                "learning_rate": self.rng.choice([0.1, 0, self.number()]),
                "hidden_units": self.rng.choice([[64, 64], [], ["x", None], 3, True, self.text()]),
                "steps": self.rng.choice([3, 0.5, 0, -1, 10**50]),
            },
            env_steps=self.rng.choice([0, 1, 10**9, 10**18]),
            seconds=self.positive(),
            curve=self.curve(),
            emissions=self.rng.choice([emissions, None]),
        )

    def record(self, bound):
        policy = "bound" if bound else self.rng.choice(["ppo", "ppo", "greedy", "planner"])
        trained = policy == "ppo" and self.rng.random() < 0.9
        episodes = self.rng.choice([1, 1, 1, 2, 5])
        nodes = self.rng.randrange(1, 11)
        return Record(
            key=self.text(),
            scenario=self.text(),
            scenario_hash=self.text(),
            world_hash=self.rng.choice(["a", "b", self.text()]),
            duplex=self.rng.choice(["tdd", "fdd", self.text()]),
            nodes=nodes,
            auvs=1,
            maximum_age=self.positive(),
            minimum_jain=self.number(0, 1),
            policy=policy,
            seed=self.rng.randrange(3),
            episodes=episodes,
            samples={name: self.samples(name, episodes) for name in metrics_of(policy)},
            training=self.training() if trained else None,
            episode=self.walk(nodes) if trained else None,
            machine={"cores": self.rng.choice(["1", "?", self.text()]), self.text(): self.text()},
            date=self.text(),
            search=self.rng.choice(["", self.text()]),
            deterministic=self.rng.random() < 0.3,
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
        CellResult(group=draw.text(), series=series, axis=place, record=draw.record(bound))
        for series in rng.sample(names, rng.randrange(1, 9))
        for bound in [rng.random() < 0.2]
        for place in places
        for _ in range(rng.randrange(4))
    ]
    return Results(
        name=draw.text(),
        title=draw.text(),
        description=rng.choice([*texts, *LONG]),
        report=report or rng.choice(["paper", "plain"]),
        axis=Axis(key=draw.text(), label=draw.text()),
        front=rng.random() < 0.5,
        carbon_g_per_kwh=draw.number(low=0),
        quick=rng.random() < 0.3,
        command=draw.text(),
        cells=tuple(cells),
        failures=tuple(draw.failure() for _ in range(rng.randrange(3))),
    )
