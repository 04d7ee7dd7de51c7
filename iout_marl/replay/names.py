"""What the policies of recordings are called where they are shown."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import PurePath

from iout_marl.replay.recording import Recording


def short_names(recordings: Sequence[Recording]) -> list[str]:
    """The policies' names; of runs the last folders of their paths that tell them apart.

    What is shown to others need not say where the runs of its author lie.
    """
    parts = [PurePath(each.policy).parts or (each.policy,) for each in recordings]
    for length in range(1, max(map(len, parts)) + 1):
        names = ["/".join(each[-length:]) for each in parts]
        if len(set(names)) == len({each.policy for each in recordings}):
            return names
    return [each.policy for each in recordings]
