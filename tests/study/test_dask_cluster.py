"""The same study on a real Dask cluster: a scheduler and two workers on loopback."""

import json
import signal
import socket
import sys
import threading
import warnings
from contextlib import contextmanager, suppress
from http.server import HTTPServer, SimpleHTTPRequestHandler

import forked
import pytest
from tiny_cluster import Cluster
from tiny_study import PATIENCE_S, STUDY, SameProcess, let_last, wait_for, write_study

from iout_marl import InputError
from iout_marl.study import cluster as on_dask
from iout_marl.study import expand, load_study
from iout_marl.study.cluster import DaskCluster, LostClusterError


@pytest.fixture
def cluster(tmp_path):
    """A scheduler and two workers."""
    (tmp_path / "dask").mkdir()
    with Cluster(tmp_path / "dask", forks=True) as running:
        yield running


@pytest.fixture
def study(tmp_path):
    trained = {**STUDY["groups"]["trained"], "seeds": [0, 1, 2]}
    trained["settings"] = {**trained["settings"], "training.steps": 1_200}
    return write_study(
        tmp_path / "study.yaml", groups={**STUDY["groups"], "trained": trained}, quick={}
    )


@pytest.fixture
def start(study, tmp_path):
    """Starts `iout reproduce` on the study."""

    def starter(*words):
        words = ("reproduce", "--study", study, "--out", tmp_path / "out", *words)
        return forked.Iout(words, forks=True)

    return starter


def trained_cells(tmp_path):
    return sorted((tmp_path / "out" / "cells").glob("*-ppo-*.json"))


@pytest.mark.slow
@pytest.mark.posix
def test_a_study_survives_the_loss_of_a_worker(cluster, start, tmp_path):
    running = start("--scheduler", cluster.address)
    wait_for(lambda: trained_cells(tmp_path) or running.poll() is not None)
    cluster.workers[0].kill()
    _, told = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 0, told
    assert "2 workers of the cluster" in told or "1 worker of the cluster" in told
    out = tmp_path / "out"
    results = json.loads((out / "results.json").read_text())
    assert len(results["cells"]) == 8
    assert results["failures"] == []
    assert len(list((out / "runs").iterdir())) == 6
    assert all((run / "policy.safetensors").stat().st_size for run in (out / "runs").iterdir())


@pytest.mark.slow
@pytest.mark.posix
def test_a_study_that_loses_its_scheduler_says_how_to_go_on_and_does(cluster, start, tmp_path):
    running = start("--scheduler", cluster.address)
    wait_for(lambda: trained_cells(tmp_path) or running.poll() is not None)
    cluster.scheduler.kill()
    _, told = running.communicate(timeout=PATIENCE_S)
    kept = trained_cells(tmp_path)
    assert running.returncode == 2
    assert kept
    assert "Traceback" not in told
    line = told.splitlines()[-1]
    assert line.startswith(f"iout: --scheduler {cluster.address}: the scheduler has gone; ")
    assert f"what is finished stays. Continue with: iout reproduce --study {tmp_path}" in line
    assert [li for li in told.splitlines() if "AoI" not in li and "cells on" not in li] == [line]
    before = {path: path.stat().st_mtime_ns for path in kept}
    again = start("--jobs", "2")
    _, told = again.communicate(timeout=PATIENCE_S)
    assert again.returncode == 0, told
    assert before == {path: path.stat().st_mtime_ns for path in kept}


@pytest.mark.slow
@pytest.mark.posix
def test_a_study_on_a_cluster_is_stopped_like_any_other(cluster, start, study, tmp_path):
    let_last(study)
    running = start("--scheduler", cluster.address)
    wait_for(lambda: trained_cells(tmp_path) or running.poll() is not None)
    running.send_signal(signal.SIGTERM)
    _, told = running.communicate(timeout=PATIENCE_S)
    assert running.returncode == 128 + signal.SIGTERM, told
    assert f"Continue with: iout reproduce --study {tmp_path}" in told
    assert f"--scheduler {cluster.address}" in told
    assert "Traceback" not in told


@pytest.mark.slow
def test_a_cluster_without_workers_is_waited_for(tmp_path):
    with Cluster(tmp_path, workers=0, forks=True) as empty:
        pool = DaskCluster(empty.address)
        assert pool.describe() == (
            f"0 workers of the cluster: waiting for the first (dask worker {empty.address})"
        )
        cells = expand(*load_study(write_study(tmp_path / "s.yaml")))[:1]
        outcomes = pool.run(cells, 475.0)
        empty.add_worker()
        ((cell, output),) = outcomes
        ((_, expected),) = SameProcess().run(cells, 475.0)
        assert cell == cells[0]
        assert output.record.samples == expected.record.samples
        empty.scheduler.kill()
        with pytest.raises(LostClusterError, match="the scheduler has gone"):
            list(pool.run(cells, 475.0))


@contextmanager
def listening(answer):
    """The address of something that accepts connections, and answers each by `answer`."""
    kept = []
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            with suppress(OSError):
                while True:
                    kept.append(server.accept()[0])
                    answer(kept[-1])

        threading.Thread(target=serve, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.getsockname()[1]}"
    for connection in kept:
        connection.close()


STRANGERS = {
    "says nothing": lambda connection: None,
    "closes": lambda connection: connection.close(),
    "another protocol": lambda connection: connection.sendall(b"SSH-2.0-OpenSSH_9.6\r\n" * 9),
    "a huge message": lambda connection: connection.sendall((2**62).to_bytes(8, "little") * 4),
    "zeros": lambda connection: connection.sendall(bytes(64)),
}


@pytest.mark.slow
@pytest.mark.parametrize("answer", STRANGERS.values(), ids=STRANGERS)
def test_what_only_listens_is_no_scheduler(monkeypatch, answer):
    monkeypatch.setattr(on_dask, "CONNECT_S", 1)
    with (
        listening(answer) as address,
        pytest.raises(InputError, match=rf"--scheduler {address}: no scheduler answers: \S") as e,
    ):
        DaskCluster(address)
    assert str(e.value).isprintable()


@pytest.mark.slow
def test_the_port_of_a_web_page_is_no_schedulers(monkeypatch):
    monkeypatch.setattr(on_dask, "CONNECT_S", 1)

    class Quiet(SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    with HTTPServer(("127.0.0.1", 0), Quiet) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.server_port}"
        with pytest.raises(InputError, match="no scheduler answers: nothing that it understands"):
            DaskCluster(address)
        server.shutdown()


@pytest.mark.slow
def test_the_address_of_a_worker_is_told(cluster):
    log = cluster.folder / "cluster.log"
    start = "Start worker at: "
    lines = wait_for(lambda: [li for li in log.read_text().splitlines() if start in li])
    with pytest.raises(InputError, match="is the address of a Worker, not of a scheduler"):
        DaskCluster(lines[0].partition(start)[2].strip())


@pytest.mark.slow
@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "tls://127.0.0.1:9", "ucx://127.0.0.1:9", "foo://h:8"]
)
def test_an_address_without_a_scheduler_is_told(monkeypatch, address):
    monkeypatch.setattr(on_dask, "CONNECT_S", 1)
    with pytest.raises(InputError, match=f"--scheduler {address}: no scheduler answers: "):
        DaskCluster(address)


@pytest.mark.parametrize("address", ["foo", "", "tcp://host", "http://a/b:1", "a b:1"])
def test_an_address_that_is_none_is_told_at_once(address):
    with pytest.raises(InputError, match=r"must be an address such as tcp://127\.0\.0\.1:8786"):
        DaskCluster(address)


def test_without_dask_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match=r"pip install -e '\.\[cluster\]'"):
        DaskCluster("tcp://127.0.0.1:9")


@pytest.mark.slow
def test_packages_that_differ_are_named_in_the_line_and_not_in_a_table(tmp_path, monkeypatch):
    from distributed import client

    ours = client.version_module.get_versions
    changed = {"packages": {**ours()["packages"], "msgpack": "0.1", "python": "2.7"}}
    monkeypatch.setattr(client.version_module, "get_versions", lambda *_, **__: changed)
    with Cluster(tmp_path, workers=0, forks=True) as empty, warnings.catch_warnings():
        warnings.simplefilter("error")
        told = DaskCluster(empty.address).describe()
    assert told.endswith("(versions differ between its machines: msgpack, python)")


def test_what_a_worker_of_another_version_computes_does_not_count(tmp_path):
    cells = expand(*load_study(write_study(tmp_path / "s.yaml")))[:1]
    ((_, output),) = SameProcess().run(cells, 475.0)
    assert on_dask._same_software(output) is output
    output.record.machine["iout-marl"] = "0.0.9"
    told = on_dask._same_software(output)
    assert str(told).startswith("a worker has iout-marl 0.0.9, not ")
