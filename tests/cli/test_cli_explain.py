"""`iout show --explain`: every key of a scenario, with value, meaning, unit and range."""

import json

import pytest

from iout_marl import load_scenario

SCENARIOS = ["paper/k3-fdd", "best/k10-tdd", "multi/m3-k10-fdd", "random/k5-tdd"]


def leaves(data, path=()):
    """Dotted keys with their values; a part that is a word is one, `kind` is the part's own."""
    for key, value in data.items():
        here = path if key == "kind" else (*path, key)
        if isinstance(value, dict):
            yield from leaves(value, here)
        else:
            yield ".".join(here), value if isinstance(value, str) else json.dumps(value)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_key_has_its_value_and_what_it_means(iout, name):
    status, out, err = iout("show", name, "--explain")
    assert (status, err) == (0, "")
    lines = out.splitlines()
    scenario = load_scenario(name)
    assert lines[0].startswith(f"# hash {scenario.hash}, ")
    for key, value in leaves(scenario.model_dump(mode="json")):
        place = lines.index(f"{key}: {value}")
        assert lines[place + 1].startswith("    "), key


def test_unit_range_and_kinds_are_told(iout):
    _, out, _ = iout("show", "paper/k3-fdd", "--explain")
    told = " ".join(out.split())
    power = "charging.power_w: 2000.0 Electric power of the source. [W; above 0; plausible: 0 to"
    assert power in told
    assert "auvs.motion: six The directions that an AUV can take." in told
    assert "[kinds: fdd, tdd] (fdd) Charging and uplink at once" in told


def test_changes_are_seen(iout):
    _, out, _ = iout("show", "paper/k3-fdd", "--explain", "--set", "charging.power_w=500")
    assert "\ncharging.power_w: 500.0\n" in out


def test_what_a_file_says_is_shown_in_one_line(iout, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = 'extends: paper/k3-fdd\ndescription: "two\\nlines \\e[31m"\n'
    (tmp_path / "mine.yaml").write_text(text, encoding="utf-8")
    _, out, _ = iout("show", "mine.yaml", "--explain")
    (line,) = [line for line in out.splitlines() if line.startswith("description: ")]
    assert line.isprintable()
    assert "two" in line
    assert "lines" in line


def test_a_part_of_ones_own(iout, tmp_path, monkeypatch, forgotten_parts):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "explained_part.py").write_text(
        "from iout_marl import parts\n"
        "@parts.rewards.register('oldest', version=1)\n"
        "class Oldest(parts.Reward):\n"
        "    'Minus the age of the oldest node.'\n"
        "    class Settings(parts.Settings):\n"
        "        #: What a slot of age costs.\n"
        "        weight: parts.Positive = 1.0\n"
        "    def __call__(self, state, events):\n"
        "        return {'age': -self.xp.max(state.age, axis=-1, keepdims=True)}\n",
        encoding="utf-8",
    )
    words = ["--set", "reward.kind=oldest", "--set", "reward.weight=2"]
    status, out, _ = iout(
        "show", "paper/k3-fdd", "--explain", "--import", "explained_part.py", *words
    )
    assert status == 0
    assert "(oldest) Minus the age of the oldest node.\nreward.weight: 2.0\n" in out
    assert "    What a slot of age costs. [above 0]" in out
