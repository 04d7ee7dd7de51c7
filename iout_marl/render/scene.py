"""What lies in the grid and what passes there: the one description of it that is drawn.

`projection` draws it from above and from the side: a frame of `render`, the pictures of a
report's trajectories. `iout_marl.report.trajectory_3d` draws it in space.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from iout_marl.render.labels import current_text
from iout_marl.render.snapshot import Flags, Floats, Integers, Snapshot
from iout_marl.scenario.spacing import Edges


class Passed(Enum):
    """What passed between an AUV and a node; its look says which (see `style`)."""

    CHARGE = "charging"
    PACKET = "packet delivered"
    LOSS = "packet lost"


@dataclass(frozen=True, slots=True)
class Link:
    """Something that passed between an AUV and a node.

    Attributes:
        what: charging, or a packet on its way.
        place: where the AUV was, an index of the scene's path.
        auv, node: which, counted from 0.
    """

    what: Passed
    place: int
    auv: int
    node: int


# eq=False: a comparison of arrays would raise, so scenes compare by identity.
@dataclass(frozen=True, eq=False)
class Scene:
    """Nodes and AUVs in the grid; cells are counted from 1.

    Attributes:
        grid_shape: cells along x, y and z.
        nodes: (nodes, 3) cells.
        path: (places, auvs, 3) where the AUVs were slot by slot, and last where they are, in cells:
            under way between two.
        links: what passes in the current slot.
        earlier: what passed in the slots before.
        charge: (nodes,) share of a full gauge of energy, from 0 to 1; None where it is not shown.
        tags: what stands beside each AUV; empty for nothing.
        from_start: whether the path begins where the episode does.
        edges_m: edges of a cell along x, y and z.
        docks: (docks, 3) cells in which AUVs are recharged.
        headings: of AUVs under way, from 0, the cells that they go to.
        battery: (auvs,) share of it that each AUV has; None where it is not shown.
        stranded: AUVs, from 0, that can do nothing.
        asleep: nodes, from 0, that sleep.
    """

    grid_shape: tuple[int, int, int]
    nodes: Integers
    path: Floats
    links: tuple[Link, ...] = ()
    earlier: tuple[Link, ...] = ()
    charge: Floats | None = None
    tags: tuple[str, ...] = ()
    from_start: bool = True
    edges_m: Edges = (1.0, 1.0, 1.0)
    docks: Integers | None = None
    headings: Mapping[int, Integers] = field(default_factory=dict)
    battery: Floats | None = None
    stranded: frozenset[int] = frozenset()
    asleep: frozenset[int] = frozenset()

    @classmethod
    def from_snapshot(cls, snapshot: Snapshot, trail: Floats | None = None) -> Scene:
        """The slot of a snapshot: depths beside the AUVs, in TDD their β, and what they have left.

        Args:
            snapshot: the slot.
            trail: (places, auvs, 3) where the AUVs were before, as far as that is shown.
        """
        links = [Link(Passed.CHARGE, 0, auv, node) for auv, node in snapshot.charging()]
        links += [
            Link(Passed.PACKET if arrived else Passed.LOSS, 0, auv, node)
            for auv, node, arrived in snapshot.hearing()
        ]
        places, under_way = snapshot.auv_places, snapshot.under_way
        tags = [f"z {z:.3g}" for z in places[:, 2]]
        if snapshot.splits_slot and snapshot.beta is not None:
            tags = [f"{tag}  β {b:.2f}" for tag, b in zip(tags, snapshot.beta, strict=True)]
        if snapshot.battery is not None:
            tags = [f"{tag}  {left:.0%}" for tag, left in zip(tags, snapshot.battery, strict=True)]
        if snapshot.currents is not None:
            flows = [current_text(x, y) for x, y in snapshot.currents.tolist()]
            tags = [f"{tag}  {flow}" for tag, flow in zip(tags, flows, strict=True)]
        tags = [f"{tag}  {snapshot.condition(auv)}".rstrip() for auv, tag in enumerate(tags)]
        headings = {} if snapshot.headings is None else dict(enumerate(snapshot.headings))
        here = places[None]
        return cls(
            grid_shape=snapshot.grid_shape,
            nodes=snapshot.node_positions,
            path=here if trail is None else np.concatenate([trail, here]),
            links=tuple(links),
            charge=np.minimum(snapshot.energies_j / snapshot.energy_yardstick_j, 1.0),
            tags=tuple(tags),
            from_start=False,
            edges_m=snapshot.edges_m,
            docks=snapshot.docks,
            headings={auv: to for auv, to in headings.items() if under_way[auv]},
            battery=snapshot.battery,
            stranded=_which(snapshot.stranded),
            asleep=_which(snapshot.asleep),
        )

    @classmethod
    def from_episode(
        cls,
        grid_shape: Sequence[int],
        nodes: Sequence[Sequence[int]],
        path: Sequence[Sequence[Sequence[int]]],
        charged: Sequence[Sequence[int]],
        heard: Sequence[Sequence[int]],
        delivered: Sequence[Sequence[bool]],
        polled: Iterable[tuple[int, int, int, bool]] = (),
        edges_m: Edges = (1.0, 1.0, 1.0),
        docks: Sequence[Sequence[int]] | None = None,
    ) -> Scene:
        """The slots of an episode, as `iout_marl.trajectory.Trajectory` records them.

        Args:
            grid_shape, nodes, path, charged, heard, delivered, edges_m, docks: as there.
            polled: slot from 1, AUV from 0, node from 1 of nodes polled beside, and whether the
                packet arrived.
        """
        links = []
        for slot, (charges, hears, arrivals) in enumerate(
            zip(charged, heard, delivered, strict=True), start=1
        ):
            for auv, (charge, hear, arrived) in enumerate(
                zip(charges, hears, arrivals, strict=True)
            ):
                if charge:
                    links.append(Link(Passed.CHARGE, slot, auv, charge - 1))
                if hear:
                    what = Passed.PACKET if arrived else Passed.LOSS
                    links.append(Link(what, slot, auv, hear - 1))
        links += [
            Link(Passed.PACKET if arrived else Passed.LOSS, slot, auv, node - 1)
            for slot, auv, node, arrived in polled
        ]
        x, y, z = grid_shape
        return cls(
            grid_shape=(x, y, z),
            nodes=np.array(nodes, dtype=np.int64).reshape(-1, 3),
            path=np.array(path, dtype=np.float64),
            earlier=tuple(links),
            edges_m=edges_m,
            docks=None if docks is None else np.array(docks, dtype=np.int64),
        )

    @property
    def auvs(self) -> Floats:
        """(auvs, 3) where the AUVs are, in cells."""
        return self.path[-1]

    @property
    def num_auvs(self) -> int:
        return self.path.shape[1]


def _which(flags: Flags | None) -> frozenset[int]:
    """Where flags are set, from 0."""
    return frozenset(() if flags is None else np.flatnonzero(flags).tolist())
