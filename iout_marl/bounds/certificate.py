"""What is claimed of a scenario, and the check of it from the scenario alone."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from iout_marl.bounds.check_game import finite_game
from iout_marl.bounds.opening_check import check_opening, oldest_first
from iout_marl.bounds.sharing import Prices
from iout_marl.bounds.sharing_check import proven_age_sum
from iout_marl.errors import InputError
from iout_marl.scenario import Scenario, Tdd


@dataclass(frozen=True)
class Certificate:
    """What is claimed, and what it takes to check it.

    Attributes:
        world_hash: the scenario's, without reward and training.
        age_sum: no policy's ages, summed over nodes and slots, are less than this.
        levels_j: (levels,) ladder of stored energies in J, without the last, which is
            infinite; None for the scheduling bound.
        prices: for the sharing bound; None for the others.
        oldest: age from which on the sharing bound tells none apart.
    """

    world_hash: str
    age_sum: int
    levels_j: tuple[float, ...] | None = None
    prices: Prices | None = None
    oldest: int | None = None

    def to_json(self) -> dict[str, Any]:
        """The certificate as JSON has it."""
        record: dict[str, Any] = {
            "kind": "sharing" if self.prices else "opening" if self.levels_j else "scheduling",
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
            InputError: it is none.
        """
        try:
            prices = None
            if record["kind"] == "sharing":
                prices = Prices(
                    tuple(record["slots"]),
                    np.array(record["naming"], dtype=np.float64),
                    np.array(record["presence"], dtype=np.float64),
                    float(record["reach_m"]),
                )
            levels_j = None if record["kind"] == "scheduling" else tuple(record["levels_j"])
            return cls(
                record["world_hash"], record["age_sum"], levels_j, prices, record.get("oldest")
            )
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"certificate: cannot be read: {error}") from None


def verified_age_sum(scenario: Scenario, certificate: Certificate) -> int:
    """The claim of a certificate, once it is found to hold.

    Raises:
        InputError: the certificate is of another scenario.
        ValueError: it does not prove its claim.
    """
    if certificate.world_hash != scenario.world_hash:
        raise InputError(
            f"certificate: is of world {certificate.world_hash}, not of {scenario.world_hash}"
        )
    claimed = certificate.age_sum
    start = np.full((1, scenario.num_nodes), scenario.age.initial, dtype=np.int64)
    resets = 1 if scenario.channel.access == "exclusive" else scenario.num_auvs
    proven = int(oldest_first(start, scenario.num_slots, scenario.age.maximum, resets)[0])
    if claimed > proven:
        if certificate.levels_j is None or scenario.num_auvs != 1:
            raise ValueError(f"scheduling proves no more than {proven}, not {claimed}")
        if certificate.prices is None:
            check_opening(scenario, finite_game(scenario, certificate.levels_j), claimed)
        else:
            _check_sharing(scenario, certificate)
    return claimed


def _check_sharing(scenario: Scenario, certificate: Certificate) -> None:
    """See that the prices prove the claim."""
    assert certificate.levels_j is not None
    assert certificate.prices is not None
    assert certificate.oldest is not None
    if not isinstance(scenario.duplex, Tdd):
        raise ValueError("the sharing bound is for TDD")  # noqa: TRY004
    if certificate.prices.slots[-1] != scenario.num_slots - 1:
        raise ValueError("the prices are not for every slot: they prove nothing")
    game = finite_game(scenario, certificate.levels_j)
    proven = proven_age_sum(scenario, certificate.prices, certificate.oldest, game)
    if proven <= certificate.age_sum - 1:
        raise ValueError(f"the prices prove {float(proven)}, not {certificate.age_sum}")
