"""An episode as it was played: what every AUV did in each slot, what came of it, and why."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from iout_marl.core.age import jain_of
from iout_marl.core.reasons import STRANDED, Reason
from iout_marl.files import read_json, refuse_input, to_json, user_path, write_text
from iout_marl.render import Snapshot
from iout_marl.replay.moves import arrives, progress
from iout_marl.replay.reading import (
    ARRAYS,
    FORMAT,
    NUMBERS,
    OPTIONAL_ARRAYS,
    POLLED,
    TEXTS,
    VERSION,
    Reader,
)
from iout_marl.scenario.spacing import Spacing, edges_m

Floats = npt.NDArray[np.float64]
Integers = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]


class Uplink(NamedTuple):
    """A node that was asked for its packet."""

    node: int  # counted from 1
    reason: Reason | None  # why its packet has not arrived; None where it has
    spent_j: float


@dataclass(frozen=True, eq=False)
class Recording:
    """One episode, or the slots of it that were played; cells, AUVs and nodes are counted from 1.

    Attributes:
        scenario, scenario_hash, scenario_yaml: the scenario's name, its hash, and all of it.
        policy: what the policy is called.
        seed: of the episode; None where it is not known.
        grid: cells along x, y and z.
        spacing_m: edge of a cell in m, or its edges along x, y and z.
        slot_s: length of a slot in s.
        num_slots: slots of a whole episode.
        maximum_age: A_max in slots.
        reference_energy_j: energy of an uplink over half the grid in J.
        capacity_j: the most that a node stores in J; None for no limit.
        ages_over_time: whether means of ages are taken over time, and not of the ends of slots.
        duplex, splits_slot: what the duplex part is called; whether β divides slots.
        reasons: why uplinks have failed; `outcome` counts them from 1.
        nodes: (nodes, 3) cells.
        path: (slots + 1, auvs, 3) cells, the starts first; of an AUV under way the one it leaves.
        left_grid, blocked: (slots, auvs) whether an AUV stayed at the edge of the grid, and
            whether because of another AUV.
        charged: (slots, auvs) node charged; 0 for nobody, or where the slot left no time for it.
        heard: (slots, auvs) node asked for its packet; 0 for nobody.
        beta: (slots, auvs) share of the slot for charging; 0 in FDD.
        outcome: (slots, auvs) 0 where the packet arrived, else the reason why not; nobody asked is
            one, `core.reasons.NOBODY_ASKED`.
        harvested_j: (slots, auvs) energy that the node charged has harvested, in J.
        spent_j: (slots, auvs) energy that the node heard has spent, in J.
        polled: (slots, auvs, rounds) nodes polled beside, in the order of their packets; 0 for
            none, and no rounds where the scenario has nobody polled.
        polled_outcome, polled_j: the same of them as `outcome` and `spent_j`; 0 for none.
        rewards: (slots, auvs).
        ages: (slots + 1, nodes) Age of Information in slots, the first ones first.
        energy_j: (slots + 1, nodes) energy stored in J.
        battery: (slots + 1, auvs) share of its battery that each AUV has; None where their energy
            has no end.
        heading: (slots + 1, auvs, 3) cells that AUVs under way go to, those of the others; None
            where no move takes longer than a slot.
        transit_slots: (slots + 1, auvs) slots until the move ends, 0 for nobody under way; None
            likewise.
        docks: (docks, 3) cells in which AUVs are recharged; None where there are none.
        current_m_per_s: (slots + 1, auvs, 2) the current along x and y that AUVs are in when a slot
            begins; None in still water.
        asleep: (slots, nodes) which nodes sleep; None where stores have no limits.
    """

    scenario: str
    scenario_hash: str
    scenario_yaml: str
    policy: str
    seed: int | None
    grid: tuple[int, int, int]
    spacing_m: Spacing
    slot_s: float
    num_slots: int
    maximum_age: float
    reference_energy_j: float
    duplex: str
    splits_slot: bool
    reasons: tuple[Reason, ...]
    nodes: Integers
    path: Integers
    left_grid: Flags
    blocked: Flags
    charged: Integers
    heard: Integers
    beta: Floats
    outcome: Integers
    harvested_j: Floats
    spent_j: Floats
    polled: Integers
    polled_outcome: Integers
    polled_j: Floats
    rewards: Floats
    ages: Floats
    energy_j: Floats
    capacity_j: float | None = None
    ages_over_time: bool = False
    battery: Floats | None = None
    heading: Integers | None = None
    transit_slots: Integers | None = None
    docks: Integers | None = None
    asleep: Flags | None = None
    current_m_per_s: Floats | None = None

    @property
    def slots(self) -> int:
        """Slots that were played."""
        return len(self.charged)

    @property
    def num_auvs(self) -> int:
        return self.path.shape[1]

    @property
    def num_nodes(self) -> int:
        return len(self.nodes)

    @property
    def delivered(self) -> Flags:
        """(slots, auvs) whether the packet arrived."""
        return self.outcome == 0

    @property
    def polled_delivered(self) -> Flags:
        """(slots, auvs, rounds) whether the packet of the node polled arrived."""
        return (self.polled > 0) & (self.polled_outcome == 0)

    @property
    def stranded(self) -> Flags:
        """(slots, auvs) whether the battery was empty, and the AUV did nothing."""
        numbers = [i for i, reason in enumerate(self.reasons, 1) if reason.code == STRANDED.code]
        return np.isin(self.outcome, numbers)

    def positions(self, *, only_arriving: bool = False) -> Floats:
        """(slots + 1, auvs, 3) where AUVs are, in cells: under way between the two.

        The world counts one that is under way as in the cell of `path`.

        Args:
            only_arriving: leave out moves that lead nowhere, see `moves.arrives`.
        """
        if self.heading is None or self.transit_slots is None:
            return self.path.astype(np.float64)
        share = progress(self.transit_slots)
        if only_arriving:
            share = share * arrives(self.path, self.heading, self.transit_slots)
        return self.path + (self.heading - self.path) * share[..., None]

    @property
    def asked(self) -> Flags:
        """(slots, auvs) whether a node was asked for its packet."""
        return self.heard > 0

    @property
    def deliveries(self) -> Integers:
        """(slots + 1, nodes) packets that each node has delivered so far."""
        counts = np.zeros((self.slots + 1, self.num_nodes), dtype=np.int64)
        slot, auv = np.nonzero(self.delivered)
        np.add.at(counts, (slot + 1, self.heard[slot, auv] - 1), 1)
        slot, auv, i = np.nonzero(self.polled_delivered)
        np.add.at(counts, (slot + 1, self.polled[slot, auv, i] - 1), 1)
        return np.cumsum(counts, axis=0)

    def reason(self, slot: int, auv: int) -> Reason | None:
        """Why a packet did not arrive; None where it did.

        Args:
            slot, auv: counted from 0.
        """
        number = int(self.outcome[slot, auv])
        return self.reasons[number - 1] if number else None

    def uplinks(self, slot: int, auv: int) -> Iterator[Uplink]:
        """The nodes asked in a slot: the chosen one, then those polled, in their order.

        Args:
            slot, auv: counted from 0.
        """
        rows = [(self.heard, self.outcome, self.spent_j)]
        rows += [
            (self.polled[..., i], self.polled_outcome[..., i], self.polled_j[..., i])
            for i in range(self.polled.shape[2])
        ]
        for node, outcome, spent_j in rows:
            if node[slot, auv]:
                number = int(outcome[slot, auv])
                reason = self.reasons[number - 1] if number else None
                yield Uplink(int(node[slot, auv]), reason, float(spent_j[slot, auv]))

    def snapshot(self, place: int) -> Snapshot:
        """The episode after some slots, for a picture.

        Args:
            place: how many slots are over, 0 for the start.
        """
        slot = place - 1
        deliveries = self.deliveries[place].astype(np.float64)
        return Snapshot(
            title=self.scenario,
            grid_shape=self.grid,
            edges_m=edges_m(self.spacing_m),
            capacity_j=self.capacity_j,
            slot=place,
            num_slots=self.num_slots,
            auv_positions=self.path[place],
            node_positions=self.nodes,
            ages=self.ages[place],
            maximum_age=self.maximum_age,
            energies_j=self.energy_j[place],
            reference_energy_j=self.reference_energy_j,
            mean_age=float(self.ages[place].mean()),
            jain=float(jain_of(np, deliveries, np.float64(self.num_nodes))),
            total_harvested_j=float(self.harvested_j[:place].sum()),
            duplex=self.duplex,
            splits_slot=self.splits_slot,
            charged=self._named(self.charged[slot]) if place else None,
            heard=self._named(self.heard[slot]) if place else None,
            delivered=self.delivered[slot] if place else None,
            beta=self.beta[slot] if place else None,
            battery=None if self.battery is None else self.battery[place],
            headings=None if self.heading is None else self.heading[place],
            transit_slots=None if self.transit_slots is None else self.transit_slots[place],
            progress=None if self.transit_slots is None else progress(self.transit_slots)[place],
            docks=self.docks,
            stranded=self.stranded[slot] if place and self.battery is not None else None,
            currents=None if self.current_m_per_s is None else self.current_m_per_s[place],
            asleep=self.asleep[slot] if place and self.asleep is not None else None,
            polled=self._named(self.polled[slot]) if place else None,
            polled_delivered=self.polled_delivered[slot] if place else None,
        )

    def _named(self, node: Integers) -> Integers:
        """Nodes as the world counts them: from 0, and K for nobody."""
        return np.where(node > 0, node - 1, self.num_nodes)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write it as JSON.

        Raises:
            InputError: it cannot be written.
        """
        target = user_path(path, "path")
        refuse_input(target)
        write_text(target, to_json(self.to_json()))

    def to_json(self) -> dict[str, Any]:
        """The episode as JSON has it; `from_json` reads it back."""
        values = {name: getattr(self, name) for name in (*TEXTS, "seed", "spacing_m", *NUMBERS)}
        arrays = {name: getattr(self, name).tolist() for name in ARRAYS}
        if self.polled.shape[2]:
            arrays |= {name: getattr(self, name).tolist() for name in POLLED}
        return {
            "format": FORMAT,
            "version": VERSION,
            **values,
            "grid": list(self.grid),
            "splits_slot": self.splits_slot,
            "reasons": [[reason.code, reason.text] for reason in self.reasons],
            **({} if self.capacity_j is None else {"capacity_j": self.capacity_j}),
            **({"ages_over_time": True} if self.ages_over_time else {}),
            **{
                name: getattr(self, name).tolist()
                for name in OPTIONAL_ARRAYS
                if getattr(self, name) is not None
            },
            **arrays,
        }

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> Recording:
        """Read what `save` has written.

        Raises:
            InputError: it cannot be read, is something else, or is damaged.
        """
        source = user_path(path, "recording")
        return cls.from_json(read_json(source), str(source))

    @classmethod
    def from_json(cls, data: Any, where: str = "recording") -> Recording:
        """The episode that JSON holds.

        Args:
            data: what `to_json` gives.
            where: what to call it in messages.

        Raises:
            InputError: it is something else.
        """
        read = Reader(data, where)
        grid = read.grid()
        reasons = read.reasons()
        sizes = {"axes": 3, "x and y": 2, "reasons": len(reasons)}
        sizes |= {"nodes": read.length("nodes"), "slots": read.length("charged")}
        sizes["slots + 1"] = sizes["slots"] + 1
        sizes["auvs"] = read.width("charged")
        found: dict[str, Any] = {name: read.text(name) for name in TEXTS}
        found |= {name: read.number(name, least) for name, least in NUMBERS.items()}
        found["spacing_m"] = read.spacing()
        found |= {name: read.array(name, sizes, grid) for name in ARRAYS}
        sizes["rounds"] = read.rounds()
        found |= {name: read.array(name, sizes, grid) for name in POLLED}
        if sizes["slots"] > found["num_slots"]:
            raise read.fault("charged", f"must have at most {found['num_slots']} slots")
        from_nobody = np.argwhere((found["heard"] == 0) & (found["outcome"] == 0))
        if from_nobody.size:
            slot, auv = (from_nobody[0] + 1).tolist()
            raise read.fault(
                f"outcome[{slot}, {auv}]", "is a packet that arrived, but heard is 0, nobody"
            )
        return cls(
            seed=read.seed(),
            grid=grid,
            splits_slot=read.flag("splits_slot"),
            reasons=reasons,
            capacity_j=read.capacity(),
            ages_over_time=read.flag("ages_over_time", missing=False),
            **read.optional_arrays(sizes, grid),
            **found,
        )
