"""iout replay and iout evaluate --save-episode: pages, films and recordings, and bad input."""

import json
import sys

import pytest
from PIL import Image

import trainers
from iout_marl import Recording, record_policy

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
    assert policies_of(tmp_path / "page.html") == [str(run), "mine.py:still"]


def test_policy_beside_a_recording(iout, tmp_path, episode):
    status, out, _ = iout("replay", *K3, "--policy", "tour", "--recording", episode)
    assert status == 0
    assert out.startswith("replay.html: 4 slots of tour and greedy")
    status, out, _ = iout("replay", "--recording", episode, "--out", "alone.html")
    assert status == 0
    assert policies_of(tmp_path / "alone.html") == ["greedy"]


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
    "one-file": (
        [*K3, "--policy", "greedy", "--out", "film.gif", "--gif", "film.gif"],
        "--out, --gif and --mp4 must name different files",
    ),
    "sampled": (
        [*K3, "--policy", "greedy", "--sampled"],
        "--sampled: none of the policies is a trained one",
    ),
    "over-its-input": (
        ["--recording", "episode.json", "--out", "episode.json"],
        f"episode.json: {READ}",
    ),
    "no-folder": (
        [*K3, "--policy", "greedy", "--out", "no/page.html"],
        "Invalid value for '--out': no/page.html: cannot be written: no is no folder",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input(refused, tmp_path, episode, case):
    words, line = BAD[case]
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    hash_ = json.loads(episode.read_text())["scenario_hash"]
    assert refused("replay", *words).startswith(line.replace("HASH", hash_))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_run_of_another_scenario(refused, run, tmp_path):
    line = refused("replay", "paper/k5-fdd", "--policy", run)
    assert str(run) in line
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["policy.json", "scenario.yaml"])
def test_files_of_a_run_are_kept(refused, run, tiny_settings, name):
    before = (run / name).read_bytes()
    words = ["replay", "best/k3-fdd", *tiny_settings, "--policy", run, "--out", run / name]
    assert refused(*words).endswith(f"it is a file of the run {run}")
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
        (["--policy", "greedy", "--set", "extends=1"], ""),
    ],
    ids=["two-policies", "one-file", "bad-key"],
)
def test_bad_input_of_save_episode(refused, tmp_path, words, line):
    assert refused("evaluate", *K3, *words, "--save-episode", "kept.json").startswith(line)
    assert list(tmp_path.iterdir()) == []
