"""Makes the weights that come with the package of the runs that were trained for them.

    python -m trainers.pretraining RUN … [--out FILE]

One run for each kind of duplex operation; what the file holds of others stays. `make pretrained`
trains them before.
"""

from __future__ import annotations

import argparse
import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import safetensors
import safetensors.torch
from torch import Tensor

from iout_marl.errors import InputError
from iout_marl.files import to_json
from iout_marl.machine import processor, versions
from iout_marl.scenario.drawing import Families
from iout_marl.scenario.extent import extent_of
from iout_marl.scenario.loading import to_yaml
from iout_marl.terminal import present
from trainers.pretrained import FORMAT, MODES, WEIGHTS, load_modes
from trainers.runs.folder import RunFolder

#: Scenarios drawn to find out from where to where those of a training reach.
DRAWN = 2000


def packed(runs: Sequence[Path], before: Path) -> bytes:
    """The contents of a file of weights.

    Args:
        runs: folders of finished runs.
        before: the file as it is, which need not be there.

    Raises:
        InputError: one is no finished run over several scenarios, or two are of one kind; or the
            file before is of another version.
    """
    tensors: dict[str, Tensor] = {}
    metadata: dict[str, str] = {}
    for path in runs:
        folder = RunFolder(path)
        scenario, result = folder.scenario(), folder.result()
        name = MODES[scenario.duplex.part.num_choices]
        if result is None or not scenario.training.over:
            raise InputError(f"{path}: is no finished training over several scenarios")
        if name in metadata:
            raise InputError(f"{path}: is a second run for duplex.kind {scenario.duplex.kind}")
        weights = folder.load_policy().network.state_dict()
        tensors |= {f"{name}.{key}": tensor.contiguous() for key, tensor in weights.items()}
        rng, families = np.random.default_rng(0), Families.from_scenario(scenario)
        told: dict[str, Any] = json.loads(result)
        about = {
            "scenario": to_yaml(scenario),
            "extent": extent_of(families.draw(rng).scenario for _ in range(DRAWN)),
            "env_steps": told["env_steps"],
            "seconds": told["seconds"],
            "seed": told["seed"],
            "processor": processor(),
            "versions": versions(),
            "hash": hashed(weights),
        }
        metadata[name] = to_json(about)
    if before.exists():
        load_modes(before)  # refuses what is damaged, or of another version
        with safetensors.safe_open(before, "pt") as file:
            kept = {name: file.metadata()[name] for name in file.metadata() if name not in metadata}
            tensors |= {
                name: file.get_tensor(name)
                for name in file.keys()  # noqa: SIM118
                if name.partition(".")[0] in kept
            }
        metadata |= kept
    return safetensors.torch.save(tensors, {**metadata, "format": str(FORMAT)})


def hashed(weights: dict[str, Tensor]) -> str:
    """SHA-256 of weights, by name."""
    digest = hashlib.sha256()
    for name, tensor in sorted(weights.items()):
        digest.update(name.encode() + tensor.contiguous().numpy().tobytes())
    return digest.hexdigest()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=WEIGHTS)
    arguments = parser.parse_args()
    contents = packed(arguments.runs, arguments.out)
    arguments.out.parent.mkdir(exist_ok=True)
    arguments.out.write_bytes(contents)
    present(f"{arguments.out}: {len(contents):,} bytes")


if __name__ == "__main__":
    main()
