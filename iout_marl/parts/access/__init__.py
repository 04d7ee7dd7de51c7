"""Access: how uplinks to several AUVs share the band."""

from iout_marl.parts.access.base import Access, Request, Uplinks, access_rules

__all__ = ["Access", "Request", "Uplinks", "access_rules"]
