"""Episodes recorded, and played again: as a page for a browser, or as a film."""

from iout_marl.replay.environments import record
from iout_marl.replay.recorder import Recorder, record_policy
from iout_marl.replay.recording import Recording

__all__ = ["Recorder", "Recording", "record", "record_policy"]
