"""The frames of a film of an episode, or of two side by side."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from iout_marl.render import as_picture
from iout_marl.render.film import Frame
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
    is_compared = len(recordings) > 1
    return np.concatenate([_picture(each, place, is_compared) for each in recordings], axis=1)


def _picture(recording: Recording, place: int, is_compared: bool) -> Frame:  # noqa: FBT001
    place = min(place, recording.slots)
    snapshot = recording.snapshot(place)
    if is_compared:
        snapshot = replace(snapshot, title=f"{recording.policy}, {recording.scenario}")
    trail = recording.path[max(place - TRAIL_SLOTS, 0) : place]
    return as_picture(snapshot, trail if len(trail) else None)
