"""How a VecEnv of Stable-Baselines3 is played in tests."""

import copy

import numpy as np
from env_cases import SLOTS

#: Long enough for two ends.
PLAYED = 2 * SLOTS + 3


def actions_for(vec_env, slots=PLAYED, seed=0):
    rng = np.random.default_rng(seed)
    sizes = np.tile(vec_env.action_space.nvec, (vec_env.num_envs, 1))
    return [rng.integers(0, sizes) for _ in range(slots)]


def row(observations, i):
    """What one slot of the VecEnv sees."""
    if isinstance(observations, dict):
        return {name: values[i] for name, values in observations.items()}
    return observations[i]


def without_seconds(infos):
    """Infos without what differs from one second to the next."""
    bare = copy.deepcopy(infos)
    for info in bare:
        if "episode" in info:
            del info["episode"]["t"]
    return bare


def played(vec_env, slots=PLAYED):
    """Everything that is handed out from now on."""
    steps = [vec_env.step(actions) for actions in actions_for(vec_env, slots)]
    return [(*rest, without_seconds(infos)) for *rest, infos in steps]
