"""One training at a time in a run's folder."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from iout_marl.files import LOCK_NAME, locked

#: How long to wait for a lock that others hold for a moment, as they look who is there.
GLANCE_S = 2.0
_REFUSAL = "another process is training in it; wait for it, or name another folder by --out"


@contextmanager
def occupied(out: Path, members: Sequence[Path]) -> Iterator[None]:
    """Keep other trainings out of a folder, and out of those of its policies.

    Only the lock of `out` is held, since a process can hold only so many files open. Of the
    others it is seen to that nobody holds them: those of the policies in `out`, and, where `out`
    is itself that of one policy of several, that of the folder above, whose holder would train
    this policy too. Each takes its own lock before it looks at others, so that of two that begin
    at the same time at least one sees the other.

    Args:
        out: the folder, which must be there.
        members: those of several policies in it, there or not; a lone one's is `out` itself.

    Raises:
        InputError: another process trains there.
    """
    with locked(out, _REFUSAL):
        place = out.resolve()
        is_member = re.fullmatch(r"seed-\d+", place.name) is not None
        above = [place.parent] if is_member and (place.parent / LOCK_NAME).exists() else []
        for other in (*above, *(path for path in members if path != out and path.is_dir())):
            with locked(other, _REFUSAL, GLANCE_S):
                pass
        yield
