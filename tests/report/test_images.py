"""The pictures of the README and the pages are what the software shows today."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from iout_marl import load_scenario, record_policy
from iout_marl.replay.film import frame

IMAGES = Path(__file__).parents[2] / "docs" / "images"


def load():
    spec = importlib.util.spec_from_file_location("make_images", IMAGES / "make.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


make = load()


def test_every_picture_is_made_by_the_command():
    pictures = {path.stem for path in IMAGES.glob("*.png")}
    assert pictures == {*make.SLOTS, "report", "replay"}
    assert "docs/images/make.py" in (IMAGES.parents[1] / "Makefile").read_text()


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "made_from"),
    [("report", make.fingerprint), ("replay", make.replay_fingerprint)],
    ids=["report", "replay"],
)
def test_picture_of_a_page_is_fresh(name, made_from):
    picture = Image.open(IMAGES / f"{name}.png")
    assert picture.size == tuple(make.SIZE.values())
    assert picture.text[make.MADE_FROM] == made_from(), "run `make images`"


@pytest.mark.slow
def test_film_is_of_the_trained_policy_and_fresh():
    episode = make.trained_episode()
    scenario = load_scenario(make.TRAINED)
    assert (episode.policy, episode.scenario_hash) == ("PPO", scenario.hash)
    assert episode.slots == scenario.num_slots
    best = min(record_policy(scenario, name).ages[1:].mean() for name in ("greedy", "round-robin"))
    assert episode.ages[1:].mean() < 0.6 * best, "it is trained"
    with Image.open(make.FILM) as film:
        assert film.n_frames == episode.slots + 1
        for place in (0, 40, 100):
            film.seek(place)
            shown = np.asarray(film.convert("RGB"), dtype=float)
            drawn = frame([episode], place)
            assert np.abs(shown - drawn).mean() < 3, "run `make images`"
    assert make.FILM.stat().st_size < 2e6
    readme = (IMAGES.parents[1] / "README.md").read_text()
    assert readme.index("docs/images/trained.gif") < readme.index("```"), "README opens with it"
