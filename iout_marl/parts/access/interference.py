"""One band for all, and as much power as each uplink needs against the others."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.core.limits import UPLINK_W, bounded, unheard, unheard_on_numpy
from iout_marl.core.reasons import CHARGING_NOISE, INTERFERENCE, Reason
from iout_marl.core.split import Split
from iout_marl.parts.access.base import Access, Floats, Request, Uplinks, access_rules
from iout_marl.parts.base import Context
from iout_marl.physics.arrays import Array, rounds_otherwise

#: Up to which NumPy eliminates as fast as it solves, in batches of hundreds of systems or more.
_FEW_ROWS = 4


@access_rules.register("interference")
class Interference(Access):
    """One band for all: nodes send with the least powers that let every packet through.

    The node that AUV a hears sends with the least power P_a for which

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

    uplinks_disturb = True

    @unheard
    def setup(self, world: Context) -> None:
        super().setup(world)
        backend, link = world.backend, world.link
        auvs = range(self._num_auvs)
        self._identity = backend.floats([[float(a == b) for b in auvs] for a in auvs])
        self._others = backend.floats([[float(a != b) for b in auvs] for a in auvs])
        self.charging_disturbs = world.scenario.duplex.part.charging_disturbs_uplinks
        louder = link.budget.charging_disturbance_w / link.power_per_snr_w
        #: By offset: what an AUV that charges there adds to the noise, beside the noise itself.
        self._louder = bounded(louder, 0.0, UPLINK_W[1])
        self._one = backend.floats(1.0)
        self._none = backend.floats(float("-inf"))
        self._beyond = backend.integers(np.iinfo(np.int64).max)

        # What overflows is a system without a solution.
        self._solve = unheard_on_numpy(self.xp, self._uplinks)

    def __call__(self, request: Request, split: Split) -> Uplinks:
        return self._solve(request, split)

    def _uplinks(self, request: Request, split: Split) -> Uplinks:
        xp = self.xp
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
            pays = (factor <= 1) | (request.available_j >= required_j * factor)
            fails = xp.any(sending & ~(solved & pays), axis=1, keepdims=True)
            if self.world.backend.surely_none(fails):
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
        matrix = self._identity - self.xp.where(both, coupling, self._zero)
        return positive_solution(self.xp, matrix, quiet)

    def _disturbance(self, request: Request, split: Split) -> Array:
        """D: what AUVs that charge longer than another listens for add to its noise."""
        if not self.charging_disturbs:
            return self._zero * split.beta
        xp, link = self.xp, self._link
        between = link.offset(request.cell[:, :, None], request.cell[:, None, :])
        louder = link.at(self._louder, between)
        overlaps = split.beta[:, None, :] > split.beta[:, :, None]
        return xp.sum(xp.where(overlaps, louder, self._zero), axis=2)

    def why_lost(self, request: Request, split: Split) -> Mapping[Reason, Array]:
        # What charging adds is too much if a node cannot outdo it even without other uplinks.
        alone_j = split.required_j * (self._one + self._disturbance(request, split))
        drowned = (alone_j > split.required_j) & (request.available_j < alone_j)
        return {
            **super().why_lost(request, split),
            CHARGING_NOISE: drowned,
            INTERFERENCE: request.sends,
        }

    def spoils(self, first: Floats, second: Floats) -> npt.NDArray[np.bool_] | None:
        """Whether of two AUVs that charge for these shares one spoils what the other hears.

        An AUV that charges the longer drowns the uplink to one that listens meanwhile. Where the
        node was charged for just what it needs, it cannot make up for it.
        """
        if not self.charging_disturbs:
            return None
        shorter, longer = np.minimum(first, second), np.maximum(first, second)
        drowns: npt.NDArray[np.bool_] = (shorter > 0) & (shorter < longer)
        return drowns


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
    if matrix.shape[-1] > _FEW_ROWS:
        if xp is np:
            singular = np.linalg.det(matrix) == 0
            matrix = np.where(singular[..., None, None], np.eye(matrix.shape[-1]), matrix)
            solution = np.linalg.solve(matrix, right[..., None])[..., 0]
            return solution, ((solution > 0).all(-1) & ~singular)[..., None]
        rounds_otherwise(xp)

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
