"""A run on disk: scenario, policy, checkpoint, logs, result.

| file | holds |
|---|---|
| `scenario.yaml` | the scenario, resolved |
| `policy.safetensors`, `policy.json` | the networks' weights, and their shape |
| `checkpoint.pt` | all that training goes on from |
| `metrics.jsonl` | a line for every iteration |
| `events.out.tfevents.*` | the same for TensorBoard |
| `result.json` | the final policy's evaluation |
"""

from __future__ import annotations

import io
import json
import pickle
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import safetensors
import safetensors.torch
import torch

from iout_marl.errors import InputError
from iout_marl.files import write_atomically
from iout_marl.scenario import Scenario, load_scenario, to_yaml
from iout_marl.world import WORLD_VERSION, World
from trainers.factory import make_network
from trainers.networks import ActorCritic
from trainers.ppo import Trainer
from trainers.trained import TrainedPolicy

#: Changes whenever older files can no longer be read.
FORMAT = 2
#: Files that a new run must not replace; logs without them are of a run that never saved.
RESULTS = ("checkpoint.pt", "policy.safetensors", "policy.json", "result.json")


@dataclass(frozen=True)
class RunFolder:
    """The folder of a run."""

    path: Path

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
        try:
            used = any((self.path / name).exists() for name in RESULTS)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be read: {error.strerror}") from None
        if used:
            raise InputError(
                f"{self.path}: holds a run already; go on with it by --resume {self.path}, "
                "or name another folder by --out"
            )

    def create(self, scenario: Scenario) -> None:
        """Make the folder for a new run; what `refuse_if_used` finds would be written over.

        Raises:
            InputError: it cannot be made.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            for leftover in (self.metrics_path, *self.path.glob("events.out.tfevents.*")):
                leftover.unlink(missing_ok=True)
        except OSError as error:
            raise InputError(f"{self.path}: cannot be made: {error.strerror}") from None
        self.write_scenario(scenario)

    def write_scenario(self, scenario: Scenario) -> None:
        """Write down which scenario the run is of."""
        self.write_text("scenario.yaml", to_yaml(scenario))

    def write_text(self, name: str, text: str) -> None:
        """Write one of the folder's files atomically."""
        write_atomically(self.path / name, text.encode())

    def scenario(self) -> Scenario:
        """The run's scenario.

        Raises:
            InputError: the folder holds no run.
        """
        path = self.path / "scenario.yaml"
        if not path.is_file():
            raise InputError(f"{self.path}: holds no run: there is no scenario.yaml in it")
        return load_scenario(path.resolve())

    def saved_files(
        self, trainer: Trainer, state: dict[str, Any], source: Scenario, policy: int = 0
    ) -> dict[Path, bytes]:
        """What there is to save, checkpoint and policy, by path.

        Args:
            trainer: what to save.
            state: its `state_dict` of the policy.
            source: the scenario before its layout was pinned.
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
        world = trainer.simulation.world
        shape = {
            "format": FORMAT,
            "world_version": WORLD_VERSION,
            "scenario": scenario.name,
            "scenario_hash": scenario.hash,
            "world_hash": scenario.world_hash,
            "source_world_hash": source.world_hash,
            "env_steps": trainer.env_steps,
            "num_auvs": world.num_auvs,
            "observation_entries": len(world.observer.agent_ranges.low),
            "action_sizes": list(world.action_sizes),
            "hidden_units": list(trainer.settings.hidden_units),
            "activation": trainer.settings.activation,
            "mask_actions": trainer.settings.mask_actions,
        }
        return {
            self.checkpoint_path: buffer.getvalue(),
            self.path / "policy.safetensors": safetensors.torch.save(weights),
            self.path / "policy.json": (json.dumps(shape, indent=2) + "\n").encode(),
        }

    def load_checkpoint(self, device: torch.device) -> dict[str, Any]:
        """The trainer's `state_dict` from the checkpoint.

        Raises:
            InputError: there is none, it is damaged, of another version, or holds objects
                other than tensors and plain values.
        """
        path = self.checkpoint_path
        if not path.is_file():
            raise InputError(f"{self.path}: holds no checkpoint")
        with readable(path):
            saved = torch.load(path, map_location=device, weights_only=True)
        _check_version(path, saved)
        if saved.get("world_hash") != self.scenario().world_hash:
            raise InputError(f"{path}: is of another scenario than scenario.yaml beside it")
        with readable(path):
            trainer: dict[str, Any] = saved["trainer"]
            # Streams live on the CPU whatever device they are for.
            simulation = trainer["simulation"]
            simulation["generator"] = simulation["generator"].cpu()
        return trainer

    def policy_shape(self) -> dict[str, Any]:
        """What `policy.json` says.

        Raises:
            InputError: there is no policy, or it is of another version.
        """
        path = self.path / "policy.json"
        if not path.is_file() or not (self.path / "policy.safetensors").is_file():
            raise InputError(f"{self.path}: holds no trained policy")
        with readable(path):
            shape: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        _check_version(path, shape)
        lacking = {"world_hash", "source_world_hash", "mask_actions"} - set(shape)
        if lacking:
            raise InputError(f"{path}: cannot be read: lacks {min(lacking)!r}")
        return shape

    def load_policy(self, device: str | torch.device = "cpu") -> TrainedPolicy:
        """The trained policy.

        Raises:
            InputError: there is none, it is damaged, or of another version.
        """
        shape = self.policy_shape()
        scenario = self.scenario()
        if scenario.world_hash != shape["world_hash"]:
            raise InputError(f"{self.path}: its policy is of another scenario than scenario.yaml")
        world = World(scenario)
        network: ActorCritic = make_network(world.observer, world.action_sizes, scenario.training)
        path = self.path / "policy.safetensors"
        with readable(path):
            network.load_state_dict(safetensors.torch.load_file(path))
        network.to(device).eval()
        return TrainedPolicy(network, name=str(self.path), use_mask=shape["mask_actions"])


@contextmanager
def readable(path: Path) -> Iterator[None]:
    """Turns what loaders raise on damaged files into one line."""
    try:
        yield
    except pickle.UnpicklingError:
        raise InputError(
            f"{path}: refused: damaged, or it holds Python objects, which could run any code"
        ) from None
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except Exception as error:
        # What a loader raises on a damaged file depends on where the damage lies.
        reason = (str(error).strip() or type(error).__name__).splitlines()[0]
        raise InputError(f"{path}: cannot be read: {reason}") from None


def _check_version(path: Path, saved: Any) -> None:
    versions = (FORMAT, WORLD_VERSION)
    found = (saved.get("format"), saved.get("world_version")) if isinstance(saved, dict) else None
    if found != versions:
        raise InputError(
            f"{path}: is of another version of this software: format and world version "
            f"{found}, not {versions}"
        )
