"""Episodes recorded, and played again: as a page for a browser, or as a film."""

from typing import TYPE_CHECKING, Any

from iout_marl.replay.recorder import Recorder, record_policy
from iout_marl.replay.recording import Recording

if TYPE_CHECKING:
    from iout_marl.replay.environments import record

__all__ = ["Recorder", "Recording", "record", "record_policy"]


def __getattr__(name: str) -> Any:
    if name != "record":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # It takes the environments along, which recordings of policies do without.
    from iout_marl.replay.environments import record

    return record
