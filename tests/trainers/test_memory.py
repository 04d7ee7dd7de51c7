"""Trainings that fit into no memory, and output that cannot be shown."""

import errno
import io
import os

import forked
import pytest
import torch
from rich.console import Console
from tiny_study import TINY, with_training

from iout_marl import InputError, load_scenario
from iout_marl.scenario import to_yaml
from trainers import RunFolder, Trainer, started_group, train
from trainers.memory import enough_memory

FULL = pytest.param("full", marks=pytest.mark.linux, id="full")
#: Settings that a scenario's file must not have, but that stand for too little memory anywhere.
HUGE = {
    "networks": {"hidden_units": (10**6, 10**6)},
    "networks of a size that no array has": {"hidden_units": (10**10, 10**10)},
    "rollouts": {"rollout_slots": 10**12},
}


@pytest.mark.slow
@pytest.mark.parametrize("changes", HUGE.values(), ids=list(HUGE))
def test_settings_that_need_too_much_memory(tiny, tmp_path, changes):
    scenario = with_training(tiny(), **changes)
    with pytest.raises(InputError, match="not enough memory: smaller training") as raised:
        train(scenario, tmp_path / "run", console=Console(file=io.StringIO()))
    assert str(raised.value).isprintable()
    with pytest.raises(InputError, match="not enough memory: smaller training"):
        Trainer(scenario).iterate()


def test_other_errors_go_through():
    for error in (RuntimeError("shapes differ"), ValueError("x"), InputError("y"), KeyError("z")):
        with pytest.raises(type(error)) as raised, enough_memory():
            raise error
        assert raised.value is error


class Broken(io.StringIO):
    """A terminal that has gone."""

    def write(self, text):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    flush = isatty = write


@pytest.mark.slow
@pytest.mark.parametrize("is_terminal", [False, True])
def test_terminal_that_has_gone_costs_no_training(tiny, tmp_path, is_terminal):
    console = Console(file=Broken(), force_terminal=is_terminal)
    scenario = tiny({"training.steps": 500, "name": "a[/b]"})
    assert train(scenario, tmp_path, console=console, evaluation_episodes=1).finished


@pytest.mark.slow
@pytest.mark.parametrize("gone", ["closed", FULL, "unread"])
@pytest.mark.posix
def test_standard_error_that_has_gone_costs_no_training(tmp_path, gone):
    source = tmp_path / "scenario.yaml"
    source.write_text(to_yaml(load_scenario(load_scenario("best/k3-fdd", TINY))))
    read, unread = os.pipe()
    os.close(read)
    error = {"closed": forked.CLOSED, "full": "/dev/full", "unread": unread}[gone]
    streams = (forked.PIPE, forked.PIPE, error)
    done = forked.run("train", source, "--out", tmp_path / "run", streams=streams)
    os.close(unread)
    assert done.returncode == 0
    assert (tmp_path / "run/result.json").exists()
    assert RunFolder(tmp_path / "run").load_policy()


def test_log_that_cannot_be_written_costs_no_weights(tiny, tmp_path, monkeypatch):
    from trainers import logs

    row = logs.row

    def fail_at_240(env_steps, log):
        if env_steps == 320:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return row(env_steps, log)

    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 1}
    monkeypatch.setattr(logs, "row", fail_at_240)
    expected = "run: cannot be written: No space left on device; last checkpoint: 320 steps"
    with pytest.raises(InputError, match=expected):
        train(tiny(), tmp_path / "run", **quiet)
    monkeypatch.undo()
    assert train(tiny(), tmp_path / "run", resume=True, **quiet).finished


@pytest.mark.parametrize("size", [None, "1"])
def test_what_torchrun_has_left_in_the_environment_starts_no_group(monkeypatch, size):
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "of before")
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    if size is not None:
        monkeypatch.setenv("WORLD_SIZE", size)
    with started_group(torch.device("cpu")) as (group, _):
        assert group.size == 1


@pytest.mark.parametrize(
    "variables",
    [{"WORLD_SIZE": "x"}, {"WORLD_SIZE": ""}, {"WORLD_SIZE": "-2"}, {"WORLD_SIZE": "2"},
     {"WORLD_SIZE": "2", "RANK": "x"}],
    ids=str,
)  # fmt: skip
def test_half_an_environment_of_torchrun(monkeypatch, variables):
    for name in ("RANK", "LOCAL_RANK", "MASTER_ADDR", "MASTER_PORT", "WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    for name, value in {"TORCHELASTIC_RUN_ID": "of before", **variables}.items():
        monkeypatch.setenv(name, value)
    with (
        pytest.raises(InputError, match="torchrun: ") as raised,
        started_group(torch.device("cpu")),
    ):
        pass
    assert str(raised.value).isprintable()
