"""Pictures of an environment: text for a terminal, pixels for a film.

Importing this loads no matplotlib: only `as_picture` does, when it is called.
"""

from iout_marl.render.picture import as_picture
from iout_marl.render.snapshot import Snapshot
from iout_marl.render.text import as_text, print_text

__all__ = ["Snapshot", "as_picture", "as_text", "print_text"]
