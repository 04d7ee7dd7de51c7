"""What is claimed of a scenario, and the check of it from the scenario alone.

A certificate may come from anywhere. Nothing in it is believed: its fields are looked at first,
one by one (`Certificate.checked`), then whether they are for this scenario, then whether they
prove the claim. `docs/bounds.md` lists the checks.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from iout_marl.bounds import untrusted
from iout_marl.bounds.branch_and_bound_check import check_branch_and_bound, oldest_first
from iout_marl.bounds.check_game import finite_game, is_covered
from iout_marl.bounds.lagrangian_check import proven_age_sum
from iout_marl.bounds.prices import Prices
from iout_marl.bounds.scheduling import MOST_AGE_SUM
from iout_marl.errors import InputError, did_you_mean
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario

#: The fields of each kind in JSON.
_CLAIM = ("kind", "world_hash", "age_sum")
_PRICES = ("oldest", "slots", "naming", "presence", "reach_m")
FIELDS = {
    "scheduling": _CLAIM,
    "branch-and-bound": (*_CLAIM, "levels_j"),
    "lagrangian": (*_CLAIM, "levels_j", *_PRICES),
}
#: What certificates of the version before call them.
_RENAMED = {"opening": "branch-and-bound", "sharing": "lagrangian"}
#: Levels of energy, slots at which prices are given, numbers in `presence`.
MOST_LEVELS, MOST_TIMES, MOST_WEIGHTS = 2**10, 2**12, 2**24
#: A level in J; a price in slots of age; the reach in m.
MOST_J, MOST_PRICE, LEAST_REACH_M, MOST_REACH_M = 1e300, 2.0**40, 1e-6, 1e15


@dataclass(frozen=True)
class Certificate:
    """What is claimed, and what it takes to check it.

    Attributes:
        world_hash: the scenario's, without reward and training.
        age_sum: no policy's ages, summed over nodes and slots, are less than this.
        levels_j: (levels,) stored energies in J, without the last, which is
            infinite; None for the scheduling bound.
        prices: for the Lagrangian bound; None for the others.
        oldest: age from which on the Lagrangian bound tells none apart.
    """

    world_hash: str
    age_sum: int
    levels_j: tuple[float, ...] | None = None
    prices: Prices | None = None
    oldest: int | None = None

    @property
    def kind(self) -> str:
        """Which of the bounds it is of, a key of `FIELDS`."""
        if self.prices is not None:
            return "lagrangian"
        return "scheduling" if self.levels_j is None else "branch-and-bound"

    def to_json(self) -> dict[str, Any]:
        """The certificate as JSON has it."""
        record: dict[str, Any] = {
            "kind": self.kind,
            "world_hash": self.world_hash,
            "age_sum": self.age_sum,
        }
        if self.levels_j is not None:
            record["levels_j"] = list(self.levels_j)
        if self.prices is not None:
            record |= {
                "oldest": self.oldest,
                "slots": list(self.prices.slots),
                "naming": self.prices.naming.tolist(),
                "presence": self.prices.presence.tolist(),
                "reach_m": self.prices.reach_m,
            }
        return record

    @classmethod
    def from_json(cls, record: dict[str, Any]) -> Certificate:
        """The certificate that `to_json` has written.

        Raises:
            InputError: it is none: a field is missing, unknown, or not what it must be.
        """
        if not isinstance(record, dict):
            raise InputError(f"certificate: must be a mapping, not {untrusted.shown(record)}")
        kind = record.get("kind")
        if isinstance(kind, str):
            kind = _RENAMED.get(kind, kind)
        if not isinstance(kind, str) or kind not in FIELDS:
            raise InputError(
                f"certificate: kind: must be one of {', '.join(FIELDS)}, "
                f"not {untrusted.shown(kind)}"
            )
        for name in FIELDS[kind]:
            if record.get(name) is None:
                raise InputError(f"certificate: {name}: is missing, which {kind} needs")
        for name in record:
            if name not in FIELDS[kind]:
                word = str(name)[: untrusted.SHOWN] if isinstance(name, str) else "?"
                raise InputError(
                    f"certificate: {untrusted.shown(name)}: is no field of {kind}"
                    + did_you_mean(word, FIELDS[kind])
                )
        prices = None
        if kind == "lagrangian":
            prices = Prices(*(record[name] for name in _PRICES[1:]))
        unchecked = cls(
            record["world_hash"],
            record["age_sum"],
            record.get("levels_j"),
            prices,
            record.get("oldest"),
        )
        return unchecked.checked()

    def checked(self) -> Certificate:
        """The certificate, whose every field is found to be of its type, shape and range.

        Raises:
            InputError: one is not.
        """
        if not isinstance(self.world_hash, str) or not re.fullmatch(
            "[0-9a-f]{12}", self.world_hash
        ):
            raise InputError(
                "certificate: world_hash: must be 12 hexadecimal digits, "
                f"not {untrusted.shown(self.world_hash)}"
            )
        age_sum = untrusted.whole_number("age_sum", self.age_sum, 0, MOST_AGE_SUM)
        if (self.prices is None) != (self.oldest is None):
            raise InputError("certificate: oldest: is there where prices are, and only there")
        if self.levels_j is None:
            if self.prices is not None:
                raise InputError("certificate: levels_j: is missing, which lagrangian needs")
            return Certificate(self.world_hash, age_sum)
        # Nodes begin without energy: the first level must not be below 0 to stand for that.
        levels = untrusted.entries("levels_j", self.levels_j, 1, MOST_LEVELS)
        levels_j = untrusted.numbers("levels_j", levels, (len(levels),), 0.0, MOST_J).tolist()
        untrusted.rises("levels_j", levels_j)
        if self.prices is None:
            return Certificate(self.world_hash, age_sum, tuple(levels_j))
        oldest = untrusted.whole_number("oldest", self.oldest, 2, MOST_AGE_SUM)
        prices = _checked_prices(self.prices)
        return Certificate(self.world_hash, age_sum, tuple(levels_j), prices, oldest)


def _checked_prices(prices: Any) -> Prices:
    """The prices, as `Certificate.checked`."""
    if not isinstance(prices, Prices):
        raise InputError(f"certificate: prices: must be Prices, not {untrusted.shown(prices)}")
    given = untrusted.entries("slots", prices.slots, 1, MOST_TIMES)
    slots = tuple(
        untrusted.whole_number(f"slots[{i}]", slot, 0, MOST_AGE_SUM) for i, slot in enumerate(given)
    )
    if slots[0] != 0:
        raise InputError(f"certificate: slots[0]: must be 0, not {untrusted.shown(slots[0])}")
    untrusted.rises("slots", slots)
    most_nodes = int((MOST_WEIGHTS / len(slots)) ** 0.5)
    num_nodes = len(untrusted.entries("presence", prices.presence, 1, most_nodes))
    shape = (num_nodes, num_nodes, len(slots))
    return Prices(
        slots,
        untrusted.numbers("naming", prices.naming, shape[2:], 0.0, MOST_PRICE),
        untrusted.numbers("presence", prices.presence, shape, -MOST_PRICE, MOST_PRICE),
        untrusted.number("reach_m", prices.reach_m, LEAST_REACH_M, MOST_REACH_M),
    )


def verified_age_sum(
    scenario: AnyScenario, certificate: Certificate, *, overrides: Overrides = None
) -> int:
    """The claim of a certificate, once it is found to hold.

    Args:
        scenario: whatever `load_scenario` takes; it is trusted.
        certificate: the certificate, which is not.
        overrides: changes of the scenario, as for `load_scenario`.

    Raises:
        InputError: the certificate is malformed, of another scenario, does not prove its claim,
            or would take the check too long or too much memory.
    """
    if not isinstance(certificate, Certificate):
        raise InputError(
            "certificate: must be a Certificate, as Certificate.from_json makes it, "
            f"not {untrusted.shown(certificate)}"
        )
    scenario, certificate = load_scenario(scenario, overrides), certificate.checked()
    _check_is_for(scenario, certificate)
    claimed = certificate.age_sum
    start = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    at_once: int = scenario.channel.part.access.max_uplinks_per_slot(scenario.num_auvs)
    resets = min(at_once, scenario.num_auvs) * scenario.hearing.part.uplinks_per_slot
    proven = int(oldest_first(start, scenario.num_slots, scenario.age.maximum, resets)[0])
    if claimed <= proven:
        return claimed
    by_ages = f"certificate: age_sum: scheduling proves no more than {proven}, not {claimed}"
    if certificate.levels_j is None:
        raise InputError(by_ages)
    if not is_covered(scenario):
        raise InputError(f"{by_ages}; energy and travel count for one AUV and fixed nodes only")
    game = finite_game(scenario, certificate.levels_j)
    if certificate.prices is None:
        check_branch_and_bound(scenario, game, claimed)
        return claimed
    assert certificate.oldest is not None  # see `Certificate.checked`
    by_prices = proven_age_sum(scenario, certificate.prices, certificate.oldest, game)
    # Sums of ages are whole numbers.
    if by_prices <= claimed - 1:
        raise InputError(
            f"certificate: age_sum: the prices prove {float(by_prices):.3f}, not {claimed}"
        )
    return claimed


def _check_is_for(scenario: Scenario, certificate: Certificate) -> None:
    """See that the fields of a certificate fit the scenario.

    Raises:
        InputError: one does not.
    """
    if certificate.world_hash != scenario.world_hash:
        raise InputError(
            f"certificate: is of world {certificate.world_hash}, not of {scenario.world_hash}"
        )
    num_nodes, last, maximum = scenario.num_nodes, scenario.num_slots - 1, scenario.age.maximum
    highest = num_nodes * scenario.num_slots * maximum
    if highest > MOST_AGE_SUM:
        raise InputError("certificate: the scenario's ages cannot be added up in 64 bits")
    untrusted.whole_number("age_sum", certificate.age_sum, 0, highest)
    if certificate.prices is None or certificate.oldest is None:
        return
    if scenario.duplex.part.num_choices > 1:
        raise InputError(
            "certificate: kind: the Lagrangian bound is for scenarios where an AUV names one node, "
            "as in TDD"
        )
    untrusted.whole_number("oldest", certificate.oldest, 2, max(2, maximum))
    slots, presence = certificate.prices.slots, certificate.prices.presence
    if slots[-1] != last:
        raise InputError(f"certificate: slots: must end at the last slot, {last}, not {slots[-1]}")
    if len(presence) != num_nodes:
        raise InputError(
            f"certificate: presence: is for {len(presence)} nodes, but there are {num_nodes}"
        )
