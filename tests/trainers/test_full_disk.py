"""A disk that fills up leaves the last good files, and one line."""

import errno
import io
import os
from pathlib import Path

import forked
import pytest
from rich.console import Console

from iout_marl import InputError
from iout_marl.files import write_atomically
from trainers import train
from trainers.runs import saving

#: As on a disk with so many bytes left for each file: writes fail, no signal comes.
LIMITED = """
import resource, signal
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({size},) * 2)
"""


def full(*args, **kwargs):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def failing_open(path, mode="r", *args, **kwargs):
    if "w" in mode:
        full()
    return io.open(path, mode, *args, **kwargs)  # noqa: UP020 (Path.open is what is replaced)


class FailingFile(io.BytesIO):
    write = full


def failing_write(path, mode="r", *args, **kwargs):
    return FailingFile() if "w" in mode else io.open(path, mode, *args, **kwargs)  # noqa: UP020


FAILURES = {
    "open": (Path, "open", failing_open),
    "write": (Path, "open", failing_write),
    "fsync": (os, "fsync", full),
    "replace": (Path, "replace", full),
}


@pytest.fixture(params=FAILURES.values(), ids=list(FAILURES))
def fill_disk(request, monkeypatch):
    return lambda: monkeypatch.setattr(*request.param)


def test_file_written_before_stands(tmp_path, fill_disk, monkeypatch):
    path = tmp_path / "file"
    write_atomically(path, b"old")
    fill_disk()
    with pytest.raises(InputError) as raised:
        write_atomically(path, b"new")
    monkeypatch.undo()
    expected = f"{path}: cannot be written: No space left on device; the one before is kept"
    assert str(raised.value) == expected
    assert path.read_bytes() == b"old"
    assert list(tmp_path.iterdir()) == [path], "something half-written is left"


def test_first_file_leaves_nothing(tmp_path, fill_disk, monkeypatch):
    fill_disk()
    with pytest.raises(InputError, match=r"No space left on device$"):
        write_atomically(tmp_path / "file", b"new")
    monkeypatch.undo()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_checkpoint_saved_before_stands_and_training_goes_on_from_it(
    tmp_path, tiny, fill_disk, monkeypatch
):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 1}
    folder, save = tmp_path / "run", saving.save
    saved = []

    def save_twice(states, *group):
        if len(saved) == 1:
            fill_disk()
        save(states, *group)
        saved.append((folder / "checkpoint.pt").read_bytes())

    monkeypatch.setattr(saving, "save", save_twice)
    with pytest.raises(InputError, match=r"cannot be written: No space left.*; the one before"):
        train(tiny(), folder, **quiet)
    monkeypatch.undo()
    assert (folder / "checkpoint.pt").read_bytes() == saved[0]
    assert not list(folder.glob("*.part"))
    outcome = train(tiny(), folder, resume=True, **quiet)
    assert outcome.finished


def limited(size, *words):
    done = forked.run(*words, before=LIMITED.format(size=size))
    return done.returncode, done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "file"),
    [(1000, "run"), (10_000, "checkpoint.pt")],
    ids=["logs", "checkpoint"],
)
@pytest.mark.posix
def test_real_limit_stops_a_new_run_with_one_line(tmp_path, tiny_settings, size, file):
    words = ["train", "best/k3-fdd", *tiny_settings, "--out", tmp_path / "run"]
    status, err = limited(size, *words)
    assert status == 2
    (line,) = (line for line in err.splitlines() if "steps/s" not in line)
    assert line.startswith("iout: ")
    assert f"{file}: cannot be written: File too large" in line
    assert not (tmp_path / "run" / "checkpoint.pt").exists()
    assert not list((tmp_path / "run").glob("*.part"))


@pytest.mark.slow
@pytest.mark.posix
def test_real_limit_leaves_the_last_good_checkpoint(tmp_path, tiny_settings, iout):
    words = ["train", "best/k3-fdd", *tiny_settings]
    assert iout(*words, "--out", tmp_path / "run")[0] == 0
    before = (tmp_path / "run" / "checkpoint.pt").read_bytes()
    longer = [*words, "--steps", 720, "--resume", tmp_path / "run"]
    status, err = limited(len(before) - 1000, *longer)
    assert status == 2
    assert "checkpoint.pt: cannot be written: File too large; the one before is kept" in err
    assert "Traceback" not in err
    assert (tmp_path / "run" / "checkpoint.pt").read_bytes() == before
    assert iout(*longer)[0] == 0
