"""Arguments of environments: each is checked once, and named where it is wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.vector import AutoresetMode

from iout_marl.errors import InputError, did_you_mean
from iout_marl.extras import require
from iout_marl.scenario import AnyScenario, Overrides, Scenario, load_scenario
from iout_marl.whole import short, whole_argument

RENDER_MODES = ("human", "ansi", "rgb_array")
#: More processes than any machine has cores for, more slots than an episode may have.
MOST_PROCESSES, MOST_CYCLES = 10**4, 10**9


def scenario_of(
    scenario: AnyScenario, max_cycles: Any = None, overrides: Overrides = None
) -> Scenario:
    """The scenario that is meant, with another number of slots where one is given.

    Raises:
        InputError: no such scenario, a fault in it, or an argument is something else.
    """
    loaded = load_scenario(scenario, overrides)
    if max_cycles is None:
        return loaded
    slots = whole_argument("max_cycles", max_cycles, 1, MOST_CYCLES)
    return load_scenario(loaded, {"episode.duration_s": slots * loaded.slot_s})


def render_mode_of(mode: Any) -> str | None:
    """The render mode.

    Raises:
        InputError: it is unknown, or what it needs is not installed.
    """
    if isinstance(mode, str) and mode == "rgb_array":
        require("render_mode='rgb_array'", "report", "matplotlib")
    if mode is None or (isinstance(mode, str) and mode in RENDER_MODES):
        return mode
    raise InputError(f"render_mode must be one of {RENDER_MODES} or None, not {short(mode)}")


def autoreset_mode_of(mode: Any) -> AutoresetMode:
    """The autoreset mode, by Gymnasium's names or values.

    Raises:
        InputError: it is unknown.
    """
    if isinstance(mode, AutoresetMode):
        return mode
    known = {name: each for each in AutoresetMode for name in (each.name, each.value)}
    if isinstance(mode, str) and mode in known:
        return known[mode]
    hint = did_you_mean(str(mode), known)
    raise InputError(f"autoreset_mode: no mode is called {short(mode)}{hint}")


def seed_of(seed: Any, name: str = "seed") -> int | None:
    """The seed of a stream of random layouts.

    Raises:
        InputError: it is no whole number from 0 on, nor None.
    """
    if seed is None:
        return None
    return whole_argument(name, seed, 0)


def seeds_of(seed: Any, num_envs: int) -> list[int | None] | None:
    """The seed of each environment: `seed + i`, or `seed[i]`.

    Raises:
        InputError: it is neither a seed nor a list with one for each environment.
    """
    if seed is None:
        return None
    if not isinstance(seed, Sequence | np.ndarray) or isinstance(seed, str | bytes):
        first = seed_of(seed)
        assert first is not None
        return [first + i for i in range(num_envs)]
    if np.ndim(seed) != 1 or len(seed) != num_envs:
        raise InputError(f"seed: expected {num_envs} seeds, not {len(seed)}")
    return [seed_of(each, f"seed[{i}]") for i, each in enumerate(seed)]


def options_of(options: Any) -> dict[str, Any]:
    """The options of a reset. Unknown ones are left alone: wrappers have some of their own.

    Raises:
        InputError: they are no mapping.
    """
    if options is None or isinstance(options, Mapping):
        return dict(options or {})
    raise InputError(f"options must be a mapping or None, not {short(options)}")


def reset_mask_of(mask: Any, num_envs: int) -> npt.NDArray[np.bool_]:
    """Which environments a reset is for.

    Raises:
        InputError: it is not (envs,) bools of which one is true.
    """
    is_array = isinstance(mask, np.ndarray) and mask.dtype == np.bool_
    if not is_array or mask.shape != (num_envs,) or not mask.any():
        raise InputError(
            f"options['reset_mask'] must be a NumPy array of {num_envs} bools, one at least true, "
            f"not {short(mask)}"
        )
    flags: npt.NDArray[np.bool_] = mask
    return flags
