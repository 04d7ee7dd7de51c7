"""Files that other tools read: they can be read, and name what is there."""

import re
import tomllib
from pathlib import Path

import pytest
from ruamel.yaml import YAML

import iout_marl

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


def test_versions_are_the_same_wherever_they_are_named():
    (torch,) = re.findall(r"^torch==(\S+)$", text_of("constraints.txt"), flags=re.MULTILINE)
    for name in ("Makefile", "Dockerfile", "RELEASING.md", "docs/get-started.md"):
        assert set(re.findall(r"torch==([\d.]+\d)", text_of(name))) == {torch}, name
    assert f"\nversion: {iout_marl.__version__}\n" in text_of("CITATION.cff")


def test_the_container_gets_what_an_installation_needs():
    """All that the wheel is built of, and what `pyproject.toml` names, passes `.dockerignore`."""
    kept = {line[1:] for line in text_of(".dockerignore").splitlines() if line.startswith("!")}
    project = tomllib.loads(text_of("pyproject.toml"))
    wheel = project["tool"]["hatch"]["build"]["targets"]["wheel"]["only-include"]
    needed = {*wheel, *project["project"]["license-files"], project["project"]["readme"]}
    assert {*needed, "constraints.txt", "pyproject.toml"} <= kept
    assert all((ROOT / name).exists() for name in kept)


def test_the_container_runs_as_nobody_in_particular():
    lines = text_of("Dockerfile").splitlines()
    users = [line.split()[1] for line in lines if line.startswith("USER ")]
    assert int(users[-1]) > 0
    assert lines.index(f"USER {users[-1]}") < lines.index('ENTRYPOINT ["iout"]')


def text_of(name):
    return (ROOT / name).read_text(encoding="utf-8")
