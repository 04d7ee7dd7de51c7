"""Trains as `python -m trainers.ppo` does; the process that LOST names dies meanwhile."""

import os
import sys

from iout_marl.cli import main
from trainers import Trainer

iterate, ITERATIONS = Trainer.iterate_all, 5


def iterate_and_die(trainer):
    logs = iterate(trainer)
    is_time = trainer.env_steps >= ITERATIONS * trainer.steps_per_iteration
    if is_time and trainer.runtime.group.rank == int(os.environ["LOST"]):
        os._exit(7)
    return logs


if __name__ == "__main__":
    Trainer.iterate_all = iterate_and_die
    main(["train", *sys.argv[1:]])
