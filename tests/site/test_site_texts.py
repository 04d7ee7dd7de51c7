"""What the pages of the site say is so: their code runs, their studies and figures are as made."""

import importlib.util
import re
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from iout_marl import metrics, parts
from iout_marl.study.schema import load_study

DOCS = Path(__file__).parents[2] / "docs"
SPEC = importlib.util.spec_from_file_location("model_figures", DOCS / "images" / "model.py")
MODEL = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(MODEL)
CODE = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
SNIPPETS = [
    pytest.param(snippet, id=f"{path.stem}-{i}")
    for path in (DOCS / "get-started.md", DOCS / "evaluate.md")
    for i, snippet in enumerate(CODE.findall(path.read_text(encoding="utf-8")))
]


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_code_runs(snippet, capsys):
    exec(compile(snippet, "a page", "exec"), {})
    assert capsys.readouterr().out


def test_the_study_can_be_loaded(tmp_path):
    page = (DOCS / "studies.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"^```yaml\n(.*?)^```", page, flags=re.MULTILINE | re.DOTALL)
    (tmp_path / "power.yaml").write_text(text, encoding="utf-8")
    study, _ = load_study(tmp_path / "power.yaml")
    assert set(study.groups) == {"trained", "greedy"}


def test_every_figure_of_the_model_is_made_and_shown():
    made = {path.stem for path in MODEL.FOLDER.glob("*.png")}
    page = (DOCS / "model.md").read_text(encoding="utf-8")
    assert made == set(MODEL.FIGURES) == set(re.findall(r"\(images/model/(\w+)\.png\)", page))
    assert "docs/images/model.py" in (DOCS.parent / "Makefile").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("name", MODEL.FIGURES)
def test_figure_is_fresh(name):
    kept = np.asarray(Image.open(MODEL.FOLDER / f"{name}.png").convert("RGB"), dtype=float)
    drawn = MODEL.pixels(name).astype(float)
    assert kept.shape == drawn.shape
    # Colours are rounded in the file, and letters may be smoothed otherwise elsewhere.
    assert np.abs(kept - drawn).mean() < 1, "run `make images`"


def test_functions_that_the_model_names_are_there():
    page = (DOCS / "model.md").read_text(encoding="utf-8")
    names = set(re.findall(r"`(?:iout_marl\.physics\.)?([a-z]+(?:_[a-z0-9]+)+)`", page))
    known = (
        set(dir(MODEL.physics))
        | {"mean_age"}
        | {metric.name for metric in metrics.registered()}
        | set(parts.currents.kinds)
    )
    assert "harvested_power_w" in names
    assert names <= known, names - known
