"""Training presets: what they give, their cases, presets of one's own."""

import pytest

from iout_marl import InputError, bundled_names, load_scenario
from iout_marl.scenario import Training, to_yaml

OWN = """\
steps: 1000
environments: 2
rollout_slots: 10
epochs: 1
minibatches: 1
learning_rate: 1e-3
learning_rate_schedule: constant
adam_epsilon: 1e-5
discount: 0.9
gae_lambda: 0.9
clip: 0.2
entropy_coefficient: 0
value_coefficient: 0.5
max_gradient_norm: 1
normalise_advantage: true
normalise_value: false
target_kl: null
hidden_units: [4]
activation: relu
critic: central
node_network: true
observation_scaling: none
reward_scaling: none
mask_actions: false
checkpoint_steps: 100
"""
CASES = """
cases:
  - when: {duplex.kind: tdd}
    set: {discount: 0.8, epochs: 3}
  - when: {duplex.kind: tdd, nodes.count: 3}
    set: {epochs: 4}
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text(OWN + CASES)
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("name", bundled_names())
def test_bundled_scenarios_train_by_the_fast_preset(name):
    """But for those that the pretrained policy was trained on."""
    expected = "pretrain" if name.startswith("pretrained/") else "fast"
    assert load_scenario(name).training.preset == expected


@pytest.mark.parametrize(
    ("name", "discount", "learning_rate", "steps"),
    [
        ("paper/k3-fdd", 0.92, 5e-4, 4_000_000),
        ("paper/k5-fdd", 0.92, 5e-4, 6_000_000),
        ("paper/k7-tdd", 0.93, 3e-4, 10_000_000),
        ("paper/k10-tdd", 0.93, 3e-4, 12_000_000),
    ],
)
def test_paper_preset_is_the_papers_table(name, discount, learning_rate, steps):
    training = load_scenario(name, {"training.preset": "paper"}).training
    assert (training.discount, training.learning_rate, training.steps) == (
        discount, learning_rate, steps,
    )  # fmt: skip
    assert (training.rollout_slots, training.epochs, training.entropy_coefficient) == (
        100, 10, 0.01,
    )  # fmt: skip
    samples = training.environments * training.rollout_slots
    assert samples / training.minibatches == 100
    assert training.hidden_units == (64, 64)


@pytest.mark.parametrize(
    ("name", "discount", "epochs"),
    [("paper/k3-fdd", 0.9, 1), ("paper/k5-tdd", 0.8, 3), ("paper/k3-tdd", 0.8, 4)],
)
def test_cases_that_hold_apply_in_turn(folder, name, discount, epochs):
    training = load_scenario(name, {"training.preset": "own.yaml"}).training
    assert (training.discount, training.epochs) == (discount, epochs)
    assert training.preset == "own.yaml"


def test_scenario_goes_before_its_preset(folder):
    changes = {"training.preset": "own.yaml", "training.epochs": 9}
    assert load_scenario("paper/k3-tdd", changes).training.epochs == 9


def test_path_counts_from_the_scenario_file(folder, monkeypatch):
    (folder / "mine.yaml").write_text("extends: paper/k3-fdd\ntraining: {preset: own.yaml}")
    (folder / "elsewhere").mkdir()
    monkeypatch.chdir(folder / "elsewhere")
    assert load_scenario("../mine.yaml").training.steps == 1000


def test_resolved_scenario_no_longer_needs_its_preset(folder):
    scenario = load_scenario("paper/k3-fdd", {"training.preset": "own.yaml"})
    (folder / "copy.yaml").write_text(to_yaml(scenario), encoding="utf-8")
    (folder / "own.yaml").unlink()
    assert load_scenario(folder / "copy.yaml") == scenario
    assert load_scenario(scenario) == scenario


def test_preset_gives_every_setting_but_its_own_name_parts_and_families():
    given = {line.partition(":")[0] for line in OWN.splitlines()}
    left_out = {"preset", "network", "optimizer", *Training.written_if_set}
    assert given == set(Training.model_fields) - left_out


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (OWN.replace("steps: 1000\n", ""), r"training\.steps: is missing"),
        (OWN.replace("epochs: 1", "epochs: 0"), r"^own\.yaml:4: training\.epochs: must be greater"),
        (OWN.replace("epochs", "epoch"), r"^own\.yaml:4: training\.epoch: unknown key; did you "),
        (OWN + "cases: 3", r"own\.yaml:26: cases: must be a list"),
        (OWN + "cases: [3]", r"own\.yaml:26: cases: each must have the mappings 'when' and 'set'"),
        (OWN + "cases:\n- {when: {}}", r"own\.yaml:27: cases: each must have the mappings"),
        (OWN + "cases: [{when: 3, set: {}}]", r"own\.yaml:26: cases: each must have the mappings"),
        (OWN + "cases: [{when: {}, set: [1]}]", r"own\.yaml:26: cases: each must have the "),
        (OWN + "cases: [{when: {}, set: {epochs: x}}]", r"^own\.yaml:26: training\.epochs: must "),
        ("[1, 2]", r"own\.yaml:1: must be a mapping"),
        ("a: [1", r"own\.yaml:1: broken YAML"),
        (OWN + "foo: 3\nbar: 4", r"^own\.yaml:26: training\.foo: unknown key.*; also own\.yaml:27"),
        (
            OWN + "cases:\n- when: {duplx.kind: tdd}\n  set: {}",
            r"own\.yaml:27: cases: when: duplx\.kind: unknown key; did you mean 'duplex\.kind'\?",
        ),
        (
            OWN + "cases:\n- when:\n    nodes.cuont: 3\n  set: {}",
            r"own\.yaml:28: cases: when: nodes\.cuont: unknown key; did you mean 'nodes\.count'\?",
        ),
        (
            OWN + "cases:\n- when: {power_w: 3}\n  set: {}",
            r"own\.yaml:27: cases: when: power_w: unknown key; did you mean 'charging\.power_w'\?",
        ),
        (
            OWN + "cases:\n- when: {duplex.kind: tddd}\n  set: {}",
            r"own\.yaml:27: cases: when: duplex\.kind: unknown value 'tddd'; did you mean 'tdd'\?",
        ),
        (
            OWN + "cases:\n- when: {duplex.kind: fdd}\n  set:\n    epohs: 3",
            r"^own\.yaml:29: training\.epohs: unknown key; did you mean 'epochs'\?",
        ),
        ("", r"training\.preset: own\.yaml: is empty$"),
    ],
)
def test_bad_preset(folder, text, expected):
    (folder / "own.yaml").write_text(text)
    with pytest.raises(InputError, match=expected) as raised:
        load_scenario("paper/k3-fdd", {"training.preset": "own.yaml"})
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("preset", "expected"),
    [
        ("fats", r"no training preset 'fats'; did you mean 'fast'\?"),
        (
            "nowhere/x.yaml",
            r"no training preset 'nowhere/x.yaml' \(known: fast, fine-tune, paper, pretrain, sho",
        ),
        ("x" * 5000, "no training preset"),
        (3, "must be a word"),
        ([], "must be a word"),
        (None, "must be a word"),
    ],
)
def test_no_such_preset(preset, expected):
    with pytest.raises(InputError, match=expected) as raised:
        load_scenario("paper/k3-fdd", {"training.preset": preset})
    assert str(raised.value).startswith("override training.preset: training.preset: ")
