"""The policy that comes with the package: its file, where it plays, and what it says of itself."""

import json
import shutil
import struct

import numpy as np
import pytest
import safetensors.torch

from iout_marl import evaluate, load_scenario, pretrained
from iout_marl.bounds.scheduling import delivery_bound
from iout_marl.errors import InputError, Note
from iout_marl.policies import load_policy, make_baseline
from iout_marl.scenario.extent import extent_of, outside
from trainers import train
from trainers.pretrained import WEIGHTS, Pretrained, load_modes
from trainers.pretraining import hashed, packed

#: A training as that of the package, but for its length.
SHORT = {
    "training.network": {"kind": "set", "width": 8, "blocks": 1, "heads": 2, "critic_width": 8},
    "training.environments": 8,
    "training.minibatches": 2,
    "training.epochs": 1,
    "training.steps": 1000,
    "training.over": [{"name": "few", "vary": {"nodes.count": [3, 4]}}],
}


@pytest.fixture(scope="module")
def weights(tmp_path_factory):
    """A file of weights for FDD alone."""
    folder = tmp_path_factory.mktemp("pretrained")
    train("pretrained/fdd", folder / "fdd", overrides=SHORT, evaluation_episodes=1)
    (folder / "weights").write_bytes(packed([folder / "fdd"], folder / "weights"))
    return folder / "weights"


@pytest.mark.slow
def test_what_is_packed(weights):
    (mode,) = load_modes(weights).values()
    assert mode.scenario.training.network.width == 8
    assert mode.about["hash"] == hashed(mode.weights)
    assert mode.about["env_steps"] >= 1000
    assert (mode.extent["nodes.count"]["from"], mode.extent["nodes.count"]["to"]) == (3, 4)
    policy = Pretrained(path=weights)
    with pytest.warns(Note, match=r"outside what it was trained on.*nodes\.count 5 > 4"):
        assert evaluate("random/k5-fdd", policy, 1).episodes == 1
    with pytest.raises(InputError, match=r"no weights for duplex\.kind tdd"):
        evaluate("random/k5-tdd", policy, 1)


@pytest.mark.slow
def test_a_mode_without_a_run_stays_as_it_is_in_the_file(weights, tmp_path):
    train("pretrained/tdd", tmp_path / "tdd", overrides=SHORT, evaluation_episodes=1)
    (tmp_path / "both").write_bytes(packed([tmp_path / "tdd"], weights))
    before, after = load_modes(weights), load_modes(tmp_path / "both")
    assert before.keys() == {"fdd"}
    assert after.keys() == {"fdd", "tdd"}
    assert after["fdd"].about == before["fdd"].about
    assert hashed(after["fdd"].weights) == after["fdd"].about["hash"]
    # And a run takes the place of what was there.
    (tmp_path / "again").write_bytes(packed([weights.parent / "fdd"], tmp_path / "both"))
    again = load_modes(tmp_path / "again")
    assert {k: m.about for k, m in again.items()} == {k: m.about for k, m in after.items()}


def changed(weights, folder, **metadata):
    """A copy of a file of weights with other metadata, or with one tensor less."""
    data = weights.read_bytes()
    (size,) = struct.unpack("<Q", data[:8])
    told = json.loads(data[8 : 8 + size])["__metadata__"] | metadata
    tensors = safetensors.torch.load(data)
    copy = folder / "copy"
    safetensors.torch.save_file(tensors, copy, told)
    return copy


def test_files_that_are_refused(weights, tmp_path):
    with pytest.raises(InputError, match="format 7, not 1"):
        load_modes(changed(weights, tmp_path, format="7"))
    with pytest.raises(InputError, match="cannot be read"):
        load_modes(changed(weights, tmp_path, fdd="{"))
    with pytest.raises(InputError, match="nowhere: cannot be read"):
        load_modes(tmp_path / "nowhere")
    cut = tmp_path / "cut"
    cut.write_bytes(weights.read_bytes()[:-100])
    with pytest.raises(InputError, match="cut: cannot be read"):
        load_modes(cut)
    tensors = safetensors.torch.load(weights.read_bytes())
    other = {k: v[:-1] if k.endswith("actor.node.0.weight") else v for k, v in tensors.items()}
    with safetensors.safe_open(weights, "pt") as file:
        safetensors.torch.save_file(other, tmp_path / "other", file.metadata())
    with pytest.raises(InputError, match=r"actor\.node\.0\.weight"):
        load_modes(tmp_path / "other")


@pytest.mark.slow
def test_only_finished_trainings_over_scenarios_are_packed(weights, tmp_path):
    shutil.copytree(weights.parent / "fdd", tmp_path / "again")
    with pytest.raises(InputError, match="second run"):
        packed([weights.parent / "fdd", tmp_path / "again"], weights)
    few = {k: v for k, v in SHORT.items() if k not in ("training.over", "training.network")}
    train("paper/k3-fdd", tmp_path / "one", overrides=few, evaluation_episodes=1)
    with pytest.raises(InputError, match="no finished training over several scenarios"):
        packed([tmp_path / "one"], weights)


class TestShipped:
    """The weights in the package."""

    def test_file(self):
        assert WEIGHTS.stat().st_size < 3_000_000
        modes = load_modes()
        assert sorted(modes) == ["fdd", "tdd"]
        for mode in modes.values():
            assert mode.about["hash"] == hashed(mode.weights)

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("name", "changes", "most"),
        [
            ("random/k10-fdd", {}, 1.06),
            ("random/k5-fdd", {}, 1.09),
            ("random/k10-fdd", {"nodes.count": 20}, 1.06),
            ("multi/m3-k20-fdd", {}, 1.02),
            ("multi/m1-k10-fdd", {"auvs.count": 4}, 1.02),
            ("random/k5-tdd", {}, 1.6),
        ],
        ids=str,
    )
    def test_how_good(self, name, changes, most):
        """Over the scheduling bound at most so many times: far below any baseline."""
        scenario = load_scenario(name, {**changes})
        found = evaluate(scenario, pretrained(), 1, seed=77).samples["mean_aoi"].mean()
        assert found < most * delivery_bound(scenario)

    @pytest.mark.slow
    def test_by_name(self):
        by_name = [load_policy("pretrained"), make_baseline("pretrained"), pretrained()]
        found = [evaluate("paper/k3-tdd", policy, 1).samples["mean_aoi"][0] for policy in by_name]
        assert len(set(found)) == 1
        assert load_policy("pretrained", sampled=True).sampled

    @pytest.mark.slow
    def test_order_of_nodes(self):
        """Another numbering of the nodes leads to the same episode."""
        cells = load_scenario("paper/k7-fdd").nodes.cells
        found = [
            evaluate(load_scenario("paper/k7-fdd", {"nodes.cells": order}), pretrained(), 1)
            for order in (cells, cells[::-1])
        ]
        ages = [each.samples["mean_aoi"][0] for each in found]
        np.testing.assert_allclose(ages[0], ages[1])

    @pytest.mark.slow
    def test_one_node(self):
        assert evaluate("random/k3-fdd", pretrained(), 1, seed=3).episodes == 1
        one = load_scenario("random/k3-fdd", {"nodes.count": 1})
        with pytest.warns(Note, match=r"nodes\.count 1 < 3"):
            evaluate(one, pretrained(), 1)


def test_extent():
    extent = extent_of([load_scenario(f"random/k{k}-fdd") for k in (3, 10)])
    assert outside(load_scenario("random/k7-fdd"), extent) == []
    assert outside(load_scenario("paper/k7-fdd"), extent) == []
    many = load_scenario("random/k7-fdd", {"nodes.count": 200, "charging.power_w": 10.0})
    assert outside(many, extent) == ["nodes.count 200 > 10", "charging.power_w 10 < 2000"]
    other = load_scenario("random/k7-fdd", {"storage": {"kind": "capacitor", "capacity_j": 1e3}})
    assert outside(other, extent) == ["storage.kind capacitor, not unlimited"]
    weighted = load_scenario("random/k3-fdd", {"nodes.weights": [1.0, 2.0, 4.0]})
    assert outside(weighted, extent) == ["nodes.weights 4 > 1"]


def test_spacing_by_axis_is_compared_with_spacing_as_a_number():
    def told(scenario, *others):
        # The length of a slot goes by the spacing, too.
        found = outside(scenario, extent_of(others))
        return [each for each in found if not each.startswith("episode.slots")]

    cube, flat, deep, small = (
        load_scenario("random/k7-fdd", {"grid.spacing_m": spacing_m})
        for spacing_m in (100, [100, 100, 50], [100, 100, 200], 40)
    )
    assert told(flat, cube) == ["grid.spacing_m[2] 50 < 100"]
    assert told(cube, flat) == []
    assert told(cube, deep, flat) == []
    assert told(flat, deep) == ["grid.spacing_m[2] 50 < 200"]
    assert told(deep, cube, flat) == ["grid.spacing_m[2] 200 > 100"]
    assert told(small, flat) == ["grid.spacing_m 40 < 50"]
