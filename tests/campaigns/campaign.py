"""What a campaign is, and how it is run: in parts, each from a seed of its own."""

from __future__ import annotations

import importlib
import pkgutil
import time
import traceback
from collections import Counter
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context

import numpy as np


@dataclass
class Tally:
    """What came of the cases of a campaign.

    Attributes:
        outcomes: how many cases ended in each of the ways that are right ("refused", say).
        faults: of each case that did not: what it was, and what went wrong, so that it can be
            played again.
    """

    outcomes: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    seconds: float = 0.0

    @property
    def cases(self) -> int:
        """How many cases there were."""
        return self.outcomes.total() + len(self.faults)

    def note(self, outcome: str, count: int = 1) -> None:
        """Count a case, or several, that ended rightly."""
        self.outcomes[outcome] += count

    def fault(self, case: object, what: BaseException | str) -> None:
        """Write down a case that did not."""
        if isinstance(what, BaseException):
            place = traceback.extract_tb(what.__traceback__)[-1:]
            where = f" at {place[0].filename}:{place[0].lineno}" if place else ""
            what = f"{type(what).__name__}: {str(what)[:300]}{where}"
        self.faults.append(f"{str(case)[:1000]}: {what}")

    def add(self, other: Tally) -> None:
        """Take in what another one counted."""
        self.outcomes += other.outcomes
        self.faults += other.faults
        self.seconds += other.seconds


@dataclass(frozen=True)
class Campaign:
    """A campaign.

    Attributes:
        name: in a word or two.
        cases: how many it has in full.
        short: how many of them the test suite runs; they take a few seconds.
        run: plays so many cases, drawn by the generator.
        parts: into how many pieces the full form is cut, which run side by side.
    """

    name: str
    cases: int
    short: int
    run: Callable[[np.random.Generator, int], Tally]
    parts: int = 4


def campaigns() -> list[Campaign]:
    """All campaigns, by name."""
    package = importlib.import_module(__package__ or "campaigns")
    modules = [
        importlib.import_module(f"{package.__name__}.{module.name}")
        for module in pkgutil.iter_modules(package.__path__)
        if not module.name.startswith("_")
    ]
    found = [module.CAMPAIGN for module in modules if hasattr(module, "CAMPAIGN")]
    return sorted(found, key=lambda campaign: campaign.name)


def play(campaign: Campaign, cases: int, seed: int) -> Tally:
    """Play cases of a campaign in this process."""
    begun = time.monotonic()
    tally = campaign.run(np.random.default_rng([seed, *campaign.name.encode()]), cases)
    tally.seconds = time.monotonic() - begun
    return tally


def _play_named(name: str, cases: int, seed: int) -> Tally:
    (campaign,) = (c for c in campaigns() if c.name == name)
    return play(campaign, cases, seed)


def play_all(chosen: list[Campaign], share: float, seed: int, jobs: int) -> dict[str, Tally]:
    """Play a share of campaigns' cases in processes side by side; what came of each."""
    tallies = {campaign.name: Tally() for campaign in chosen}
    with ProcessPoolExecutor(jobs, mp_context=get_context("spawn")) as pool:
        waiting = []
        for campaign in chosen:
            cases = max(1, round(campaign.cases * share))
            for part, count in enumerate(_cut(cases, campaign.parts)):
                future = pool.submit(_play_named, campaign.name, count, seed + part)
                waiting.append((campaign.name, future))
        for name, future in waiting:
            tallies[name].add(future.result())
    return tallies


def _cut(cases: int, parts: int) -> list[int]:
    parts = min(parts, cases)
    return [cases // parts + (part < cases % parts) for part in range(parts)]
