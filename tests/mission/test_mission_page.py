"""What docs/mission.md says is so: its commands run, and every format has its row."""

import re
import shlex
from pathlib import Path

import pytest

from iout_marl.mission import FORMATS

PAGE = (Path(__file__).parents[2] / "docs" / "mission.md").read_text(encoding="utf-8")
NODES = "lat,lon,depth\n41.18,-8.7,12\n41.1853,-8.6921,55.5\n41.1812,-8.6955,140\n"


@pytest.mark.slow
def test_its_commands_run(iout, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("nodes.csv").write_text(NODES)
    blocks = "".join(re.findall(r"^```console\n(.*?)^```", PAGE, re.MULTILINE | re.DOTALL))
    commands = [
        shlex.split(line, comments=True)
        for line in blocks.replace("\\\n", "").splitlines()
        if line.startswith("iout ")
    ]
    assert len(commands) == 7
    for _, *words in commands:
        status, _, err = iout(*words)
        assert status == 0, err
    shown = {word for words in commands for word in words}
    assert shown >= FORMATS.keys()


def test_every_format_has_its_row():
    rows = re.findall(r"^\| `([\w-]+)` \| `(.+?)` \| .* \| (.*) \| (.*) \|$", PAGE, re.MULTILINE)
    placed = {True: "yes", False: "–"}
    times = {True: "written", False: "from speeds"}
    assert [(n, s, "–" if p.startswith("where") else p, t) for n, s, p, t in rows] == [
        (f.name, f.suffix, placed[f.needs_origin], times[f.has_times]) for f in FORMATS.values()
    ]
