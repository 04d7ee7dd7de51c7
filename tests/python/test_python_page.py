"""What the pages say of Python is so: names, code, and what is imported when."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

import iout_marl

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "python.md").read_text(encoding="utf-8")
#: The code of every page that a program could copy, by page and number.
SNIPPETS = {
    f"{name}-{index}": code
    for name in ("README", "docs/evaluate", "docs/get-started", "docs/python")
    for index, code in enumerate(
        re.findall(
            r"^```python\n(.*?)^```",
            (ROOT / f"{name}.md").read_text(encoding="utf-8"),
            flags=re.MULTILINE | re.DOTALL,
        )
    )
}


def test_every_public_name_stands_in_the_page():
    assert set(iout_marl.__all__) <= set(dir(iout_marl))
    for name in iout_marl.__all__:
        assert getattr(iout_marl, name) is not None
        assert re.search(rf"`[\w.]*\b{name}\b", PAGE), name


def test_a_name_that_is_none():
    with pytest.raises(AttributeError, match=r"module 'iout_marl' has no attribute 'trian'"):
        iout_marl.trian  # noqa: B018


@pytest.mark.slow
@pytest.mark.parametrize("name", SNIPPETS)
def test_code_of_the_pages_runs(name, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    exec(compile(SNIPPETS[name], name, "exec"), {})


@pytest.mark.slow
def test_torch_is_imported_only_where_something_is_trained():
    code = (
        "import sys, iout_marl as i\n"
        "assert 'train' in dir(i)\n"
        "i.evaluate('paper/k3-fdd', 'greedy', 1), i.record_episode('paper/k3-fdd', 'tour')\n"
        "i.load_policy('greedy'), i.bound, i.World('paper/k3-fdd').reset(seed=0)\n"
        "assert 'torch' not in sys.modules and 'trainers.ppo' not in sys.modules\n"
        "i.train\n"
        "assert 'torch' in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
