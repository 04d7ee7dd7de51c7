"""Whether a run fits a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from iout_marl.errors import InputError
from iout_marl.scenario import Scenario
from trainers.runs.folder import RunFolder
from trainers.sizing import with_table


def differences(first: Scenario, second: Scenario) -> list[str]:
    """Dotted keys in which two scenarios differ, names and descriptions aside."""

    def flat(data: object, path: str) -> dict[str, object]:
        if not isinstance(data, dict):
            return {path: data}
        return {
            k: v
            for key, value in data.items()
            for k, v in flat(value, f"{path}.{key}" if path else key).items()
        }

    a, b = (flat(s.model_dump(exclude={"name", "description"}), "") for s in (first, second))
    return [key for key in {**a, **b} if a.get(key) != b.get(key)]


def _interface(scenario: Scenario) -> dict[str, tuple[Any, Any]]:
    """What says how many entries observations and actions have, and what they mean.

    By key: what must be the same, and what is shown where it is not.
    """
    seen, several = scenario.observation, scenario.num_auvs > 1
    motion, duplex = scenario.auvs.motion, scenario.duplex

    def same(value: Any) -> tuple[Any, Any]:
        return value, value

    return {
        "auvs.count": same(scenario.num_auvs),
        "nodes.count": same(scenario.num_nodes),
        "duplex.kind": (duplex.part.num_choices, duplex.kind),
        "auvs.idle_choices": same(scenario.auvs.idle_choices),
        "auvs.motion": (tuple(map(tuple, motion.part.steps)), motion.kind),
        "observation.kind": same(seen.kind),
        # Tables have no such settings.
        "observation.node_positions": same(getattr(seen, "node_positions", None)),
        "observation.time": same(getattr(seen, "time", None)),
        "observation.other_auvs": same(getattr(seen, "other_auvs", None) and several),
        "observation.agent_index": same(getattr(seen, "agent_index", None)),
        "observation.view_range_m": same("null" if seen.view_range_m is None else "a range"),
        "observation.entries": same([entry.model_dump() for entry in seen.entries]),
    }


def load_run(run: Path, scenario: Scenario, *, transfer: bool) -> tuple[RunFolder, Scenario]:
    """A run's folder, and the scenario to evaluate its policy on.

    Args:
        run: the folder.
        scenario: what the user asks for. Where its layout is drawn once for a run, the
            run's own layout is used.
        transfer: allow another world than that of the training, as long as observations
            and actions fit.

    Raises:
        InputError: no run, or one of another scenario.
    """
    folder = RunFolder(run)
    shape = folder.policy_shape()
    own = folder.scenario()
    if own.world_hash != shape["world_hash"]:
        raise InputError(f"{run}: its policy is of another scenario than scenario.yaml beside it")
    if scenario.world_hash in (shape["world_hash"], shape["source_world_hash"]):
        return folder, scenario.model_copy(update={"nodes": own.nodes})
    any_size = own.training.network.part.is_for_any_size
    if any_size:
        # It sees any scenario as the table that it was trained on.
        seen = with_table(scenario, own.observation.model_dump())
        if seen.world_hash in (shape["world_hash"], shape["source_world_hash"]):
            return folder, scenario.model_copy(update={"nodes": own.nodes})
    given = _interface(scenario)
    needed = _interface(own)
    if any_size:
        needed = {"duplex.kind": needed["duplex.kind"]}
    misfits = [
        f"{key} {shown}, not {given[key][1]}"
        for key, (value, shown) in needed.items()
        if value != given[key][0]
    ]
    if misfits:
        raise InputError(
            f"{run}: was trained on another scenario, {own.name}: its observations and actions "
            f"do not fit; it needs {'; '.join(misfits)}"
        )
    if not transfer:
        different = differences(own, scenario)
        where = next(k for k in different if not k.startswith(("reward.", "training.")))
        raise InputError(
            f"{run}: was trained on another scenario, {own.name}, whose {where} differs; "
            "--transfer evaluates it all the same"
        )
    return folder, scenario
