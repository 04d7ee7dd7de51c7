"""AUVs that charge underwater sensor nodes by sound and collect their data.

| | |
|---|---|
| Import | `from iout_marl import iout_v0` |
| Make | `pettingzoo.make("parallel", "iout/AUV-v0", scenario=…)`, or `"aec"` |
| Actions | discrete |
| Parallel API | yes |
| Manual control | no |
| Agents | `auv_0` … `auv_{M-1}`, one for each AUV of the scenario |
| Action space | FDD `MultiDiscrete([6, K, K])`, TDD `MultiDiscrete([6, K])` (7 with hovering) |
| Observation space | `Box(3 + 2K + 3(M − 1))`, float32, finite bounds |
| State space | `Box(3M + 6K + 1)`, float32, finite bounds |

Sensor nodes without batteries lie in a grid of cells of water (`grid.spacing_m`: cubes, or
boxes of three edges; a slot is the time for the longest). In every slot an AUV moves one
cell, charges one node by acoustic energy transfer and asks one node for its packet, which
the node sends if the energy it has stored pays for it. The task is to keep the data fresh
(Age of Information), and to leave no node out (Jain's fairness).

**Actions**: direction (+x, −x, +y, −y, +z, −z), node to charge, node to hear; in TDD one
node for both; with `auvs.motion: hover` a seventh direction stays. With
`auvs.idle_choices: true` each choice of a node has one more value, the last, K: nobody. An
AUV that charges nobody makes no sound for it; one that hears nobody gets no packet, and takes
nothing of the band. Useless choices are harmless: they cost what the scenario says. In a grid of
one cell every direction stays. Where `episode.slot_s` makes moves take several slots, the
direction of an AUV under way is ignored; its mask has the first alone. An action outside its
space, a missing action, an unknown agent, and a step before a reset or after the end are
refused in one line.

**Several AUVs** move at once: those whose moves would end in one cell, or nearer than
`auvs.separation_cells`, or swap their cells, stay where they are. A node that several
charge takes from all; one that several hear sends once, to the nearest. How uplinks to
different AUVs share the band is said by `channel.access`.

**Observations**: own position in cells, counted from 1 (3), ages of the nodes in slots
(K), energies stored in the nodes in J (K), and with several AUVs the steps in cells to
each other one, the nearest first. The scenario may scale them, append the nodes' positions,
the time or the AUV's index, leave the others out, limit how far an AUV knows ages and
energies (`observation.view_range_m`), and add a mask of sensible actions. The bounds of the
space lie far above usual energies: to normalise, take `observation.kind: scaled` or
`observation_ranges`, not the space (see `docs/python.md`).

**Rewards**: the scenario's, by default the paper's: minus the mean age times the
discrimination index 1 − J, minus penalties for leaving the grid, for failed uplinks, and
for a node that is served too often. What the network gains goes to the team, or to each AUV
for what it has added (`reward.credit: difference`).

**Episodes** have a fixed number of slots (100 in the paper), the same for all AUVs; the
last slot truncates, it does not terminate.

**Infos** have the same numeric keys from `reset` on: see
`iout_marl.envs.episodes.EpisodeBatch.info`. `aoi_now` is the mean age over nodes in this slot,
`time_mean_aoi` its mean over the slots so far: what `iout_marl.evaluate` calls `mean_aoi`. The
`mean_aoi` of infos is misleading: it means `aoi_now`, and does so until `iout_v1`.

**Arguments**: `scenario`, a bundled name (`paper/k10-fdd`), a path to a YAML file, a mapping
with the keys of one or a `Scenario`; `render_mode`: `human` prints every slot, `render` returns
text with `ansi` and pixels with `rgb_array`; None draws nothing; `max_cycles`, the slots of an
episode, 1 or more, where it is to have another number than the scenario says; `overrides`,
changes of the scenario, `{"auvs.count": 3}` or `"auvs.count=3"`. `reset` takes a `seed` from 0
on; `options` have no effect.

**Version history**: v0, initial release.
"""

from __future__ import annotations

from typing import Any

from pettingzoo import AECEnv
from pettingzoo.utils import parallel_to_aec

from iout_marl.envs.aec import CheckedAECEnv
from iout_marl.envs.arguments import scenario_of
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.scenario import AnyScenario, Overrides


def parallel_env(
    scenario: AnyScenario = "paper/k10-fdd",
    render_mode: str | None = None,
    max_cycles: int | None = None,
    *,
    overrides: Overrides = None,
) -> AUVParallelEnv:
    """The environment in PettingZoo's parallel form, its native one."""
    return AUVParallelEnv(scenario_of(scenario, max_cycles, overrides), render_mode)


def raw_env(
    scenario: AnyScenario = "paper/k10-fdd",
    render_mode: str | None = None,
    max_cycles: int | None = None,
    *,
    overrides: Overrides = None,
) -> AECEnv[str, Any, Any]:
    """The environment in PettingZoo's AEC form, without checks of how it is used."""
    return parallel_to_aec(parallel_env(scenario, render_mode, max_cycles, overrides=overrides))


def env(
    scenario: AnyScenario = "paper/k10-fdd",
    render_mode: str | None = None,
    max_cycles: int | None = None,
    *,
    overrides: Overrides = None,
) -> AECEnv[str, Any, Any]:
    """The environment in PettingZoo's AEC form."""
    return CheckedAECEnv(raw_env(scenario, render_mode, max_cycles, overrides=overrides))
