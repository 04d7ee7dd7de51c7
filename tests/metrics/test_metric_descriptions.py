"""Metrics are described in one place, and what a user registers is looked at."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from batteries import BATTERY
from own_metrics import OWN

from iout_marl import InputError, World, evaluate, metrics
from iout_marl.evaluation import METRICS
from iout_marl.study.records import CURVES
from iout_marl.world import node_codes
from trainers import Trainer

ROOT = Path(__file__).parents[2]


class TestDescriptions:
    @pytest.mark.parametrize("metric", metrics.ALL, ids=lambda metric: metric.name)
    def test_is_complete(self, metric):
        assert metric.name.isidentifier()
        assert metric.definition.endswith(".")
        for text in (metric.heading, metric.axis_title, metric.title, metric.tag):
            assert text.strip() == text != ""
        assert metric.low < metric.high
        assert 0 <= metric.digits <= 12
        assert metric.better in ("less", "more", None)
        assert metrics.described(metric.name) is metric

    def test_names_and_tags_are_unique(self):
        for values in zip(*((m.name, m.tag, m.heading) for m in metrics.ALL), strict=True):
            assert len(set(values)) == len(metrics.ALL)

    def test_are_those_of_world_evaluation_and_training(self, tiny):
        world = World(tiny())
        found = world.metrics(world.reset(node_codes(world.scenario, world.grid, [None])))
        assert {*found, "reward"} == set(METRICS)
        assert tuple(evaluate(tiny(), "greedy", 1).samples) == METRICS
        log = Trainer(tiny()).iterate()
        assert {metric.tag for metric in metrics.BUILTIN} <= set(log)
        assert set(CURVES) <= set(log)
        assert {*metrics.DRAWN, *metrics.TABLED} <= set(METRICS)

    def test_of_stores_are_those_of_worlds_where_they_have_limits(self, tiny):
        limited = tiny({"storage": {"kind": "capacitor", "capacity_j": 90.0, "idle_w": 0.5}})
        names = (*METRICS, *(metric.name for metric in metrics.OF_STORES))
        found = evaluate(limited, "greedy", 1)
        assert tuple(found.samples) == names
        assert all(found.metrics[metric.name].mean >= 0 for metric in metrics.OF_STORES)
        assert {metric.tag for metric in metrics.OF_STORES} <= set(Trainer(limited).iterate())

    @pytest.mark.parametrize(
        "changes", [{"episode.slot_s": 50.0}, {"age.sampling": "packet_start"}]
    )
    def test_of_time_are_those_of_worlds_whose_slots_say_little(self, tiny, changes):
        found = evaluate(tiny(changes), "greedy", 1)
        assert tuple(found.samples) == (*METRICS, "mean_aoi_s")
        slot_s = tiny(changes).slot_s
        assert found.metrics["mean_aoi_s"].mean == found.metrics["mean_aoi"].mean * slot_s
        assert "aoi/mean_s" in Trainer(tiny(changes)).iterate()

    def test_of_vehicles_are_those_of_worlds_where_they_can_run_out_of_energy(self, tiny):
        limited = tiny({"vehicle": BATTERY})
        names = (*METRICS, *(metric.name for metric in metrics.OF_VEHICLES))
        found = evaluate(limited, "greedy", 1)
        assert tuple(found.samples) == names
        assert all(found.metrics[metric.name].mean >= 0 for metric in metrics.OF_VEHICLES)
        assert {metric.tag for metric in metrics.OF_VEHICLES} <= set(Trainer(limited).iterate())

    def test_lie_within_their_bounds(self, tiny):
        for name, values in evaluate(tiny(), "random-walk", 20).samples.items():
            metric = metrics.described(name)
            assert metric.low <= min(values) <= max(values) <= metric.high
            assert min(values) > 0 or not metric.is_positive

    def test_tags_are_written_nowhere_else(self):
        """But in the report on the paper, which names what it speaks of."""
        of_the_paper = {"report.py", "explanations.py"}
        for folder in ("iout_marl", "trainers"):
            for path in (ROOT / folder).rglob("*.py"):
                if path.parent.name == "metrics" or (
                    path.parent.name == "paper" and path.name in of_the_paper
                ):
                    continue
                text = path.read_text(encoding="utf-8")
                assert [m.tag for m in metrics.ALL if f'"{m.tag}"' in text] == [], path


class TestPages:
    def test_code_of_the_page_runs(self, forgotten_metrics, capsys):
        text = (ROOT / "docs" / "metrics.md").read_text(encoding="utf-8")
        (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
        exec(code, {})
        assert float(capsys.readouterr().out) > 0


class TestErrors:
    @pytest.mark.parametrize(
        ("name", "arguments", "expected"),
        [
            ("two words", {}, "metric 'two words': its name must be a word, such as worst_wait"),
            ("", {}, "metric '': its name must be a word"),
            ("x" * 61, {}, "its name must be a word"),
            (3, {}, "metric 3: its name must be a word"),
            ("jain", {}, "metric jain: is a built-in one; give yours another name"),
            ("failed", {}, "metric failed: is registered already; metrics.unregister frees it"),
            ("mine", {"unit": None}, 'metric mine: needs a unit; unit="" is a pure number'),
            ("mine", {"unit": 3}, "metric mine: unit must be a line of text, not 3"),
            ("mine", {"definition": None}, "metric mine: needs a definition, a sentence"),
            ("mine", {"definition": "a\nb"}, "metric mine: definition must be a line of text, no"),
            ("mine", {"heading": "x" * 1001}, "metric mine: heading must be a line of text, not"),
            ("mine", {"better": "lower"}, "better must be 'less', 'more' or None, not 'lower'"),
            ("mine", {"digits": -1}, "metric mine: digits must be at least 0, not -1"),
            ("mine", {"digits": "two"}, "metric mine: digits must be a whole number, not 'two'"),
            ("mine", {"low": 1, "high": 1}, "metric mine: low must be a number below high, not 1"),
            ("mine", {"low": math.nan}, "metric mine: low must be a number below high, not nan"),
            ("mine", {"high": "1"}, "metric mine: low must be a number below high, not -inf and"),
        ],
    )
    def test_of_registering(self, own, name, arguments, expected):
        with pytest.raises(InputError) as raised:
            metrics.register(name, **{"unit": "", "definition": "A sentence.", **arguments})(max)
        assert expected in str(raised.value)
        assert [metric.name for metric in metrics.registered()] == [
            *(m.name for m in metrics.ALL),
            *OWN,
        ]

    def test_of_what_is_no_function(self):
        with pytest.raises(InputError, match="metric mine: must be a function, not 3"):
            metrics.register("mine", unit="", definition="A sentence.")(3)

    def test_of_forgetting(self, own):
        with pytest.raises(InputError, match="no metric 'faild' was registered; did you mean 'fai"):
            metrics.unregister("faild")
        with pytest.raises(InputError, match="no metric 'jain' was registered"):
            metrics.unregister("jain")

    @pytest.mark.parametrize("per_slot", [False, True], ids=["of the state", "of a slot"])
    @pytest.mark.parametrize(
        ("returned", "expected"),
        [
            (lambda s: 3.0, "must return an array of 2 numbers, one for each environment, not 3.0"),
            (lambda s: None, "must return an array of 2 numbers, one for each environment, not No"),
            (lambda s: [1, 2], "must return an array of 2 numbers, one for each environment, not"),
            (lambda s: s.age, "must return an array of shape (2,), one number for each environme"),
            (lambda s: s.age[:1, 0], "must return an array of shape (2,), one number for each en"),
            (lambda s: s.jain + 1j, "must return numbers, not complex128"),
            (lambda s: np.array(["a", "b"]), "must return numbers, not <U1"),
            (lambda s: s.jain + math.nan, "must be finite, not nan (episode 0)"),
            (lambda s: s.jain + math.inf, "must be finite, not inf (episode 0)"),
            (lambda s: s.jain + 1e6, "must lie between -1e+06 and 1000, as it was registered, no"),
        ],
    )
    def test_of_what_it_returns(self, forgotten_metrics, tiny, per_slot, returned, expected):
        register = metrics.register(
            "odd", unit="", definition="Odd.", per_slot=per_slot, low=-1e6, high=1e3
        )
        register(lambda world, state, *events: returned(state))
        random = tiny({"nodes": {"kind": "random", "count": 2}})
        with pytest.raises(InputError) as raised:
            evaluate(random, "greedy", 2)
        assert str(raised.value).startswith("metric odd: ")
        assert expected in str(raised.value)

    def test_what_a_function_raises_is_raised(self, forgotten_metrics, tiny):
        @metrics.register("fails", unit="", definition="Fails.")
        def fails(world, state):
            raise ZeroDivisionError("in a metric")

        with pytest.raises(ZeroDivisionError, match="in a metric"):
            evaluate(tiny(), "greedy", 1)
