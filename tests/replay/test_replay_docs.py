"""What docs/replay.md says is so: its code runs, and every reason has its row."""

import re
from pathlib import Path

import pytest

from iout_marl.core import reasons

PAGE = (Path(__file__).parents[2] / "docs" / "replay.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"^```python\n(.*?)^```", PAGE, flags=re.MULTILINE | re.DOTALL)


@pytest.mark.parametrize("snippet", SNIPPETS, ids=["recording", "own-loop"])
def test_its_code_runs(snippet, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(snippet, "docs/replay.md", "exec"), {})
    assert (tmp_path / "episode.json").exists()


def test_every_reason_has_its_row():
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*?) \|$", PAGE, flags=re.MULTILINE))
    found = [each for each in vars(reasons).values() if isinstance(each, reasons.Reason)]
    assert rows == {reason.code: reason.text for reason in found}
