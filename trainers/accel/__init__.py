"""How the work of a training is executed: eagerly or as captured graphs, by one process or more.

A trainer knows only the `Runtime`.
"""

from trainers.accel.runtime import Runtime

__all__ = ["Runtime"]
