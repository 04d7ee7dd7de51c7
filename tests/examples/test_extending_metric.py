"""The example of metrics of one's own, from a file outside of the package."""

import importlib.util
import re
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "extending" / "metric.py"


def test_example_prints_its_two_metrics(forgotten_metrics, capsys):
    spec = importlib.util.spec_from_file_location("metric_example", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.main(["--episodes", "3"])
    printed = capsys.readouterr().out
    pattern = r"worst wait: \d+\.\d slots\nfailed uplinks: \d+\.\d AUV-slots\n"
    assert re.fullmatch(pattern, printed)
