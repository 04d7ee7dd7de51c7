"""The pictures of the README and the pages are what the software shows today."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

IMAGES = Path(__file__).parents[2] / "docs" / "images"


def load():
    spec = importlib.util.spec_from_file_location("make_images", IMAGES / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


make = load()


def test_every_picture_is_made_by_the_command():
    pictures = {path.stem for path in IMAGES.glob("*.png")}
    assert pictures == {*make.SLOTS, "report"}
    assert "docs/images/make.py" in (IMAGES.parents[1] / "Makefile").read_text()


@pytest.mark.parametrize("name", make.SLOTS)
def test_picture_of_a_slot_is_fresh(name):
    kept = np.asarray(Image.open(IMAGES / f"{name}.png").convert("RGB"), dtype=float)
    drawn = make.slot_picture(name).astype(float)
    assert kept.shape == drawn.shape
    # Letters may be smoothed otherwise elsewhere.
    assert np.abs(kept - drawn).mean() < 1, "run `make images`"


def test_picture_shows_what_the_readme_says():
    (charged,), (heard,) = (
        [node for _, node, *_ in pairs]
        for pairs in (make.snapshot("k10-fdd").charging(), make.snapshot("k10-fdd").hearing())
    )
    assert charged != heard


def test_picture_of_the_report_is_fresh():
    picture = Image.open(IMAGES / "report.png")
    assert picture.size == tuple(make.SIZE.values())
    assert picture.text[make.MADE_FROM] == make.fingerprint(), "run `make images`"
