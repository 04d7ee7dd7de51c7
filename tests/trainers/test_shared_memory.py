"""Processes that share memory have the same of one another, in the order of their ranks."""

import os
import signal
import sys
import time

import pytest
import torch

from iout_marl.errors import InputError
from trainers import started_group
from trainers.accel.group import LostProcessError

if sys.platform != "linux":
    pytest.skip("memory is shared by name on Linux", allow_module_level=True)

from trainers.accel import shared_memory
from trainers.accel.shared_memory import SharedMemoryGroup, needed_bytes


@pytest.fixture
def in_processes(tmp_path):
    """Runs a function of a group in forked processes; their exit statuses."""
    path = tmp_path / "memory"
    running = []

    def run(function, size=2):
        path.write_bytes(bytes(needed_bytes(size)))
        for rank in range(size):
            if (process := os.fork()) == 0:
                status = 1
                try:
                    # Not before all have their locks, as `of_one_machine` waits for them.
                    group = SharedMemoryGroup(rank, size, path.open("r+b"))
                    (tmp_path / str(rank)).touch()
                    while not all((tmp_path / str(i)).exists() for i in range(size)):
                        time.sleep(0.001)
                    status = int(function(group) or 0)
                finally:
                    os._exit(status)
            running.append(process)
        return [os.waitstatus_to_exitcode(os.waitpid(running.pop(0), 0)[1]) for _ in range(size)]

    yield run
    for process in running:
        os.kill(process, signal.SIGKILL)
        os.waitpid(process, 0)


@pytest.mark.slow
@pytest.mark.parametrize("size", [2, 3])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64, torch.int64])
def test_sums_and_joins(in_processes, monkeypatch, size, dtype):
    monkeypatch.setattr(shared_memory, "CAPACITY", 64)  # some go in pieces

    def check(group):
        for count in (0, 1, 7, 16, 100):
            mine = torch.arange(count).to(dtype) * (group.rank + 1)
            expected = torch.arange(count).to(dtype) * sum(range(1, size + 1))
            total = mine.clone()
            assert group.sum(total) is total
            assert torch.equal(total, expected)
            joined = group.join(mine.reshape(-1, 1))
            parts = [torch.arange(count).to(dtype)[:, None] * (i + 1) for i in range(size)]
            assert torch.equal(joined, torch.cat(parts))
        strided = (torch.ones(6, 4, dtype=dtype) * group.rank).T
        assert torch.equal(group.sum(strided), torch.full((4, 6), sum(range(size)), dtype=dtype))
        assert group.sum(torch.tensor(1.5)).item() == 1.5 * size
        assert group.any(group.rank == size - 1)
        assert not group.any(False)
        assert group.largest(group.rank * 3) == 3 * (size - 1)

    assert in_processes(check, size) == [0] * size


@pytest.mark.slow
def test_thousands_of_exchanges_never_mix(in_processes):
    def check(group):
        for i in range(5_000):
            if i % 97 == group.rank:
                time.sleep(0.0001)
            assert group.sum(torch.full((50,), float(i + group.rank)))[-1] == 2 * i + 1

    assert in_processes(check) == [0, 0]


def test_process_that_is_gone_is_missed(in_processes, monkeypatch):
    monkeypatch.setattr(shared_memory, "_LOOKS", 10)

    def check(group):
        group.any(False)
        if group.rank == 0:
            os._exit(7)
        try:
            group.sum(torch.ones(3))
        except LostProcessError:
            return 3
        return 4

    assert in_processes(check) == [7, 3]


def test_what_a_process_hands_over_last_is_heard(in_processes, monkeypatch):
    monkeypatch.setattr(shared_memory, "_LOOKS", 0)

    def check(group):
        if group.rank == 1:
            time.sleep(0.05)
        return int(group.sum(torch.ones(1)).item() != 2)

    assert in_processes(check) == [0, 0]


@pytest.mark.slow
def test_patience_ends(in_processes, monkeypatch):
    monkeypatch.setattr(shared_memory, "_LOOKS", 10)
    monkeypatch.setattr(shared_memory, "TIMEOUT", shared_memory.TIMEOUT / 3000)

    def check(group):
        if group.rank == 0:
            time.sleep(1)
            return 0
        try:
            group.any(True)
        except LostProcessError:
            return 3
        return 4

    assert in_processes(check) == [0, 3]


@pytest.mark.parametrize("reason", ["machine", "folder", "full"])
def test_without_shared_memory_there_is_none(monkeypatch, tmp_path, reason):
    def full(*_):
        raise OSError

    monkeypatch.setattr(shared_memory, "MEMORY", tmp_path)
    assert shared_memory._new_file(2) is not None
    if reason == "machine":
        monkeypatch.setattr(shared_memory.platform, "machine", lambda: "aarch64")
    elif reason == "folder":
        monkeypatch.setattr(shared_memory, "MEMORY", tmp_path / "none")
    else:
        monkeypatch.setattr(shared_memory.os, "posix_fallocate", full)
    before = sorted(tmp_path.iterdir())
    assert shared_memory._new_file(2) is None
    assert sorted(tmp_path.iterdir()) == before


def test_a_process_that_is_lost_while_the_group_is_made_is_told_of(monkeypatch, tmp_path):
    def broken(numbers):
        raise RuntimeError("[../third_party/gloo/pair.cc:534] Connection closed by peer")

    for name, does in {
        "is_torchelastic_launched": lambda: True,
        "init_process_group": lambda *args, **kwargs: None,
        "destroy_process_group": lambda: None,
        "get_rank": lambda: 0,
        "get_world_size": lambda: 2,
        "broadcast_object_list": lambda names: None,
        "all_reduce": broken,
    }.items():
        monkeypatch.setattr(torch.distributed, name, does)
    monkeypatch.setattr(shared_memory, "MEMORY", tmp_path)
    monkeypatch.setenv("WORLD_SIZE", "2")
    expected = "^torchrun: another process of the training was lost before it began$"
    with pytest.raises(InputError, match=expected), started_group(torch.device("cpu")):
        pass
    assert not list(tmp_path.iterdir())
