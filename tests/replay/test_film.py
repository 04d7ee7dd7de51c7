"""Films: every slot is a frame, drawn quickly, and players open them."""

from dataclasses import replace

import gymnasium
import imageio_ffmpeg
import numpy as np
import pytest
from PIL import Image

from iout_marl import InputError, record_policy
from iout_marl.render import as_picture
from iout_marl.render.film import write_film
from iout_marl.replay.film import TRAIL_SLOTS, frame, frames

SHORT = {"episode.duration_s": 100}
#: imageio-ffmpeg leaves pipes to ffmpeg to be closed by Python.
pytestmark = [
    pytest.mark.slow,
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]


@pytest.fixture(scope="module")
def recordings():
    names = ("tour", "greedy")
    return [record_policy("multi/m2-k10-fdd", name, overrides=SHORT) for name in names]


@pytest.fixture(scope="module")
def pictures(recordings):
    return list(frames(recordings[:1]))


def read_mp4(path):
    read = imageio_ffmpeg.read_frames(str(path))
    about = next(read)
    size = about["size"][::-1]
    return about, [np.frombuffer(each, dtype=np.uint8).reshape(*size, 3) for each in read]


def read_gif(path):
    with Image.open(path) as film:
        about = {"fps": 1000 / film.info["duration"], "size": film.size, "loop": film.info["loop"]}
        found = []
        for i in range(film.n_frames):
            film.seek(i)
            found.append(np.asarray(film.convert("RGB")))
    return about, found


READERS = {"gif": read_gif, "mp4": read_mp4}


@pytest.mark.parametrize("ending", READERS)
def test_film_shows_every_slot(tmp_path, pictures, ending):
    path = tmp_path / f"film.{ending}"
    write_film(path, iter(pictures), 5)
    about, found = READERS[ending](path)
    assert len(found) == len(pictures) == 5  # the start, and four slots
    assert about["fps"] == 5
    assert about["size"] == (960, 600)
    for shown, picture in zip(found, pictures, strict=True):
        off = np.abs(shown.astype(int) - picture)
        assert off.mean() < 3
        others = [np.abs(shown.astype(int) - other).mean() for other in pictures]
        assert np.argmin(others) in [i for i, p in enumerate(pictures) if p is picture]


def test_frames_have_trails(recordings, pictures):
    recording = recordings[0]
    moved = np.flatnonzero((recording.path[1:] != recording.path[:-1]).any((1, 2)))[0] + 1
    assert not np.array_equal(pictures[moved], as_picture(recording.snapshot(moved)))
    assert np.array_equal(pictures[0], as_picture(recording.snapshot(0)))


def test_two_stand_side_by_side(recordings):
    *_, last = frames(recordings)
    assert last.shape == (600, 1920, 3)
    assert not np.array_equal(last[:, :960], last[:, 960:])


def test_other_endings_and_places_are_refused(tmp_path, pictures):
    with pytest.raises(InputError, match=r"film\.avi: a film is a \.gif or an \.mp4"):
        write_film(tmp_path / "film.avi", iter(pictures), 5)
    with pytest.raises(InputError, match="cannot be written"):
        write_film(tmp_path / "nowhere" / "film.gif", iter(pictures), 5)
    assert list(tmp_path.iterdir()) == []


def test_a_film_that_fails_leaves_the_one_before(tmp_path, pictures):
    path = tmp_path / "film.gif"
    path.write_bytes(b"before")

    def broken():
        yield pictures[0]
        raise InputError("the second frame fails")

    with pytest.raises(InputError, match="the second frame"):
        write_film(path, broken(), 5)
    assert path.read_bytes() == b"before"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.filterwarnings("ignore::DeprecationWarning")
def test_gymnasium_records_videos(tmp_path):
    env = gymnasium.make(
        "iout_marl:AUV-v0", scenario="paper/k3-fdd", overrides=SHORT, render_mode="rgb_array"
    )
    env = gymnasium.wrappers.RecordVideo(env, str(tmp_path / "videos"), disable_logger=True)
    env.reset(seed=0)
    over = False
    while not over:
        *_, over, _ = env.step(env.action_space.sample())
    env.close()
    (path,) = tmp_path.glob("videos/*.mp4")
    about, found = read_mp4(path)
    assert len(found) == 5
    assert about["size"] == (960, 600)
    assert about["fps"] == env.metadata["render_fps"]


def test_energies_side_by_side_have_one_axis(recordings):
    own = recordings[0]
    richer, end = replace(own, energy_j=5 * own.energy_j), own.slots
    trail = own.path[max(end - TRAIL_SLOTS, 0) : end]
    alone, beside = (
        as_picture(own.snapshot(end), trail, most_j)
        for most_j in (0.0, float(richer.energy_j[end].max()))
    )
    shown = frame([own, richer], end)[60:, :960]  # below the title
    assert np.array_equal(shown, beside[60:])
    assert not np.array_equal(shown, alone[60:])
