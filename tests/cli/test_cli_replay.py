"""iout replay and iout evaluate --save-episode: pages, films and recordings, and bad input."""

import json
import sys
from pathlib import Path

import pytest
from PIL import Image

import trainers
from iout_marl import Recording, load_scenario, record_policy
from iout_marl.world import pin_layout

SHORT = ["--set", "episode.duration_s=100"]
K3 = ["paper/k3-fdd", *SHORT]
READ = "cannot be written: it is read by the same command"


@pytest.fixture(autouse=True)
def _working_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


@pytest.fixture(scope="module")
def run(tmp_path_factory, tiny):
    folder = tmp_path_factory.mktemp("trained") / "run"
    trainers.train(tiny(), folder, evaluation_episodes=1)
    return folder


@pytest.fixture
def episode(tmp_path):
    path = tmp_path / "episode.json"
    record_policy("paper/k3-fdd", "greedy", overrides={"episode.duration_s": 100}).save(path)
    return path


def policies_of(path):
    text = path.read_text()
    start = text.index('id="data">') + len('id="data">')
    data = json.loads(text[start : text.index("</script>", start)])
    return [each["policy"] for each in data["episodes"]]


def test_page_of_a_policy(iout, tmp_path):
    status, out, err = iout("replay", *K3, "--policy", "greedy")
    assert (status, err) == (0, "")
    assert out.startswith("replay.html: 4 slots of greedy, 0.")
    assert policies_of(tmp_path / "replay.html") == ["greedy"]


def test_run_and_code_of_ones_own_side_by_side(iout, tmp_path, run, tiny_settings):
    (tmp_path / "mine.py").write_text(
        "def still(seen):\n    return 0 * seen[..., :3].astype(int)\n"
    )
    words = ["replay", "best/k3-fdd", *tiny_settings, "--policy", run, "--policy", "mine.py:still"]
    status, _, err = iout(*words, "--out", "page.html")
    assert (status, err) == (0, "")
    assert policies_of(tmp_path / "page.html") == [run.name, "mine.py:still"]


def test_policy_beside_a_recording(iout, tmp_path, episode):
    status, out, _ = iout("replay", *K3, "--policy", "tour", "--recording", episode)
    assert status == 0
    assert out.startswith("replay.html: 4 slots of tour and greedy")
    status, out, _ = iout("replay", "--recording", episode, "--out", "alone.html")
    assert status == 0
    assert policies_of(tmp_path / "alone.html") == ["greedy"]


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_films(iout, tmp_path):
    words = ["--gif", "film.gif", "--mp4", "film.mp4", "--fps", 10]
    status, out, _ = iout("replay", *K3, "--policy", "greedy", *words)
    assert status == 0
    assert [line.split(":")[0] for line in out.splitlines()] == ["film.gif", "film.mp4"]
    assert not (tmp_path / "replay.html").exists()
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.info["duration"]) == (5, 100)
    assert (tmp_path / "film.mp4").read_bytes()[4:8] == b"ftyp"


def test_seed_draws_the_layout(iout, tmp_path):
    pages = []
    for seed in (1, 1, 2):
        words = ["--seed", seed, "--set", "nodes={kind: random, count: 4, redraw: episode}"]
        assert iout("replay", *K3, *words, "--policy", "greedy")[0] == 0
        pages.append((tmp_path / "replay.html").read_bytes())
    assert pages[0] == pages[1] != pages[2]


def test_evaluate_keeps_the_first_episode(iout, tmp_path):
    words = ["--policy", "random-walk", "--episodes", 3, "--seed", 5, "--save-episode", "kept.json"]
    assert iout("evaluate", *K3, *words)[0] == 0
    kept = Recording.load("kept.json")
    expected = record_policy(
        "paper/k3-fdd", "random-walk", 5, overrides={"episode.duration_s": 100}
    )
    assert kept.to_json() == expected.to_json()
    assert iout("replay", "--recording", "kept.json")[0] == 0


def test_evaluate_keeps_sampled_actions(iout, run, tiny_settings):
    words = ["evaluate", "best/k3-fdd", *tiny_settings, "--policy", run, "--episodes", 2]
    assert iout(*words, "--save-episode", "probable.json")[0] == 0
    assert iout(*words, "--sampled", "--save-episode", "sampled.json")[0] == 0
    probable, sampled = Recording.load("probable.json"), Recording.load("sampled.json")
    assert probable.policy == sampled.policy == str(run)
    assert probable.path.tolist() != sampled.path.tolist()


def test_evaluate_keeps_an_episode_that_was_evaluated(iout, tmp_path):
    """Whoever plays otherwise the next time, as a planner within seconds may, plays no more."""
    (tmp_path / "mine.py").write_text(
        "slots = 0\n"
        "def fickle(seen):\n"
        "    global slots\n"
        "    slots += 1\n"
        "    return 0 * seen[..., :3].astype(int) + (slots > 4)\n"
    )
    words = ["--policy", "mine.py:fickle", "--episodes", 1, "--json", "figures.json"]
    assert iout("evaluate", *K3, *words, "--save-episode", "kept.json")[0] == 0
    kept = Recording.load("kept.json")
    assert (kept.policy, kept.charged.tolist()) == ("mine.py:fickle", [[1]] * 4)
    figures = json.loads(Path("figures.json").read_text())["metrics"]
    assert kept.ages[1:].mean() == pytest.approx(figures["mean_aoi"]["mean"])


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="only some systems have /dev/full")
def test_an_episode_that_cannot_be_kept_costs_no_figures(iout):
    words = ["--policy", "greedy", "--json", "figures.json", "--save-episode", "/dev/full"]
    status, out, err = iout("evaluate", *K3, *words)
    assert (status, err) == (2, "iout: /dev/full: cannot be written: No space left on device\n")
    assert "greedy" in out
    assert json.loads(Path("figures.json").read_text())["policy"] == "greedy"


BAD = {
    "nothing": ([], "name one or two of --policy and --recording, not none"),
    "three": (
        [*K3, *["--policy", "greedy"] * 3],
        "name one or two of --policy and --recording, not 3 of them",
    ),
    "no-scenario": (["--policy", "greedy"], "--policy: needs a SCENARIO to play in"),
    "typo": (
        [*K3, "--policy", "gredy"],
        "--policy gredy: neither a baseline nor the folder of a run; did you mean 'greedy'?",
    ),
    "other-scenario": (
        ["paper/k5-fdd", "--recording", "episode.json"],
        "--recording episode.json: is of paper/k3-fdd (HASH), not of paper/k5-fdd (25da83560383)",
    ),
    "no-recording": (["--recording", "no.json"], "no.json: cannot be read: No such file"),
    "no-gif": (
        [*K3, "--policy", "greedy", "--gif", "film.mp4"],
        "Invalid value for '--gif': film.mp4: must end in .gif",
    ),
    "no-page": (
        [*K3, "--policy", "greedy", "--out", "nodes.csv"],
        "Invalid value for '--out': nodes.csv: must end in .html",
    ),
    "no-film": (
        [*K3, "--policy", "greedy", "--fps", "9"],
        "--fps: is of a film, by --gif or --mp4",
    ),
    "one-file-by-a-link": (
        [*K3, "--policy", "greedy", "--out", "link.html", "--gif", "film.gif"],
        "--out and --gif must name different files",
    ),
    "sampled": (
        [*K3, "--policy", "greedy", "--sampled"],
        "--sampled: none of the policies is a trained one",
    ),
    "over-its-input": (
        ["--recording", "episode.json", "--out", "episode.html"],
        f"episode.html: {READ}",
    ),
    "no-folder": (
        [*K3, "--policy", "greedy", "--out", "no/page.html"],
        "Invalid value for '--out': no/page.html: cannot be written: no is no folder",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(refused, tmp_path, episode, case):
    words, line = BAD[case]
    (tmp_path / "film.gif").write_text("mine")
    (tmp_path / "link.html").symlink_to("film.gif")
    (tmp_path / "episode.html").symlink_to("episode.json")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    hash_ = json.loads(episode.read_text())["scenario_hash"]
    assert refused("replay", *words).startswith(line.replace("HASH", hash_))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_what_is_no_replay_is_replaced_only_by_name(iout, refused, tmp_path):
    page = tmp_path / "replay.html"
    play = ["replay", *K3, "--policy", "greedy"]
    assert iout(*play)[0] == iout(*play)[0] == 0, "a replay may be replaced"
    page.write_text("<!DOCTYPE html><html><p>my replay</html>")
    assert refused(*play) == (
        "replay.html: is there already, and is no replay: name another file by --out"
    )
    assert "my replay" in page.read_text()
    assert iout(*play, "--out", page)[0] == 0
    page.unlink()
    page.mkdir()
    assert refused(*play).startswith("replay.html: is there already")


RANDOM = "nodes={kind: random, count: 4, redraw: run}"


def test_recordings_of_a_scenario_with_a_layout_for_each_run(iout, refused, tmp_path):
    settings = {"episode.duration_s": 100, "nodes": {"kind": "random", "count": 4}}
    own = load_scenario("paper/k3-fdd", {**settings, "nodes.redraw": "run"})
    record_policy(pin_layout(own, 7), "greedy").save("layout.json")
    faster = load_scenario(own, {"auvs.speed_m_per_s": 3})
    record_policy(pin_layout(faster, 7), "greedy").save("faster.json")
    fewer = load_scenario(own, {"nodes.count": 3})
    record_policy(pin_layout(fewer, 7), "greedy").save("fewer.json")
    data = json.loads(Path("layout.json").read_text())
    Path("damaged.json").write_text(json.dumps({**data, "scenario_yaml": "grid: 3"}))
    words = ["replay", *K3, "--set", RANDOM, "--policy", "tour", "--recording"]
    assert iout(*words, "layout.json")[0] == 0
    for other in ("faster", "fewer"):
        assert refused(*words, f"{other}.json").startswith(
            f"--recording {other}.json: is of paper/k3-fdd ("
        )
    line = refused(*words, "damaged.json")
    assert line.startswith("--recording damaged.json: scenario_yaml: ")


def test_run_of_another_scenario(refused, run, tmp_path):
    line = refused("replay", "paper/k5-fdd", "--policy", run)
    assert str(run) in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["policy.json", "scenario.yaml"])
def test_files_of_a_run_are_kept(refused, run, tiny_settings, name):
    before = (run / name).read_bytes()
    words = ["replay", "best/k3-fdd", *tiny_settings, "--policy", run, "--out"]
    assert refused(*words, run / name).endswith("must end in .html (see: iout --help)")
    Path("link.html").symlink_to(run / name)
    assert refused(*words, "link.html").endswith(f"it is a file of the run {run}")
    assert (run / name).read_bytes() == before


@pytest.mark.parametrize("module", ["imageio_ffmpeg", "matplotlib"])
@pytest.mark.parametrize("option", ["--gif", "--mp4"])
def test_films_need_their_extra(refused, monkeypatch, tmp_path, option, module):
    monkeypatch.setitem(sys.modules, module, None)
    words = ["replay", *K3, "--policy", "greedy", option, f"film.{option[2:]}"]
    assert refused(*words) == f"{option} needs {module}: pip install -e '.[film]' in the clone"
    assert list(tmp_path.iterdir()) == []


def test_pages_need_no_extra(iout, monkeypatch):
    for module in ("imageio_ffmpeg", "matplotlib", "jinja2", "plotly"):
        monkeypatch.setitem(sys.modules, module, None)
    assert iout("replay", *K3, "--policy", "greedy")[0] == 0


@pytest.mark.parametrize(
    ("words", "line"),
    [
        (["--policy", "greedy", "--policy", "tour"], "--save-episode: keeps that of one --policy"),
        (
            ["--policy", "greedy", "--json", "kept.json"],
            "--json and --save-episode must name different files",
        ),
        (
            ["--policy", "greedy", "--json", "../FOLDER/kept.json"],
            "--json and --save-episode must name different files",
        ),
        (["--policy", "greedy", "--set", "extends=1"], ""),
    ],
    ids=["two-policies", "one-file", "one-file-by-another-path", "bad-key"],
)
def test_bad_input_of_save_episode(refused, tmp_path, words, line):
    words = [word.replace("FOLDER", tmp_path.name) for word in words]
    assert refused("evaluate", *K3, *words, "--save-episode", "kept.json").startswith(line)
    assert list(tmp_path.iterdir()) == []
