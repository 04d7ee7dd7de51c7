"""Files that other tools read: they can be read, and name what is there."""

from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
FILES = [ROOT / ".pre-commit-config.yaml", *sorted((ROOT / ".github").rglob("*.yml"))]
IDS = [path.relative_to(ROOT).as_posix() for path in FILES]


@pytest.fixture(params=FILES, ids=IDS)
def contents(request):
    return YAML(typ="safe").load(request.param.read_text(encoding="utf-8"))


def test_can_be_read(contents):
    assert isinstance(contents, dict)
    assert contents


def test_forms_of_issues_ask_for_something():
    forms = [path for path in FILES if path.parent.name == "ISSUE_TEMPLATE"]
    for path in forms:
        contents = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
        if path.name == "config.yml":
            continue
        assert {"name", "description", "body"} <= set(contents)
        ids = [field["id"] for field in contents["body"]]
        assert len(ids) == len(set(ids))
        assert all(field["attributes"]["label"] for field in contents["body"])


def test_hooks_run_what_the_makefile_runs():
    (repository,) = YAML(typ="safe").load(FILES[0].read_text(encoding="utf-8"))["repos"]
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for hook in repository["hooks"]:
        tool = hook["entry"].split()[0].removeprefix(".venv/bin/")
        assert f"$(BIN)/{tool}" in makefile
