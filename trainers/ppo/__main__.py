"""`python -m trainers.ppo SCENARIO …` is `iout train SCENARIO …`, for `torchrun` to start."""

import sys

from iout_marl.cli import main

if __name__ == "__main__":
    main(["train", *sys.argv[1:]])
