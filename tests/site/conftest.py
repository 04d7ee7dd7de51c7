"""The site, built once for all tests of a run, whichever processes they are in."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from filelock import FileLock

ROOT = Path(__file__).parents[2]
SITE_TIMEOUT_S = 240
#: The command, but notebooks train for two iterations.
BUILD = """
import iout_marl
from mkdocs.__main__ import cli

train = iout_marl.train


def train_shortly(*what, overrides=None, **options):
    return train(*what, overrides={**(overrides or {}), "training.steps": 40_960}, **options)


iout_marl.train = train_shortly
cli()
"""


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """The folder of the site, built strictly: a warning is a failure."""
    pytest.importorskip("mkdocs")
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder, log = shared / "site", shared / "site.log"
    with FileLock(shared / "site.lock"):
        if not log.exists():
            log.write_text(built(folder), encoding="utf-8")
    said = log.read_text(encoding="utf-8")
    assert not said, said
    return folder


def built(folder):
    """Build the site into a folder; what was wrong, empty for nothing."""
    command = [sys.executable, "-c", BUILD, "build", "--strict", "--site-dir", folder]
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1", "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        timeout=SITE_TIMEOUT_S,
        check=False,
    )
    lines = [line for line in done.stderr.splitlines() if not line.startswith("INFO")]
    return "\n".join([*lines, f"exit status {done.returncode}"] if done.returncode or lines else [])
