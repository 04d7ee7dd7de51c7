"""What lies in the grid and what passes there: the one description of it that is drawn.

`projection` draws it from above and from the side: a frame of `render`, the pictures of a
report's trajectories. `iout_marl.report.trajectory_3d` draws it in space.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from iout_marl.render.snapshot import Floats, Integers, Snapshot
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
        path: (places, auvs, 3) cells, where the AUVs were slot by slot, and last where they are.
        links: what passes in the current slot.
        earlier: what passed in the slots before.
        charge: (nodes,) share of a full gauge of energy, from 0 to 1; None where it is not shown.
        tags: what stands beside each AUV; empty for nothing.
        from_start: whether the path begins where the episode does.
        edges_m: edges of a cell along x, y and z.
    """

    grid_shape: tuple[int, int, int]
    nodes: Integers
    path: Integers
    links: tuple[Link, ...] = ()
    earlier: tuple[Link, ...] = ()
    charge: Floats | None = None
    tags: tuple[str, ...] = ()
    from_start: bool = True
    edges_m: Edges = (1.0, 1.0, 1.0)

    @classmethod
    def from_snapshot(cls, snapshot: Snapshot, trail: Integers | None = None) -> Scene:
        """The slot of a snapshot: depths beside the AUVs, and in TDD their β.

        Args:
            snapshot: the slot.
            trail: (places, auvs, 3) cells where the AUVs were before, as far as that is shown.
        """
        links = [Link(Passed.CHARGE, 0, auv, node) for auv, node in snapshot.charging()]
        links += [
            Link(Passed.PACKET if arrived else Passed.LOSS, 0, auv, node)
            for auv, node, arrived in snapshot.hearing()
        ]
        depths = [f"z {z}" for z in snapshot.auv_positions[:, 2]]
        if snapshot.splits_slot and snapshot.beta is not None:
            depths = [f"{z}  β {b:.2f}" for z, b in zip(depths, snapshot.beta, strict=True)]
        here = snapshot.auv_positions[None]
        return cls(
            grid_shape=snapshot.grid_shape,
            nodes=snapshot.node_positions,
            path=here if trail is None else np.concatenate([trail, here]),
            links=tuple(links),
            charge=np.minimum(snapshot.energies_j / snapshot.energy_yardstick_j, 1.0),
            tags=tuple(depths),
            from_start=False,
            edges_m=snapshot.edges_m,
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
    ) -> Scene:
        """The slots of an episode, as `iout_marl.trajectory.Trajectory` records them.

        Args:
            grid_shape, nodes, path, charged, heard, delivered, edges_m: as there.
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
            path=np.array(path, dtype=np.int64),
            earlier=tuple(links),
            edges_m=edges_m,
        )

    @property
    def auvs(self) -> Integers:
        """(auvs, 3) cells where the AUVs are."""
        return self.path[-1]

    @property
    def num_auvs(self) -> int:
        return self.path.shape[1]
