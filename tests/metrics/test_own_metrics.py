"""A user's metrics in evaluations, worlds and environments: those by hand."""

import copy
import json
import pickle
import re

import numpy as np
import pytest
import torch
from own_metrics import OWN

from iout_marl import World, evaluate, iout_v0, metrics
from iout_marl.envs import AUVVectorEnv
from iout_marl.evaluation import METRICS, play
from iout_marl.policies import make_baseline
from iout_marl.tracing.unrolled import pays_unrolled
from iout_marl.world import node_codes


def by_hand(world, state, events):
    """The values of the two sums in a slot, (envs, 2), with NumPy alone."""
    failed = (~np.asarray(events.delivered)).sum(axis=1)
    drained = np.asarray(state.energy_j).sum(1) - 2 * np.asarray(events.harvested_j).sum(1)
    return np.stack([failed, drained], axis=1)


@pytest.fixture(params=[{}, {"auvs.start_cells": [[2, 1, 1], [1, 2, 1]]}], ids=["one", "two"])
def scenario(request, tiny):
    """The tiny scenario with random layouts, with one AUV or two."""
    return tiny({"nodes": {"kind": "random", "count": 2}, **request.param})


class TestEvaluation:
    def test_values_are_those_by_hand(self, own, scenario):
        found = evaluate(scenario, "random-walk", 4, seed=2)
        assert tuple(found.samples) == (*METRICS, *OWN)
        world, sums = World(scenario, 4), 0.0
        for state, events in play(world, make_baseline("random-walk"), 2):
            sums = sums + (0 if events is None else by_hand(world, state, events))
        assert found.samples["worst_wait"].tolist() == state.age.max(axis=1).tolist()
        np.testing.assert_allclose(found.samples["failed"], sums[:, 0])
        np.testing.assert_allclose(found.samples["drained_j"], sums[:, 1])
        assert set(found.to_json()["metrics"]) == {*METRICS, *OWN}

    def test_built_in_metrics_are_as_without(self, own, scenario):
        found = evaluate(scenario, "greedy", 3).samples
        for name in OWN:
            metrics.unregister(name)
        for name, values in evaluate(scenario, "greedy", 3).samples.items():
            assert values.tolist() == found[name].tolist()

    def test_planner_is_measured_too(self, own, tiny):
        assert set(evaluate(tiny(), "planner", 1).samples) == {*METRICS, *OWN}

    def test_on_the_command_line(self, own, iout, tiny_settings, tmp_path):
        words = ["evaluate", "best/k3-fdd", *tiny_settings, "--policy", "greedy", "--episodes", 2]
        status, _, _ = iout(*words, "--json", tmp_path / "found.json")
        assert status == 0
        status, table, _ = iout(*words)
        assert re.search(r"worst wait +│ +\d+\.\d\d", table)
        assert re.search(r"<b>drained +│ +-?\d+\.\d\d", table)
        found = json.loads((tmp_path / "found.json").read_text())["metrics"]
        assert list(found)[-3:] == list(OWN)


class TestWorlds:
    def played(self, scenario, episodes, seeds):
        """The metrics of random actions, the same in every environment of these seeds."""
        episodes.reset(seeds)
        rng = np.random.default_rng(0)
        while not episodes.is_over:
            shape = (1, episodes.world.num_auvs)
            sizes = episodes.world.action_sizes
            action = np.stack([rng.integers(0, n, shape) for n in sizes], axis=-1)
            episodes.step(np.tile(action, (len(seeds), 1, 1)))
        return episodes.world.metrics(episodes.current)

    def test_single_environment_is_one_of_a_batch(self, own, scenario):
        assert pays_unrolled(scenario)
        batch = self.played(scenario, AUVVectorEnv(scenario, 3)._episodes, [1, 2, 3])
        for i, seed in enumerate((1, 2, 3)):
            single = iout_v0.parallel_env(scenario)._episodes
            found = self.played(scenario, single, [seed])
            assert type(single._stepper).__name__ == "TracedStepper"
            for name in OWN:
                np.testing.assert_allclose(found[name][0], batch[name][i], err_msg=name)

    @pytest.mark.parametrize("copied", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))])
    def test_sums_survive_a_copy_in_mid_episode(self, own, scenario, copied):
        episodes = AUVVectorEnv(scenario, 2)._episodes
        episodes.reset([1, 2])
        for _ in range(5):
            episodes.step(np.zeros((2, episodes.world.num_auvs, 3), dtype=int))
        before = episodes.current.sums
        assert before.shape == (2, 2)
        assert np.array_equal(copied(episodes).current.sums, before)
        metrics.unregister("failed")
        assert np.array_equal(copied(episodes).current.sums, before[:, 1:])
        metrics.unregister("drained_j")
        assert copied(episodes).current.sums.shape == (2, 0)

    def test_an_environment_keeps_the_metrics_that_it_was_made_with(self, own, scenario):
        episodes = iout_v0.parallel_env(scenario)._episodes
        for name in OWN:
            metrics.unregister(name)
        assert set(OWN) <= set(self.played(scenario, episodes, [1]))
        assert episodes.current.sums.shape == (1, 2)
        other = iout_v0.parallel_env(scenario)._episodes
        assert set(OWN).isdisjoint(self.played(scenario, other, [1]))

    @pytest.mark.parametrize("dtype", ["float32", "float64"])
    def test_on_torch(self, own, scenario, dtype):
        found = []
        for library in (np, torch):
            world = World(scenario, 2, library=library, dtype=dtype)
            layouts = [np.random.default_rng(i) for i in range(2)]
            state = world.reset(node_codes(scenario, world.grid, layouts))
            for _ in range(5):
                state, _ = world.checked_step(state, np.ones((2, world.num_auvs, 3), dtype=int))
            found.append(world.metrics(state))
            assert {str(v.dtype).removeprefix("torch.") for v in found[-1].values()} == {dtype}
        for name in OWN:
            np.testing.assert_allclose(found[0][name], found[1][name], rtol=1e-5)

    def test_no_column_without_metrics_of_users(self, tiny):
        world = World(tiny(), 3)
        state = world.reset(np.zeros((3, 2), dtype=np.int64))
        after, _ = world.step(state, np.zeros((3, 1, 3), dtype=int))
        assert after.sums is state.sums
        assert state.sums.shape == (3, 0)
