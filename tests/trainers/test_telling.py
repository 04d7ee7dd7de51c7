"""What a training says of its figures, and of how far it goes."""

import dataclasses
import io
import tempfile
from types import SimpleNamespace

import numpy as np
import pytest
from rich.console import Console
from tiny_study import with_training

from iout_marl import InputError
from iout_marl.study.worker import run_cell
from trainers import train, training_run


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ages", "is_noted"),
    [([9.0] * 4, True), ([0.5] * 4, True), ([2.1] * 4, False), ([1.0, 9.0, 1.0, 9.0], False)],
    ids=["worse", "better", "alike", "within the interval"],
)
@pytest.mark.parametrize("replicas", [1, 3])
def test_sampled_and_most_probable_actions_that_differ_much(
    iout, tiny_settings, tmp_path, monkeypatch, ages, is_noted, replicas
):
    evaluate = training_run.evaluate

    def evaluate_to_ages(*args, **options):
        found = evaluate(*args, **options)
        return dataclasses.replace(found, samples={**found.samples, "mean_aoi": np.array(ages)})

    monkeypatch.setattr(training_run, "evaluate", evaluate_to_ages)
    run = tmp_path / "a run"
    words = ["train", "best/k3-fdd", *tiny_settings, "--out", run, "--replicas", replicas]
    status, out, err = iout(*words)
    assert status == 0
    assert "evaluation by most probable actions" in out
    assert "sampled AoI " in err
    notes = [line for line in out.splitlines() if line.startswith("note: ")]
    assert len(notes) == (min(replicas, 2) if is_noted else 0)
    if is_noted:
        assert f"iout evaluate best/k3-fdd --policy '{run}" in notes[0]
        assert "--sampled --set" in notes[0]


@pytest.mark.parametrize(("steps", "trained"), [(5, 80), (81, 160), (80, None)])
def test_steps_are_rounded_up_to_whole_rollouts(tiny, tmp_path, steps, trained):
    said = io.StringIO()
    outcome = train(
        tiny({"training.steps": steps}),
        tmp_path,
        console=Console(file=said, width=20),
        evaluation_episodes=1,
    )
    assert outcome.trainer.env_steps == (trained or steps)
    line = f"training.steps {steps}: {trained} are trained, whole rollouts of 80 steps\n"
    assert (line in said.getvalue()) == (trained is not None)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"learning_rate": 1e30}, "training diverged after 80 environment steps"),
        ({"hidden_units": (10**6, 10**6)}, "not enough memory"),
    ],
    ids=["diverged", "memory"],
)
def test_study_names_no_folder_that_is_gone(tiny, changes, expected):
    scenario = with_training(tiny(), **changes)
    cell = SimpleNamespace(scenario=scenario, seed=0, episodes=1, trains=True, imports=())
    with pytest.raises(InputError) as raised:
        run_cell(cell, 0.0)
    message = str(raised.value)
    assert message.startswith(expected)
    assert tempfile.gettempdir() not in message
    assert "checkpoint" not in message
