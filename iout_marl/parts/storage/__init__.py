"""Storage: what the nodes' energy stores hold, and what they lose."""

from iout_marl.parts.storage.base import Rest, Storage, storages

__all__ = ["Rest", "Storage", "storages"]
