"""A user's metrics in trainings, studies and reports."""

import json
import math
import re
import shutil

import numpy as np
import pytest
import torch
from emulated_graph import EmulatedGraph
from own_metrics import OWN, register_own
from rich.console import Console
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tiny_study import SameProcess, write_study

from iout_marl import InputError, metrics
from iout_marl.evaluation import METRICS
from iout_marl.report.build import build_report
from iout_marl.report.markdown import render_markdown
from iout_marl.report.page import render_page
from iout_marl.study import expand, load_study, run_study
from iout_marl.study.results import read_results
from iout_marl.study.run import StudyFolder
from trainers import RunFolder, Trainer, collector, train
from trainers.accel import graphs

QUIET = Console(quiet=True)
#: Rollouts end in the middle of episodes, and so do checkpoints.
MID_EPISODE = {"training.rollout_slots": 13, "training.steps": 364}


def rows_of(run):
    """What `metrics.jsonl` says."""
    return [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]


class TestTraining:
    @pytest.fixture
    def go(self, tiny):
        def run(folder, changes=(), **options):
            return train(tiny(changes), folder, 3, console=QUIET, evaluation_episodes=3, **options)

        return run

    def test_is_logged_and_evaluated(self, own, go, tmp_path):
        outcome = go(tmp_path / "run")
        rows = rows_of(tmp_path / "run")
        events = EventAccumulator(str(tmp_path / "run")).Reload()
        for name in OWN:
            logged = [row[f"metrics/{name}"] for row in rows]
            assert all(map(math.isfinite, logged))
            shown = [scalar.value for scalar in events.Scalars(f"metrics/{name}")]
            np.testing.assert_allclose(shown, logged, rtol=1e-6)
        assert logged[0] >= 0 or min(row["metrics/failed"] for row in rows) >= 0
        assert max(row["metrics/failed"] for row in rows) <= 20
        assert list(outcome.evaluation.samples) == [*METRICS, *OWN]
        result = json.loads(RunFolder(tmp_path / "run").result())
        assert set(OWN) <= set(result["evaluation"]["metrics"])

    def test_several_policies_log_what_each_one_alone_does(self, own, tiny):
        logs = Trainer(tiny(), 3, replicas=2).iterate_all()
        alone = Trainer(tiny(), 4).iterate()
        for name in OWN:
            assert logs[1][f"metrics/{name}"] == pytest.approx(alone[f"metrics/{name}"], rel=1e-4)

    @pytest.mark.slow
    def test_recorded_slots_sum_as_those_that_are_run(self, own, tiny, monkeypatch):
        monkeypatch.setattr(collector, "NUMPY_DEVICES", ())
        monkeypatch.setitem(graphs.GRAPHS, "cpu", EmulatedGraph)
        scenario = tiny(MID_EPISODE)
        recorded, eager = Trainer(scenario, 3), Trainer(scenario, 3, use_graphs=False)
        for _ in range(4):
            logs = recorded.iterate(), eager.iterate()
            for name in OWN if "metrics/failed" in logs[1] else ():
                first, second = (log[f"metrics/{name}"] for log in logs)
                assert first == pytest.approx(second, rel=1e-5)
        assert "metrics/failed" in logs[0]

    def stopped(self, go, folder):
        """A training that stops in the middle of an episode, with a sum that is under way."""
        go(folder, {**MID_EPISODE, "training.steps": 52})
        return torch.load(folder / "checkpoint.pt", weights_only=True)["trainer"]["collector"]

    @pytest.mark.slow
    def test_resumed_in_mid_episode_goes_on_as_if_it_had_not_stopped(self, own, go, tmp_path):
        sums = self.stopped(go, tmp_path / "stopped")["sums"]
        assert set(sums) == {"failed", "drained_j"}
        assert all(values.any() for values in sums.values())
        go(tmp_path / "stopped", MID_EPISODE, resume=True)
        go(tmp_path / "whole", MID_EPISODE)
        of_runs = [rows_of(tmp_path / name) for name in ("stopped", "whole")]
        for first, second in zip(*of_runs, strict=True):
            assert {k: v for k, v in first.items() if "metrics/" in k} == {
                k: v for k, v in second.items() if "metrics/" in k
            }

    def test_resumed_with_other_metrics(self, own, go, tmp_path):
        self.stopped(go, tmp_path / "run")
        metrics.unregister("failed")
        metrics.register("one", unit="", definition="Slots.", per_slot=True)(
            lambda world, state, events: state.slot * 0 + 1
        )
        outcome = go(tmp_path / "run", {**MID_EPISODE, "training.steps": 156}, resume=True)
        rows = rows_of(tmp_path / "run")
        # The first 13 of an episode's 20 slots were not counted.
        assert [row["metrics/one"] for row in rows if "metrics/one" in row] == [7]
        assert outcome.finished
        for name in ("worst_wait", "drained_j", "one"):
            metrics.unregister(name)
        assert go(tmp_path / "run", MID_EPISODE, resume=True).finished

    def test_checkpoint_without_sums_is_as_before(self, go, tmp_path):
        saved = self.stopped(go, tmp_path / "run")
        assert "sums" not in saved
        assert "sums" not in saved["state"]

    @pytest.mark.parametrize(
        "damage",
        [
            lambda saved: saved.update(sums=3),
            lambda saved: saved.update(sums={"failed": torch.zeros(3)}),
            lambda saved: saved.update(sums={"failed": torch.full((4,), torch.nan)}),
        ],
        ids=["no mapping", "another shape", "not finite"],
    )
    def test_damaged_sums(self, own, go, tmp_path, damage):
        self.stopped(go, tmp_path)
        path = tmp_path / "checkpoint.pt"
        whole = torch.load(path, weights_only=True)
        damage(whole["trainer"]["collector"])
        torch.save(whole, path)
        (tmp_path / "run.json").unlink()
        with pytest.raises(InputError, match=r"checkpoint\.pt: .*collector\.sums"):
            go(tmp_path, MID_EPISODE, resume=True)

    def test_one_that_is_not_finite_ends_the_training(self, forgotten_metrics, go, tmp_path):
        metrics.register("odd", unit="", definition="No number.")(
            lambda world, state: state.jain * math.nan
        )
        with pytest.raises(InputError, match="metric odd: must be finite, not nan, after 80 env"):
            go(tmp_path)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder with the tiny study, run once for all that is asked of it."""
    folder = tmp_path_factory.mktemp("study")
    study = load_study(write_study(folder / "tiny.yaml"))
    identity = {"name": "tiny", "title": "A tiny study", "overrides": [], "quick": False}
    register_own()
    try:
        out = StudyFolder(folder / "out")
        with out.open(identity):
            cells, pool = expand(*study), SameProcess()
            run_study("tiny", study[0], cells, out, pool, "iout reproduce", console=QUIET)
    finally:
        for name in OWN:
            metrics.unregister(name)
    return folder / "out"


class TestStudies:
    @pytest.fixture
    def results(self, own, finished, tmp_path):
        """The results of the tiny study, read again."""
        shutil.copytree(finished, tmp_path / "out")
        return read_results(tmp_path / "out" / "results.json")

    @pytest.mark.slow
    def test_records_tables_and_reports_have_it(self, results, tmp_path):
        assert results.metrics == (*METRICS, *OWN)
        header, row, *_ = (tmp_path / "out" / "results.csv").read_text().splitlines()
        assert "jain_violation,worst_wait,failed,drained_j,env_steps" in header
        assert len(header.split(",")) == len(row.split(","))
        report = build_report(results)
        (overview,) = (part for part in report.sections if part.key == "overview")
        keys = [item.key for item in overview.items]
        assert keys == [*metrics.DRAWN, "metric-1", "metric-2", "metric-3", "metrics"]
        assert overview.items[3].y.label == "Worst wait in slots"
        table = overview.items[-1]
        assert table.columns[-3:] == ("Worst wait in slots", "Failed", "<b>drained in J")
        assert all(cell != "–" for row in table.rows for cell in row)
        page = render_page(report)
        assert "&lt;b&gt;drained in J" in page
        assert "<b>drained" not in page

    @pytest.mark.slow
    def test_where_it_is_not_registered_it_is_shown_by_its_name(self, results, tmp_path):
        for name in OWN:
            metrics.unregister(name)
        again = read_results(tmp_path / "out" / "results.json")
        assert again == results
        assert again.measured("greedy", 1.0, "drained_j").bounds == (-math.inf, math.inf)
        text = render_markdown(build_report(again), "figures")
        assert "| worst_wait | failed | drained_j |" in text

    @pytest.mark.slow
    def test_results_from_before_it_was_registered(self, results):
        old = results.model_copy(
            update={
                "cells": tuple(
                    cell.model_copy(
                        update={
                            "record": cell.record.model_copy(
                                update={"samples": {n: cell.record.samples[n] for n in METRICS}}
                            )
                        }
                    )
                    for cell in results.cells[:2]
                )
                + results.cells[2:]
            }
        )
        (overview,) = (part for part in build_report(old).sections if part.key == "overview")
        assert [row[-1] == "–" for row in overview.items[-1].rows] == [True, True, False, False]
        assert old.to_csv().splitlines()[1].count(",") == old.to_csv().splitlines()[0].count(",")

    @pytest.mark.slow
    def test_any_name_is_shown_as_it_is(self, results):
        names = ["../x", "<script>", "$x_1$", "a|b", "`code`", "x" * 900, ""]
        data = json.loads(results.to_json())
        for cell in data["cells"]:
            samples = cell["record"]["samples"]
            samples |= dict.fromkeys(names, samples.pop("failed"))
        odd = type(results).model_validate(data)
        assert set(names) < set(odd.metrics)
        report = build_report(odd)
        (overview,) = (part for part in report.sections if part.key == "overview")
        keys = [item.key for item in overview.items]
        assert len(set(keys)) == len(keys) > len(names)
        assert all(re.fullmatch(r"[\w-]+", key) for key in keys)
        assert "<script>x" not in render_page(report)
        assert render_markdown(report, "figures")

    @pytest.mark.slow
    def test_samples_that_are_too_few_are_damaged(self, results, tmp_path):
        data = json.loads(results.to_json())
        data["cells"][0]["record"]["samples"]["failed"] = [1.0]
        path = tmp_path / "damaged.json"
        path.write_text(json.dumps(data))
        with pytest.raises(InputError, match=r"samples\.failed: must hold a number for each ep"):
            read_results(path)
