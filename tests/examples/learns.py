"""Runs an example of `examples/` and fails unless it learned. Part of `make integrations`.

python tests/examples/learns.py rllib [--steps 30000]
"""

import importlib
import math
import sys
from pathlib import Path

#: Slots of mean AoI. Half the 95 % interval of 100 episodes of random actions is 0.15.
MARGIN = 0.2


def main() -> None:
    name, *options = sys.argv[1:]
    # As a module with a name, since some libraries pickle what it defines.
    sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
    before, after = importlib.import_module(f"train_{name}").main(options)
    if not (math.isfinite(after) and after < before - MARGIN):
        sys.exit(f"train_{name}.py did not learn: mean AoI {before:.2f} before, {after:.2f} after")


if __name__ == "__main__":
    main()
