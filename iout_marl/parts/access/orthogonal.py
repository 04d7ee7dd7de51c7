"""A part of the band for each AUV."""

from __future__ import annotations

from iout_marl.core.split import Split
from iout_marl.parts.access.base import Access, Request, Uplinks, access_rules


@access_rules.register("orthogonal")
class Orthogonal(Access):
    """The band is divided evenly: every AUV hears in its own part, and nothing disturbs it.

    The same packet in a narrower band costs more energy, with M AUVs about M times as much where
    it is proportional to 2^(L/(τB)) − 1, as in the channel `table`.
    """

    def num_bands(self, num_auvs: int) -> int:
        return num_auvs

    def __call__(self, request: Request, split: Split) -> Uplinks:
        delivered = self.to_nearest(request)
        return Uplinks(delivered, self.xp.where(delivered, split.required_j, self._zero))
