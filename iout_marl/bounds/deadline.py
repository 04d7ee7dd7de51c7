"""The end of a search's time, looked for in the midst of its steps."""

from __future__ import annotations

import time


class OutOfTime(Exception):  # noqa: N818 (it is no error)
    """A step was given up."""


def check_time(deadline: float) -> None:
    """See that a deadline, by `time.monotonic`, has not come.

    Raises:
        OutOfTime: it has.
    """
    if time.monotonic() > deadline:
        raise OutOfTime
