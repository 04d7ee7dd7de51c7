"""Runs one cell, wherever that is: in a process beside this one or far away."""

from __future__ import annotations

import datetime as dt
import functools
import tempfile
from dataclasses import dataclass
from pathlib import Path

from iout_marl.bounds import bound
from iout_marl.errors import InputError
from iout_marl.evaluation import evaluate
from iout_marl.files import LOCK_NAME, to_json
from iout_marl.outside import bring_in
from iout_marl.policies import Budget, PlannerPolicy
from iout_marl.policies.loading import named_policy
from iout_marl.scenario import Scenario, load_scenario
from iout_marl.study.cells import Cell
from iout_marl.study.emissions import measured
from iout_marl.study.records import CURVES, Record, TrainingRecord, rounded
from iout_marl.study.schema import BOUND
from iout_marl.trajectory import record_episode
from iout_marl.world import pin_layout

#: At how many points of a training its log goes into the report, at most.
CURVE_POINTS = 60
#: Files of a run's folder that only serve an unfinished training.
LEFT_OUT = ("checkpoint.pt", LOCK_NAME)


@dataclass(frozen=True)
class Output:
    """What comes back from a cell.

    Attributes:
        record: its figures.
        run: the files of the run's folder, of cells that train; a bound's certificate.
    """

    record: Record
    run: dict[str, bytes]


def run_cell(cell: Cell, carbon_g_per_kwh: float) -> Output:
    """Run a cell on one thread, and touch nothing but a temporary folder."""
    bring_in(*cell.imports)
    if cell.trains:
        return _train(cell, carbon_g_per_kwh)
    if cell.trained_in is not None:
        return _play_run(cell)
    scenario = pin_layout(cell.scenario, cell.seed)
    if cell.policy == BOUND:
        return _bound(cell, scenario)
    rounds = cell.planner_rounds
    policy = cell.policy if rounds is None else PlannerPolicy(Budget(rounds=rounds))
    search = "" if rounds is None else f"{rounds} rounds"
    played = evaluate(scenario, policy, cell.episodes, cell.seed)
    record = Record.from_cell(
        cell, played.samples, _today(), search=search, deterministic=played.deterministic
    )
    return Output(record, {})


def _play_run(cell: Cell) -> Output:
    """Play a run that was trained in another scenario."""
    with tempfile.TemporaryDirectory(prefix="iout-") as folder:
        run = Path(folder) / "run"
        run.mkdir()
        for name, data in cell.run.items():
            (run / name).write_bytes(data)
        try:
            scenario, policy = named_policy(cell.scenario, str(run), cell.seed, transfer=True)
        except (InputError, OSError) as error:
            raise InputError(_without_folder(error, run)) from None
        played = evaluate(scenario, policy, cell.episodes, cell.seed)
        episode = record_episode(scenario, policy).to_json()
    record = Record.from_cell(
        cell, played.samples, _today(), episode=episode, deterministic=played.deterministic
    )
    return Output(record, {})


def _bound(cell: Cell, scenario: Scenario) -> Output:
    assert cell.bound_seconds is not None
    found = bound(scenario, seconds=cell.bound_seconds)
    how = f"{found.certificate.kind}, {cell.bound_seconds:g} s"
    search = "; ".join(filter(None, [how, found.stated_by]))
    record = Record.from_cell(cell, {"mean_aoi": [found.best]}, _today(), search=search)
    return Output(record, {"bound.json": (to_json(found.to_json(), indent=2) + "\n").encode()})


def _train(cell: Cell, carbon_g_per_kwh: float) -> Output:
    import torch
    from rich.console import Console

    import trainers

    # As many cells as cores run side by side.
    torch.set_num_threads(1)
    _warm_up()
    with tempfile.TemporaryDirectory(prefix="iout-") as folder:
        run = Path(folder) / "run"
        try:
            outcome, emissions = measured(
                lambda: trainers.train(
                    cell.scenario,
                    run,
                    cell.seed,
                    console=Console(quiet=True),
                    evaluation_episodes=cell.episodes,
                    catch_signals=False,
                ),
                carbon_g_per_kwh,
            )
        except (InputError, OSError) as error:
            raise InputError(_without_folder(error, run)) from None
        assert outcome.evaluation is not None  # nothing stops it early
        training = TrainingRecord(
            settings=cell.scenario.training.model_dump(mode="json"),
            env_steps=outcome.trainer.env_steps,
            seconds=round(outcome.seconds, 3),
            curve=_curve(outcome.run.metrics_path),
            emissions=emissions,
        )
        episode = record_episode(outcome.trainer.scenario, outcome.run.load_policy()).to_json()
        record = Record.from_cell(
            cell,
            outcome.evaluation.samples,
            _today(),
            training,
            episode,
            deterministic=outcome.evaluation.deterministic,
        )
        files = [path for path in outcome.run.path.iterdir() if path.name not in LEFT_OUT]
        return Output(record, {path.name: path.read_bytes() for path in files})


def _without_folder(error: InputError | OSError, run: Path) -> str:
    """Why a training failed, without the folder that is cleared away, and what is in it."""
    reason = getattr(error, "reason", None) or str(error)
    for path in (f"{run}: ", f"{run}/", f"{run.parent}/"):
        reason = reason.replace(path, "")
    return reason


@functools.cache
def _warm_up() -> None:
    """What a process does only once must not count to the time of its first training."""
    import trainers

    little = {"environments": 2, "rollout_slots": 100, "minibatches": 1, "steps": 1}
    changes = {f"training.{key}": value for key, value in little.items()}
    trainers.Trainer(load_scenario("paper/k3-tdd", changes)).iterate()


def _curve(path: Path) -> dict[str, list[float]]:
    """The log of a training, thinned; rollouts in which no episode ended are left out."""
    from trainers.runs.metrics import read_rows

    names = ("env_steps", *CURVES)
    rows, _ = read_rows(path)
    rows = [row for row in rows if all(row.get(name) is not None for name in names)]
    every = -(-len(rows) // CURVE_POINTS) or 1
    kept = rows[every - 1 :: every]
    if rows and kept[-1:] != rows[-1:]:
        kept.append(rows[-1])
    return {name: rounded(row[name] for row in kept) for name in names}


def _today() -> str:
    return dt.datetime.now(dt.UTC).date().isoformat()
