"""The world behind the APIs of PettingZoo, Gymnasium and Stable-Baselines3."""

from iout_marl.envs.joint import AUVEnv
from iout_marl.envs.parallel import AUVParallelEnv
from iout_marl.envs.sb3 import sb3_vec_env, supersuit_vec_env
from iout_marl.envs.vector import AUVVectorEnv

__all__ = ["AUVEnv", "AUVParallelEnv", "AUVVectorEnv", "sb3_vec_env", "supersuit_vec_env"]
