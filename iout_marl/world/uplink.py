"""Uplink: who sends on the shared band, and whose packet arrives.

A node that several AUVs hear sends once, to the nearest of them; between AUVs that are
equally near, to the one in the cell of the lower code, so that the order of the AUVs does
not matter. How uplinks to several AUVs share the band is a part, chosen by
`channel.access`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from iout_marl.arrays.backend import Backend
from iout_marl.core.limits import UPLINK_W, bounded, unheard, unheard_on_numpy
from iout_marl.core.link import Link
from iout_marl.physics.arrays import Array
from iout_marl.scenario import Scenario, Tdd
from iout_marl.world.duplex import Split

#: Up to which NumPy eliminates as fast as it solves, in batches of hundreds of systems or more.
_FEW_ROWS = 4


class Request(NamedTuple):
    """What the AUVs ask for in a slot, (envs, auvs) each."""

    cell: Array  # code of the AUV's cell
    heard: Array  # node asked for its packet
    node_cell: Array  # code of that node's cell
    sends: Array  # bool: whether it would send if it were alone
    payable_j: Array  # J: energy that it has when the uplinks begin
    offset: Array  # offset from the AUV to it, see `Link`


class Uplinks(NamedTuple):
    """What came of it, (envs, auvs) each."""

    delivered: Array  # bool: the packet arrived
    spent_j: Array  # J: energy that the node heard has spent on it


class Access(Protocol):
    """A part for the shared band."""

    def __call__(self, request: Request, split: Split) -> Uplinks:
        """The uplinks of a slot."""
        ...


class _ToOneReceiver:
    """Sees to it that every node sends to one AUV at most."""

    def __init__(self, scenario: Scenario, link: Link, backend: Backend) -> None:
        self._link = link
        self._xp = backend.xp
        self._zero = backend.floats(0.0)
        self._num_auvs = scenario.num_auvs
        self._index = backend.integers(list(range(scenario.num_auvs)))

    def to_nearest(self, request: Request) -> Array:
        """Which AUVs' nodes send to them: (envs, auvs) bool."""
        if self._num_auvs == 1:
            return request.sends
        xp = self._xp
        distance_m = self._link.at(self._link.distance_m, request.offset)
        mine, theirs = distance_m[:, :, None], distance_m[:, None, :]
        own_cell, their_cell = request.cell[:, :, None], request.cell[:, None, :]
        # AUVs in one cell that hear one node are alike: here their order does no harm.
        earlier = (their_cell == own_cell) & (self._index[None, :] < self._index[:, None])
        before = (theirs < mine) | ((theirs == mine) & ((their_cell < own_cell) | earlier))
        same_node = request.heard[:, :, None] == request.heard[:, None, :]
        rival = same_node & request.sends[:, None, :] & before
        return request.sends & ~xp.any(rival, axis=2)


class Orthogonal(_ToOneReceiver):
    """Every AUV hears in a part of the band that is its own; nothing disturbs it."""

    def __call__(self, request: Request, split: Split) -> Uplinks:
        delivered = self.to_nearest(request)
        return Uplinks(delivered, self._xp.where(delivered, split.required_j, self._zero))


class Exclusive(_ToOneReceiver):
    """One uplink in the whole network; where there are more, all fail, their energy spent."""

    def __call__(self, request: Request, split: Split) -> Uplinks:
        xp = self._xp
        sending = self.to_nearest(request)
        spent_j = xp.where(sending, split.required_j, self._zero)
        if self._num_auvs == 1:
            return Uplinks(sending, spent_j)
        number = xp.sum(xp.astype(sending, spent_j.dtype), axis=1)
        return Uplinks(sending & (number == 1)[:, None], spent_j)


class Interference(_ToOneReceiver):
    """One band for all. The node that AUV a hears sends with the least power P_a for which

        P_a / C_aa = γ_a (1 + D_a + Σ_{b≠a} P_b / C_ab),

    where C_ab is the power that gives the node that AUV b hears an SNR of 1 at AUV a, and
    γ_a the SNR that the packet needs. D_a is what AUVs add that charge while a listens
    (TDD, unless `duplex.synchronised`). Alone a node needs γ_a C_aa; with P_a = y_a γ_a C_aa
    the system is (I − M) y = 1 + D with M_ab = γ_b C_bb / C_ab. As M holds nothing negative,
    a solution y > 0 is there if and only if the powers can be met (Foschini and Miljanic,
    1993), and it is the smallest.

    Where there is none, or a node cannot pay for its power, the weakest link (the highest
    C_aa, then the lowest code of the AUV's cell) stays silent, until the rest can send.
    """

    @unheard
    def __init__(self, scenario: Scenario, link: Link, backend: Backend) -> None:
        super().__init__(scenario, link, backend)
        self._backend = backend
        auvs = range(scenario.num_auvs)
        self._identity = backend.floats([[float(a == b) for b in auvs] for a in auvs])
        self._others = backend.floats([[float(a != b) for b in auvs] for a in auvs])
        duplex = scenario.duplex
        self._charging_disturbs = isinstance(duplex, Tdd) and not duplex.synchronised
        louder = link.budget.charging_disturbance_w / link.power_per_snr_w
        #: By offset: what an AUV that charges there adds to the noise, beside the noise itself.
        self._louder = bounded(louder, 0.0, UPLINK_W[1])
        self._one = backend.floats(1.0)
        self._none = backend.floats(float("-inf"))
        self._beyond = backend.integers(np.iinfo(np.int64).max)

        # What overflows is a system without a solution.
        self._solve = unheard_on_numpy(backend.xp, self._uplinks)

    def __call__(self, request: Request, split: Split) -> Uplinks:
        return self._solve(request, split)

    def _uplinks(self, request: Request, split: Split) -> Uplinks:
        xp = self._xp
        sending, required_j = self.to_nearest(request), split.required_j
        if self._num_auvs == 1:
            return Uplinks(sending, xp.where(sending, required_j, self._zero))
        link = self._link
        cross = link.offset(request.cell[:, :, None], request.node_cell[:, None, :])
        alone_w = xp.where(sending, required_j, self._zero) / split.uplink_s
        coupling = self._others * alone_w[:, None, :] / link.at(link.power_per_snr_w, cross)
        own_w = link.at(link.power_per_snr_w, request.offset)
        quiet = self._one + self._disturbance(request, split)
        factor = quiet
        for _ in range(self._num_auvs):
            factor, solved = self._least_factors(coupling, sending, quiet)
            # At the root of the energy balance a rounding may leave a little too little.
            pays = (factor <= 1) | (request.payable_j >= required_j * factor)
            fails = xp.any(sending & ~(solved & pays), axis=1, keepdims=True)
            if self._backend.surely_none(fails):
                break
            weakness = xp.where(sending, own_w, self._none)
            weakest = sending & (weakness == xp.max(weakness, axis=1, keepdims=True))
            code = xp.where(weakest, request.cell, self._beyond)
            silent = weakest & (code == xp.min(code, axis=1, keepdims=True)) & fails
            sending = sending & ~silent
        return Uplinks(sending, xp.where(sending, required_j * factor, self._zero))

    def _least_factors(self, coupling: Array, sending: Array, quiet: Array) -> tuple[Array, Array]:
        """y of every AUV's uplink, (envs, auvs), and whether there is one, (envs, 1)."""
        both = sending[:, :, None] & sending[:, None, :]
        matrix = self._identity - self._xp.where(both, coupling, self._zero)
        return positive_solution(self._xp, matrix, quiet)

    def _disturbance(self, request: Request, split: Split) -> Array:
        """D: what AUVs that charge longer than another listens for add to its noise."""
        if not self._charging_disturbs:
            return self._zero * split.beta
        xp, link = self._xp, self._link
        between = link.offset(request.cell[:, :, None], request.cell[:, None, :])
        louder = link.at(self._louder, between)
        overlaps = split.beta[:, None, :] > split.beta[:, :, None]
        return xp.sum(xp.where(overlaps, louder, self._zero), axis=2)


def positive_solution(xp: Any, matrix: Array, right: Array) -> tuple[Array, Array]:
    """The y > 0 of A y = b for b > 0, where A has nothing positive beside its diagonal.

    By elimination without a change of rows: all pivots are positive if and only if there is
    such a y (Berman and Plemmons, 1994, ch. 6), and only they are differences. A library's
    solver would stop an accelerator to tell whether A is singular; NumPy's, which is faster
    for many rows, solves those.

    Args:
        xp: array namespace.
        matrix: (…, n, n) A.
        right: (…, n) b.

    Returns:
        (…, n) y, and whether there is one, (…, 1).
    """
    if xp is np and matrix.shape[-1] > _FEW_ROWS:
        singular = np.linalg.det(matrix) == 0
        matrix = np.where(singular[..., None, None], np.eye(matrix.shape[-1]), matrix)
        solution = np.linalg.solve(matrix, right[..., None])[..., 0]
        return solution, ((solution > 0).all(-1) & ~singular)[..., None]

    def divisor(pivot: Array) -> Array:
        return xp.where(pivot > 0, pivot, xp.ones_like(pivot))

    rows = []
    for _ in range(matrix.shape[-1]):
        pivot, row, of_row = matrix[..., :1, 0], matrix[..., 0, 1:], right[..., :1]
        rows.append((pivot, row, of_row))
        share = matrix[..., 1:, 0] / divisor(pivot)
        right = right[..., 1:] - share * of_row
        matrix = matrix[..., 1:, 1:] - share[..., None] * row[..., None, :]
    solution = right
    for pivot, row, of_row in reversed(rows):
        known = xp.sum(row * solution, axis=-1, keepdims=True)
        solution = xp.concat([(of_row - known) / divisor(pivot), solution], axis=-1)
    pivots = xp.concat([pivot for pivot, _, _ in rows], axis=-1)
    return solution, xp.all(pivots > 0, axis=-1, keepdims=True)


#: The parts for the shared band, by `channel.access`.
ACCESS: dict[str, Callable[[Scenario, Link, Backend], Access]] = {
    "orthogonal": Orthogonal,
    "interference": Interference,
    "exclusive": Exclusive,
}


def make_access(scenario: Scenario, link: Link, backend: Backend) -> Access:
    """The part that a scenario names."""
    return ACCESS[scenario.channel.access](scenario, link, backend)
