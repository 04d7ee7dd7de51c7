"""The frames of a film of an episode, or of two side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from iout_marl.render import as_picture
from iout_marl.render.film import Frame
from iout_marl.replay.names import short_names
from iout_marl.replay.recording import Recording

#: Slots that the trail behind an AUV reaches back.
TRAIL_SLOTS = 12


def frames(recordings: Sequence[Recording]) -> Iterator[Frame]:
    """A picture of the start and one after each slot, see `frame`."""
    for place in range(max(recording.slots for recording in recordings) + 1):
        yield frame(recordings, place)


def frame(recordings: Sequence[Recording], place: int) -> Frame:
    """The picture after `place` slots, (600, 960, 3), of two episodes 1920 wide.

    An episode that is over waits at its end. Where there are two, each is titled by its policy.
    """
    places = [min(place, each.slots) for each in recordings]
    snapshots = [each.snapshot(at) for each, at in zip(recordings, places, strict=True)]
    if len(recordings) > 1:
        names = short_names(recordings)
        snapshots = [
            replace(shown, title=f"{name}, {each.scenario}")
            for shown, name, each in zip(snapshots, names, recordings, strict=True)
        ]
    # Side by side, energies have one axis.
    most_j = max(float(np.max(shown.energies_j)) for shown in snapshots)
    trails = [
        each.positions()[max(at - TRAIL_SLOTS, 0) : at]
        for each, at in zip(recordings, places, strict=True)
    ]
    pictures = [
        as_picture(shown, trail if len(trail) else None, most_j)
        for shown, trail in zip(snapshots, trails, strict=True)
    ]
    return np.concatenate(pictures, axis=1)
