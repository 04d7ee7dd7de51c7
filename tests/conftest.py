"""Fixtures of all tests: one thread, a scenario that is small in every respect, `iout`."""

import gc
import os
import signal
import sys
from pathlib import Path

import forked
import pytest
import torch
from browsers import browser  # noqa: F401 (a fixture)
from tiny_study import TINY

from iout_marl import load_scenario, metrics, outside
from iout_marl.cli import main
from iout_marl.registry import registries
from iout_marl.report.registry import report_named
from iout_marl.study.pools import LocalProcesses

ROOT = Path(__file__).parents[1]
#: Before what is installed, in this process (see `pyproject.toml`) and in those that it starts.
STUBS = str(Path(__file__).parent / "stubs")


def pytest_configure():
    """Let processes that are started find the stubs, too, and buffer as Python usually does.

    What is collected stays: to look through it for garbage as it grows takes a quarter of the time.
    """
    gc.disable()
    paths = filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))
    os.environ["PYTHONPATH"] = os.pathsep.join(dict.fromkeys([STUBS, *paths]))
    # It would hide what becomes of text that streams hold back.
    os.environ.pop("PYTHONUNBUFFERED", None)


#: What is about shells, pseudo-terminals, forks and signals between processes from its first line.
OF_POSIX = [
    "cli/test_cli_streams.py",
    "study/test_killed.py",
    "test_campaigns.py",
    "trainers/test_group.py",
]
collect_ignore = OF_POSIX if os.name == "nt" else []
#: Where tests of a marker can run.
SYSTEMS = {"posix": os.name == "posix", "linux": sys.platform == "linux"}


def pytest_collection_finish():
    """Let the collector of garbage pass over what has been imported, and come less often."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


def pytest_report_header():
    """Name the files that are left out on this system."""
    return [f"left out, for Windows has no such signals and processes: {f}" for f in collect_ignore]


def pytest_collection_modifyitems(items):
    """Mark what opens a browser or needs the site, skip what this system lacks the means for."""
    for item in items:
        fixtures = getattr(item, "fixturenames", ())
        if "browser" in fixtures:
            item.add_marker(pytest.mark.browser)
        if "site" in fixtures:  # which takes a while to build
            item.add_marker(pytest.mark.slow)
        for name, is_here in SYSTEMS.items():
            if not is_here and item.get_closest_marker(name):
                item.add_marker(pytest.mark.skip(reason=f"needs what only {name} systems have"))


@pytest.fixture(scope="session", autouse=True)
def _one_thread():
    """Tests share the cores with one another, and sums keep their order."""
    torch.set_num_threads(1)


@pytest.fixture(scope="session", autouse=True)
def _workers_import_nothing():
    """Processes of studies that run here; those that `iout` starts itself begin anew."""
    if os.name == "posix":
        LocalProcesses.context = forked.context()


@pytest.fixture(scope="session", autouse=True)
def _ctrl_c_counts():
    """Shells let what they start in the background, and all its children, ignore Ctrl-C."""
    signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def tiny():
    """Makes the tiny scenario of a bundled one, with changes of the caller's."""

    def make(changes=(), scenario="best/k3-fdd"):
        return load_scenario(load_scenario(scenario, TINY), changes)

    return make


@pytest.fixture(scope="session")
def tiny_settings():
    """The tiny scenario as options of the command line."""
    return [word for key, value in TINY.items() for word in ("--set", f"{key}={value}")]


@pytest.fixture
def forgotten_metrics():
    """For a test that registers metrics: they are forgotten after it."""
    yield
    for metric in metrics.registered():
        if not metric.is_builtin:
            metrics.unregister(metric.name)


def is_of_a_user(module):
    """Whether a module is neither installed nor part of this project."""
    path = getattr(module, "__file__", None)
    homes = (sys.prefix, sys.base_prefix, *(ROOT / name for name in ("iout_marl", "trainers")))
    return path is not None and not any(Path(path).is_relative_to(home) for home in homes)


@pytest.fixture
def forgotten_parts(monkeypatch):
    """For a test that registers parts or imports them: they are forgotten after it."""
    monkeypatch.setattr(outside, "_brought", {})
    monkeypatch.setattr(sys, "path", list(sys.path))
    report_named("plain")  # registers those of this package, which are not forgotten
    kinds = {registry: set(registry.kinds) for registry in registries()}
    modules = set(sys.modules)
    yield
    for registry, known in kinds.items():
        for kind in set(registry.kinds) - known:
            registry.unregister(kind)
    for name in set(sys.modules) - modules:
        if is_of_a_user(sys.modules[name]):
            del sys.modules[name]


@pytest.fixture
def iout(capsys):
    """Runs a command line; returns exit status, standard output and standard error."""

    def run(*words):
        capsys.readouterr()
        with pytest.raises(SystemExit) as ended:
            main([str(word) for word in words])
        printed = capsys.readouterr()
        return ended.value.code or 0, printed.out, printed.err

    return run


@pytest.fixture
def refused(iout):
    """Runs a command line that must be refused; returns the line."""

    def run(*words):
        status, out, err = iout(*words)
        assert status == 2
        assert out == ""
        assert err.endswith("\n")
        assert err[:-1].isprintable(), "not one line"
        assert err.startswith("iout: ")
        return err[len("iout: ") : -1]

    return run
