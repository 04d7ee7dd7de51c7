"""AUVs that charge underwater sensor nodes by sound and collect their data.

The environment's page is `iout_marl.iout_v0`.
"""

# isort: off
from iout_marl import startup  # noqa: F401 (before all that takes its time)
# isort: on

from iout_marl import iout_v0
from iout_marl.envs.registration import register_gymnasium, register_pettingzoo
from iout_marl.errors import InputError
from iout_marl.evaluation import Evaluation, evaluate
from iout_marl.scenario import Scenario, bundled_names, load_scenario
from iout_marl.world import World

__version__ = "0.1.0"

register_gymnasium()
register_pettingzoo()

__all__ = [
    "Evaluation",
    "InputError",
    "Scenario",
    "World",
    "bundled_names",
    "evaluate",
    "iout_v0",
    "load_scenario",
]
