"""Names that have changed: the old ones still lead to the new ones, for one version."""

from __future__ import annotations

import warnings


def warn_renamed(old: str, new: str) -> None:
    """Warn of a name that was used: the warning shows the line that used it.

    Args:
        old, new: dotted names.
    """
    warnings.warn(
        f"{old} is now {new}; the old name will be removed in the next version",
        DeprecationWarning,
        stacklevel=3,
    )
