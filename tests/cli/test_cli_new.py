"""`iout new`: what it writes can be trained as it is, and so can each of its alternatives."""

import re
from typing import Annotated

import pytest
from pydantic import Field

from iout_marl import InputError, load_scenario, parts
from iout_marl.registry import registry_of
from iout_marl.scenario import Scenario, Training
from iout_marl.scenario.reference import keys, keys_of_kind
from iout_marl.scenario.starter import starter
from iout_marl.scenario.yaml_values import read_yaml

BASES = ["paper/k3-fdd", "best/k10-tdd", "multi/m3-k50-tdd", "multi/m2-k13-fdd", "random/k5-tdd"]
#: A line that is switched off; the `#` of a remark has a blank and a word behind it.
OFF = re.compile(r"^( *)#(?=\S|  )", re.MULTILINE)


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def text_of(base):
    return starter(load_scenario(base), base)


def load(text, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return load_scenario(path)


def blocks(text):
    """The sections of a starter, each with its alternatives: {name: lines}."""
    return {
        re.search(r"^(\w+):", block, re.MULTILINE)[1]: block for block in text.split("\n\n")[1:]
    }


def alternatives(text):
    """For every other kind of a section the starter with that kind alone: (section, kind, text)."""
    for name, block in blocks(text).items():
        for off in re.findall(rf"^#{name}:\n(?:#  .*\n?)*", block, re.MULTILINE):
            on = OFF.sub(r"\1", off)
            yield name, re.search(r"^  kind: (\w+)", on, re.MULTILINE)[1], text.replace(block, on)


def must_be_given(name, kind):
    """The keys of a kind that have no default."""
    (role,) = (key.part.role for key in keys(Scenario) if key.name == name)
    return {key.name for key in keys_of_kind(registry_of(role)[kind]) if key.default is ...}


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_a_starter_is_what_it_extends(base, tmp_path):
    assert load(text_of(base), tmp_path).hash == load_scenario(base).hash
    assert all(len(line) <= 100 for line in text_of(base).splitlines())


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_every_section_key_and_kind_stands_in_it(base):
    text, scenario = text_of(base), load_scenario(base)
    for key in keys(Scenario):
        if key.part:
            block = blocks(text)[key.name]
            kinds = set(re.findall(r"^#?  kind: (\w+)$", block, re.MULTILINE))
            assert kinds == set(registry_of(key.part.role).kinds)
            inner = keys_of_kind(getattr(scenario, key.name).entry)
        elif key.sections:
            block, inner = blocks(text)[key.name], keys(key.sections[0])
        else:
            continue
        for each in inner:
            assert re.search(rf"^  #?{each.name}:", block, re.MULTILINE), each.name
            if each.unit:
                assert f"[{each.unit}; " in " ".join(block.replace("# ", "").split()), each.name


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_other_kinds_can_be_switched_on(base, tmp_path):
    found = list(alternatives(text_of(base)))
    assert {"channel", "duplex", "reward", "observation"} <= {name for name, *_ in found}
    for name, kind, text in found:
        lacking = must_be_given(name, kind) - set(
            re.findall(r"^  (\w+):", blocks(text)[name], re.MULTILINE)
        )
        if lacking:  # they stand in remarks
            assert all(f"\n  # {key}: " in blocks(text)[name] for key in lacking)
            with pytest.raises(InputError, match=rf"{name}\.\w+: is missing"):
                load(text, tmp_path)
            continue
        scenario = load(text, tmp_path)
        assert getattr(scenario, name).kind == kind
        assert scenario.num_nodes == load_scenario(base).num_nodes


@pytest.mark.slow
@pytest.mark.parametrize("base", BASES)
def test_training_settings_can_be_switched_on(base, tmp_path):
    text = text_of(base)
    block = blocks(text)["training"]
    on = OFF.sub(r"\1", block)
    settings = read_yaml(on, "training")[0]["training"]
    assert set(settings) == set(Training.model_fields)
    assert load(text.replace(block, on), tmp_path).training == load_scenario(base).training


def test_it_is_written_and_trains(iout, tiny_settings, tmp_path):
    status, out, err = iout("new", "mine.yaml")
    assert (status, err) == (0, "")
    assert out == "mine.yaml: written; change what you like, then: iout train mine.yaml\n"
    assert load_scenario("mine").hash == load_scenario("paper/k10-fdd").hash
    changes = ["--set", "nodes.cells=[[1, 1, 1], [2, 2, 1]]", *tiny_settings]
    status, _, _ = iout("train", "mine.yaml", *changes, "--steps", 80, "--out", "run")
    assert status == 0
    assert load_scenario("run/scenario.yaml").name == "mine"


@pytest.mark.slow
def test_it_begins_with_any_scenario(iout, tmp_path):
    (tmp_path / "deep").mkdir()
    family = "extends: paper/k7-tdd\nmatrix: {axes: {age.maximum: [7, 9]}}"
    (tmp_path / "own.yaml").write_text(family)
    for source, target in (("own/9", "deep/a"), ("best/k5-tdd", "b.yml"), ("deep/a.yaml", "c")):
        assert iout("new", target, "--from", source)[0] == 0
        assert load_scenario(target).hash == load_scenario(source).hash
    assert "extends: ../own.yaml/9\n" in (tmp_path / "deep/a.yaml").read_text()
    assert "extends: best/k5-tdd\n" in (tmp_path / "b.yml").read_text()


def test_nothing_is_written_over(refused, iout, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("mine")
    (tmp_path / "link.yaml").symlink_to("nowhere")
    for name in ("mine.yaml", "mine", "link"):
        assert "is there already, and is not written over" in refused("new", name)
    assert path.read_text() == "mine"
    assert "did you mean 'paper/k3-fdd'" in refused("new", "a.yaml", "--from", "paper/k3-fd")
    assert "is a family, name one of its scenarios" in refused("new", "a.yaml", "--from", "paper")
    assert "none is no folder" in refused("new", "none/a.yaml")
    assert not (tmp_path / "a.yaml").exists()


def test_parts_from_outside_stand_in_it(tmp_path):
    @parts.rewards.register("of_the_test", version=1)
    class OfTheTest(parts.Reward):
        """Nothing at all."""

        class Settings(parts.Settings):
            #: How many of them.
            number: Annotated[parts.Count, Field(le=9)] = 2
            #: What nothing gives.
            needed: float

        def __call__(self, state, events):
            return {}

    try:
        text = text_of("paper/k3-fdd")
        assert "# Or instead of it (of_the_test) Nothing at all.\n#reward:\n" in text
    finally:
        parts.rewards.unregister("of_the_test")
