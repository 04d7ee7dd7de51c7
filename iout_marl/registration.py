"""Entries in the registries of Gymnasium and PettingZoo."""

from __future__ import annotations

import gymnasium
import pettingzoo

#: Gymnasium's id; `gymnasium.make("iout_marl:AUV-v0")` imports the package by itself.
GYMNASIUM_ID = "AUV-v0"
#: PettingZoo's id, for `pettingzoo.make("parallel", "iout/AUV-v0")` and `"aec"`.
PETTINGZOO_ID = "iout/AUV-v0"


def register() -> None:
    """Make the `make` functions of Gymnasium and PettingZoo know the environments."""
    _register_gymnasium()
    _register_pettingzoo()


def _register_gymnasium() -> None:
    """Make `gymnasium.make` and `gymnasium.make_vec` know the joint environment."""
    if GYMNASIUM_ID not in gymnasium.registry:
        gymnasium.register(
            GYMNASIUM_ID,
            entry_point="iout_marl.envs.joint:AUVEnv",
            vector_entry_point="iout_marl.envs.vector:AUVVectorEnv",
        )


def _register_pettingzoo() -> None:
    """Make `pettingzoo.make` know both forms, where PettingZoo has a registry (1.27 on)."""
    register = getattr(pettingzoo, "register", None)
    if register is None:
        return
    if PETTINGZOO_ID not in pettingzoo.parallel_registry:
        register("parallel", PETTINGZOO_ID, "iout_marl.iout_v0:parallel_env")
    if PETTINGZOO_ID not in pettingzoo.aec_registry:
        register("aec", PETTINGZOO_ID, "iout_marl.iout_v0:env")
