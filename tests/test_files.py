"""Files that belong together: what is left of them when writing fails, or is interrupted."""

import errno
import os
from pathlib import Path

import pytest

from iout_marl import InputError
from iout_marl.files import part_path, write_together


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def fail_at(monkeypatch, owner, name, number, error, *, afterwards=False):
    """Let a function fail when it is called for the `number`th time, before or after it acts."""
    real, calls = getattr(owner, name), []

    def failing(*args):
        calls.append(args)
        if len(calls) == number and not afterwards:
            raise error
        result = real(*args)
        if len(calls) == number:
            raise error
        return result

    monkeypatch.setattr(owner, name, failing)


FULL = OSError(errno.ENOSPC, "No space left on device")
ERRORS = {"full": FULL, "interrupted": KeyboardInterrupt()}


@pytest.mark.parametrize("error", ERRORS.values(), ids=ERRORS)
@pytest.mark.parametrize("moment", [None, "c"], ids=["all", "one-decides"])
@pytest.mark.parametrize(
    ("owner", "name", "number"), [(os, "fsync", 2), (Path, "replace", 1)], ids=["write", "replace"]
)
def test_nothing_is_left_of_files_of_which_none_took_its_place(
    tmp_path, monkeypatch, owner, name, number, moment, error
):
    (tmp_path / "a").write_bytes(b"old")
    fail_at(monkeypatch, owner, name, number, error)
    files = {tmp_path / each: b"new" for each in "abc"}
    with pytest.raises((InputError, KeyboardInterrupt)):
        write_together(files, moment=moment and tmp_path / moment)
    assert contents(tmp_path) == {"a": b"old"}


@pytest.mark.parametrize("error", ERRORS.values(), ids=ERRORS)
def test_new_files_are_all_there_or_none(tmp_path, monkeypatch, error):
    fail_at(monkeypatch, Path, "replace", 2, error)
    with pytest.raises((InputError, KeyboardInterrupt)):
        write_together({tmp_path / each: b"new" for each in "abc"})
    assert contents(tmp_path) == {}


def test_of_several_replaced_the_first_may_be_new(tmp_path, monkeypatch):
    for each in "abc":
        (tmp_path / each).write_bytes(b"old")
    fail_at(monkeypatch, Path, "replace", 2, FULL)
    with pytest.raises(InputError, match=r"b: cannot be written: No space .*; the one before is"):
        write_together({tmp_path / each: b"new" for each in "abc"})
    assert contents(tmp_path) == {"a": b"new", "b": b"old", "c": b"old"}


def test_once_the_file_that_decides_is_in_its_place_the_others_wait(tmp_path, monkeypatch):
    fail_at(monkeypatch, Path, "replace", 1, KeyboardInterrupt(), afterwards=True)
    files = {tmp_path / each: each.encode() for each in "abc"}
    with pytest.raises(KeyboardInterrupt):
        write_together(files, moment=tmp_path / "c")
    assert contents(tmp_path) == {"a.part": b"a", "b.part": b"b", "c": b"c"}
    assert part_path(tmp_path / "a").name == "a.part"
