"""A run on disk: scenario, policy, checkpoint, logs, result.

| file | holds |
|---|---|
| `scenario.yaml` | the scenario, resolved |
| `policy.safetensors`, `policy.json` | the networks' weights, and their shape |
| `checkpoint.pt` | all that training continues from |
| `result.json` | the final policy's evaluation |
| `data-*` | copies of the files of data that the scenario names, by their SHA-256 |
| `run.json` | which contents of the files above belong together, see `trainers.runs.saving` |
| `metrics.jsonl` | a line for every iteration |
| `events.out.tfevents.*` | the same for TensorBoard |
| `run.json.begun` | until the first save: the logs are a run's, see `trainers.runs.beginning` |
| `.lock` | keeps a second training out |
"""

from __future__ import annotations

import io
import pickle
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch

from iout_marl.errors import InputError
from iout_marl.files import (
    LOCK_NAME,
    parse_json,
    read_if_there,
    reason,
    to_json,
    user_path,
    write_atomically,
)
from iout_marl.outside import load_entry_points, source_of
from iout_marl.registry import registry_of
from iout_marl.scenario import Scenario, parse_scenario
from iout_marl.scenario.data_files import data_files
from iout_marl.scenario.parts import outside_parts
from iout_marl.world import WORLD_VERSION, World
from trainers.base import BaseTrainer
from trainers.factory import make_network
from trainers.networks import ActorCritic
from trainers.runs import beginning, saving
from trainers.runs.checking import check_like
from trainers.trained import TrainedPolicy

#: Changes whenever older files can no longer be read.
FORMAT = 2
#: What parts of older saves are called today.
_RENAMED = {"return_spread": "return_std", "simulation": "collector"}
#: Patterns of the copies of files of data, and of all that a run writes beside its saves.
COPIES = f"data-{'[0-9a-f]' * 12}-*"
LOGS = ("metrics.jsonl", "metrics.jsonl.part", "events.out.tfevents.*", COPIES)
#: What `policy.json` must say to be of use, and in which type.
_SHAPE = {"world_hash": str, "source_world_hash": str, "mask_actions": bool}


@dataclass(frozen=True, init=False)
class RunFolder:
    """The folder of a run.

    Args:
        path: where it is.

    Raises:
        InputError: when made, of what is no path; when read, of files that cannot be read or
            are damaged.
    """

    path: Path

    def __init__(self, path: str | Path) -> None:
        object.__setattr__(self, "path", user_path(path, "run folder"))

    @property
    def checkpoint_path(self) -> Path:
        """The checkpoint."""
        return self.path / "checkpoint.pt"

    @property
    def metrics_path(self) -> Path:
        """The log, a JSON object a line."""
        return self.path / "metrics.jsonl"

    def refuse_if_used(self) -> None:
        """Leave a run that is there alone.

        Raises:
            InputError: the folder holds a run already.
        """
        if saving.is_used(self.path):
            raise InputError(
                f"{self.path}: holds a run already; continue with it by --resume, "
                "or name another folder by --out"
            )

    def refuse_what_is_no_runs(self) -> None:
        """Leave files alone that a new run would write over, and that no run has left.

        Raises:
            InputError: there is one, or the folder cannot be read.
        """
        beginning.refuse_what_is_no_runs(self.path / saving.MANIFEST, LOGS)

    def create(self) -> None:
        """Make the folder ready for a new run, once nothing that is there was refused.

        Raises:
            InputError: it cannot be made.
        """
        beginning.begin(self.path / saving.MANIFEST, LOGS)

    def copy_data(self, scenario: Scenario) -> None:
        """Put copies of a scenario's files of data where its `scenario.yaml` looks for them.

        They are no part of the saves: the scenario has the SHA-256 of each.

        Raises:
            InputError: one cannot be written.
        """
        for file in set(data_files(scenario)):
            path = self.path / file.name_of_copy
            if read_if_there(path) != file.contents:
                write_atomically(path, file.contents)

    def saved_files(
        self, trainer: BaseTrainer, state: dict[str, Any], policy: int = 0
    ) -> dict[str, bytes]:
        """What there is to save, all but scenario and result, by name.

        Args:
            trainer: what to save.
            state: its `state_dict` of the policy.
            policy: which of the trainer's.
        """
        scenario = trainer.scenarios[policy]
        checkpoint = {
            "format": FORMAT,
            "world_version": WORLD_VERSION,
            "world_hash": scenario.world_hash,
            "trainer": state,
        }
        buffer = io.BytesIO()
        torch.save(checkpoint, buffer)
        weights = {k: v.contiguous().cpu() for k, v in state["network"].items()}
        world = trainer.collector.world
        shape = {
            "format": FORMAT,
            "world_version": WORLD_VERSION,
            "scenario": scenario.name,
            "scenario_hash": scenario.hash,
            "world_hash": scenario.world_hash,
            "source_world_hash": trainer.source.world_hash,
            "env_steps": trainer.env_steps,
            "num_auvs": world.num_auvs,
            "observation_entries": len(world.observer.agent_ranges.low),
            "action_sizes": list(world.action_sizes),
            "hidden_units": list(trainer.settings.hidden_units),
            "activation": trainer.settings.activation,
            "network": trainer.settings.network.kind,
            "mask_actions": trainer.settings.mask_actions,
        }
        outside = [
            {
                "role": entry.role,
                "kind": entry.kind,
                "version": entry.version,
                "import": source_of(entry.module),
            }
            for entry in dict.fromkeys(outside_parts(scenario))
        ]
        if outside:
            shape["parts"] = outside
        return {
            "policy.safetensors": safetensors.torch.save(weights),
            "policy.json": (to_json(shape, indent=2) + "\n").encode(),
            "checkpoint.pt": buffer.getvalue(),
        }

    def scenario(self) -> Scenario:
        """The run's scenario.

        Raises:
            InputError: the folder holds no run.
        """
        return self._scenario(self._files())

    def result(self) -> bytes | None:
        """`result.json`; None where the training is not finished."""
        return self._files().get("result.json")

    def missing(self) -> list[str]:
        """Names of the files of a finished training that are not there."""
        return sorted(set(saving.NAMES) - self._files().keys())

    def load_checkpoint(self) -> dict[str, Any]:
        """The trainer's `state_dict` from the checkpoint, on the CPU; not checked any further.

        Raises:
            InputError: there is none, it is damaged, of another version, or holds objects
                other than tensors and plain values.
        """
        files, path = self._files(), self.checkpoint_path
        if path.name not in files:
            raise InputError(f"{self.path}: holds no checkpoint")
        with readable(path), warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of what is odd, but loads
            contents = io.BytesIO(files[path.name])
            saved = torch.load(contents, map_location="cpu", weights_only=True)
        _check_version(path, saved)
        world_hash = saved.get("world_hash")
        if not isinstance(world_hash, str) or world_hash != self._scenario(files).world_hash:
            raise InputError(f"{path}: is of another scenario than scenario.yaml beside it")
        trainer = saved.get("trainer")
        if not isinstance(trainer, dict):
            raise InputError(f"{path}: cannot be read: trainer is no mapping")
        trainer = _renamed(trainer)
        if isinstance(trainer.get("network"), dict):
            trainer["network"] = _renamed(trainer["network"])
        return trainer

    def policy_shape(self) -> dict[str, Any]:
        """What `policy.json` says.

        Raises:
            InputError: there is no policy, or it is of another version.
        """
        return self._shape(self._files())

    def load_policy(self, device: str | torch.device = "cpu") -> TrainedPolicy:
        """The trained policy.

        Raises:
            InputError: there is none, it is damaged, or of another version.
        """
        files = self._files()
        shape = self._shape(files)
        scenario = self._scenario(files)
        if scenario.world_hash != shape["world_hash"]:
            raise InputError(f"{self.path}: its policy is of another scenario than scenario.yaml")
        world = World(scenario)
        network: ActorCritic = make_network(world.observer, world.action_sizes, scenario.training)
        path = self.path / "policy.safetensors"
        with readable(path):
            weights = _renamed(safetensors.torch.load(files[path.name]))
        check_like(path, weights, network.state_dict())
        network.load_state_dict(weights)
        network.to(device).eval()
        return TrainedPolicy(
            network,
            str(self.path),
            use_mask=shape["mask_actions"],
            num_auvs=world.num_auvs,
            observation=scenario.observation.model_dump(),
        )

    def _files(self) -> dict[str, bytes]:
        return saving.read_save(self.path)

    def _scenario(self, files: dict[str, bytes]) -> Scenario:
        if "scenario.yaml" in files:
            self._check_parts(files)
            return parse_scenario(self.path / "scenario.yaml", files["scenario.yaml"])
        if not files and saving.begun(self.path / saving.MANIFEST).exists():
            raise InputError(f"{self.path}: nothing has been saved in it yet; start anew by --out")
        raise InputError(f"{self.path}: holds no run: there is no scenario.yaml in it")

    def _check_parts(self, files: dict[str, bytes]) -> None:
        """See that the parts from outside with which it was trained are there.

        Raises:
            InputError: one is missing, or of another version.
        """
        if b'"parts"' not in files.get("policy.json", b""):
            return
        path = self.path / "policy.json"
        with readable(path):
            parts = parse_json(files["policy.json"].decode()).get("parts")
            stated = [(p["role"], p["kind"], p["version"], str(p["import"])) for p in parts]
            known = [registry_of(role) for role, *_ in stated]
        load_entry_points()
        for registry, (role, kind, version, source) in zip(known, stated, strict=True):
            what = f"{self.path}: was trained with {role} {kind!r} of version {version!r}"
            if kind not in registry:
                name = source if source != "__main__" else "the file that registers it"
                raise InputError(f"{what}, which is not registered: give --import {name}")
            if (own := registry[kind].version) != version:
                raise InputError(f"{what}; the one registered here is of version {own!r}")

    def _shape(self, files: dict[str, bytes]) -> dict[str, Any]:
        path = self.path / "policy.json"
        if not {"policy.json", "policy.safetensors"} <= set(files):
            raise InputError(f"{self.path}: holds no trained policy")
        with readable(path):
            shape: dict[str, Any] = parse_json(files["policy.json"].decode())
        _check_version(path, shape)
        for key, kind in _SHAPE.items():
            if not isinstance(shape.get(key), kind):
                raise InputError(f"{path}: cannot be read: lacks {key!r}, or it is no {kind}")
        return shape


def is_of_a_run(name: str) -> bool:
    """Whether a file of this name in a run's folder is the run's."""
    own = (*saving.NAMES, saving.MANIFEST, *LOGS, LOCK_NAME)
    return any(fnmatchcase(name, pattern) for pattern in own)


def _renamed(saved: dict[str, Any]) -> dict[str, Any]:
    """By the names of today, whichever version has saved it."""
    return {_RENAMED.get(name, name): value for name, value in saved.items()}


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turns what loaders raise on damaged files into one line."""
    try:
        yield
    except pickle.UnpicklingError:
        raise InputError(
            f"{path}: refused: damaged, or it holds Python objects, which could run any code"
        ) from None
    except MemoryError:
        raise InputError(f"{path}: cannot be read: not enough memory") from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {reason(error)}") from None
    except Exception as error:
        # What a loader raises on a damaged file depends on where the damage lies.
        why = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be read: {why}") from None


def _check_version(path: Path, saved: Any) -> None:
    versions = (FORMAT, WORLD_VERSION)
    found = None
    if isinstance(saved, dict):
        given = (saved.get("format"), saved.get("world_version"))
        # A tensor, say, has an equality of its own.
        found = tuple(each if type(each) is int else None for each in given)
    if found != versions:
        raise InputError(
            f"{path}: is of another version of this software: format and world version "
            f"{found}, not {versions}"
        )
