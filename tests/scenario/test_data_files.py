"""Files of data in scenarios: where they are looked for, what is refused, what the hash says."""

import io
import json
import os
import pickle
import re
import shutil
import zipfile
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field
from rich.console import Console
from tiny_study import TINY

from iout_marl import InputError, Trainer, load_scenario, parts
from iout_marl.scenario import data_files, sources, to_yaml
from iout_marl.scenario.data_files import DataFile
from iout_marl.scenario.data_readers import read_arrays
from iout_marl.scenario.json_schema import json_schema
from iout_marl.study import expand, load_study
from iout_marl.study.cells import Cell
from iout_marl.study.worker import run_cell
from trainers import Callback, train
from trainers.runs.folder import RunFolder

LIGHT = "hour,lux\n0,1.5\n6,2\n"
FILE = "reward: {kind: by_light, light: %s}"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch, forgotten_parts):
    """A working folder with a file of data in `data/`, and a part that takes one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").mkdir()
    (tmp_path / "data/light.csv").write_text(LIGHT)

    @parts.rewards.register("by_light", version=1)
    class ByLight(parts.Reward):
        """Light of a table."""

        class Settings(parts.Settings):
            #: The light.
            light: parts.DataFile
            #: More of it.
            others: Annotated[tuple[parts.DataFile, ...], Field(strict=False)] = ()
            night: parts.DataFile | None = None

        def setup(self, world):
            super().setup(world)
            lux = parts.read_arrays(self.settings.light)["lux"]
            self.lux = world.backend.floats(np.array([lux.max()]))

        def __call__(self, state, events):
            return {"age": -self.lux * self.xp.max(state.age, axis=-1, keepdims=True)}

    return tmp_path


def write(path, light, base="best/k3-fdd"):
    path.parent.mkdir(exist_ok=True)
    path.write_text(f"extends: {base}\n{FILE % light}\n")
    return path


def refused(source, *overrides):
    with pytest.raises(InputError) as caught:
        load_scenario(source, overrides)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_paths_count_from_the_file_that_names_them(folder):
    base = write(folder / "deep/base.yaml", "../data/light.csv")
    scenario = load_scenario(base)
    assert scenario.reward.light.contents == LIGHT.encode()
    assert load_scenario(write(folder / "other/mine.yaml", "../data/light.csv")).hash
    extending = folder / "mine.yaml"
    extending.write_text("extends: deep/base\nage: {maximum: 40}\n")
    assert load_scenario(extending).reward.light == scenario.reward.light
    assert load_scenario(folder / "mine.yaml").hash != scenario.hash


def test_overrides_count_from_the_working_folder(folder):
    (folder / "dark.csv").write_text("hour,lux\n0,0\n")
    base = write(folder / "deep/base.yaml", "../data/light.csv")
    by_text = load_scenario(base, ["reward.light=dark.csv"])
    by_mapping = load_scenario(base, {"reward.light": folder / "dark.csv"})
    assert by_text.reward.light.contents == b"hour,lux\n0,0\n"
    assert by_text == by_mapping
    mapping = {"extends": "best/k3-fdd", "reward": {"kind": "by_light", "light": "dark.csv"}}
    assert load_scenario(mapping).reward.light == by_text.reward.light
    assert load_scenario(by_text, {"age.maximum": 50}).reward.light == by_text.reward.light


def test_members_of_a_family_name_files_of_their_own(folder):
    (folder / "family/night").mkdir(parents=True)
    (folder / "family/night/n.csv").write_text("hour,lux\n0,0\n")
    (folder / "family/f.yaml").write_text(
        "extends: best/k3-fdd\nreward: {kind: by_light}\nmatrix: {axes: {time: {"
        "day: {reward.light: ../data/light.csv}, night: {reward: {light: night/n.csv}}}},"
        " cases: [{when: {time: day}, set: {reward.others: [night/n.csv]}}]}\n"
    )
    day, night = (load_scenario(f"family/f/{name}") for name in ("day", "night"))
    assert day.reward.light.contents == LIGHT.encode()
    assert night.reward.light == day.reward.others[0]


def test_bundled_files_are_found_by_their_names(folder, monkeypatch):
    root = folder / "bundled"
    (root / "data").mkdir(parents=True)
    (root / "data/noon.csv").write_text("hour,lux\n12,9\n")
    monkeypatch.setattr(data_files, "bundled_root", lambda: root)
    scenario = load_scenario("best/k3-fdd", {"reward": {"kind": "by_light", "light": "noon.csv"}})
    assert scenario.reward.light.path == "noon.csv"
    own = write(folder / "mine.yaml", "noon.cvs")
    assert "'noon.csv'" in refused(own)
    shutil.copy(root / "data/noon.csv", folder / "noon.csv")
    assert load_scenario(write(own, "noon.csv")).reward.light.path == str(folder / "noon.csv")


def test_bundled_data_lies_in_the_wheel_with_the_scenarios():
    assert data_files.bundled_root is sources.bundled_root


def test_the_hash_is_that_of_the_contents(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"))
    shutil.copy("data/light.csv", "copy.csv")
    other = load_scenario(write(folder / "b.yaml", "copy.csv"), {"name": "a"})
    assert other == scenario
    assert other.hash == scenario.hash
    assert other.world_hash == scenario.world_hash
    (folder / "copy.csv").write_text(LIGHT + "12,3\n")
    changed = load_scenario(folder / "b.yaml", {"name": "a"})
    assert changed != scenario
    assert changed.hash != scenario.hash
    assert hash(scenario.reward) == hash(other.reward)


def test_files_in_lists_and_beside_nothing(folder):
    (folder / "o.csv").write_text("a\n1\n")
    path = folder / "a.yaml"
    path.write_text(
        "extends: best/k3-fdd\nreward:\n  kind: by_light\n  light: data/light.csv\n"
        "  others: [o.csv,\n    gone.csv]\n  night: null\n"
    )
    assert refused(path).startswith("a.yaml:6: reward.others[1]: no file 'gone.csv'")
    scenario = load_scenario(path, {"reward.others": ["o.csv"], "reward.night": "o.csv"})
    names = [file.name for file in data_files.data_files(scenario)]
    assert names == [
        "light.csv",
        "o.csv",
        "o.csv",
    ]


def test_scenarios_carry_contents_to_other_processes(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"))
    sent = pickle.dumps(scenario)
    (folder / "data/light.csv").unlink()
    arrived = pickle.loads(sent)
    assert arrived == scenario
    assert arrived.reward.light.contents == LIGHT.encode()
    assert arrived.hash == scenario.hash


def test_show_prints_path_and_digest_that_is_read_back(folder, iout):
    path = write(folder / "a.yaml", "data/light.csv")
    scenario = load_scenario(path)
    _, shown, _ = iout("show", path)
    assert f"sha256: {scenario.reward.light.sha256}" in shown
    assert f"path: {folder / 'data/light.csv'}" in shown
    (folder / "again.yaml").write_text(shown)
    assert load_scenario(folder / "again.yaml") == scenario
    _, explained, _ = iout("show", path, "--explain")
    assert "path of a file; or mapping" in explained
    assert scenario.reward.light.sha256[:12] in explained


def test_other_contents_than_written_are_refused(folder):
    digest = load_scenario(write(folder / "a.yaml", "data/light.csv")).reward.light.sha256
    path = write(folder / "b.yaml", f"{{path: data/light.csv, sha256: {digest}}}")
    assert load_scenario(path).reward.light.sha256 == digest
    (folder / "data/light.csv").write_text(LIGHT + "12,3\n")
    assert re.fullmatch(
        r"b\.yaml:2: reward\.light: data/light\.csv: has other contents than when this was "
        rf"written: its SHA-256 begins with [0-9a-f]{{12}}, not {digest[:12]}",
        refused(path),
    )


def test_the_schema_for_editors_knows_files():
    (part,) = (
        p
        for p in json_schema()["$defs"]["reward"]["oneOf"]
        if p.get("title") == "by_light" and "properties" in p
    )
    first, second = part["properties"]["light"]["anyOf"]
    assert first == {"type": "string", "format": "path"}
    assert second["properties"].keys() == {"path", "sha256"}


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("gone.csv", "reward.light: no file 'gone.csv' in ., nor among the bundled ones"),
        ("data/ligth.csv", "did you mean 'light.csv'?"),
        ("data", "reward.light: data: it is a folder"),
        ('""', "must be the path of a file, not an empty text"),
        ("3", "must be the path of a file, or {path: …, sha256: …}, not 3"),
        ("[data/light.csv]", "must be the path of a file"),
        ("{pth: data/light.csv}", "must be the path of a file"),
        ("{path: data/light.csv, sha256: 12}", "sha256: must be 64 hexadecimal digits, not 12"),
        ('"a\\0b"', "no file 'a\\x00b'"),
        ("~nobody-of-that-name/x.csv", "no file '~nobody-of-that-name/x.csv'"),
    ],
    ids=["missing", "typo", "folder", "empty", "number", "list", "key", "digest", "null", "user"],
)
def test_what_names_no_file_is_refused(folder, written, message):
    told = refused(write(folder / "a.yaml", written))
    assert told.startswith("a.yaml:2: reward.light: ")
    assert message in told


@pytest.mark.posix
def test_pipes_are_refused(folder):
    os.mkfifo("pipe.csv")
    assert "it is a pipe or a device" in refused(write(folder / "a.yaml", "pipe.csv"))


def test_files_that_are_too_large_are_refused(folder, monkeypatch):
    monkeypatch.setattr(data_files, "MAX_BYTES", 8)
    assert "is larger than" in refused(write(folder / "a.yaml", "data/light.csv"))


def test_overrides_say_where_they_are(folder):
    path = write(folder / "a.yaml", "data/light.csv")
    assert refused(path, "reward.light=x.csv").startswith(
        "--set reward.light=x.csv: reward.light: no file 'x.csv' in ."
    )


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def damaged(position):
    data = bytearray(npz(a=np.arange(1000.0)))
    data[position] ^= 255
    return bytes(data)


def zipped(**members):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in members.items():
            archive.writestr(f"{name}.npy", data)
    return stream.getvalue()


def header(shape):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(
        stream, {"descr": "<f8", "fortran_order": False, "shape": shape}
    )
    return stream.getvalue()


def test_csv_and_npz_are_read():
    csv = b"\xef\xbb\xbf# of a tool\n\nrange_m, loss_db\n1,2.5\n\n# end\n 3 ,-1e2\n"
    columns = read_arrays(DataFile("x.CSV", csv))
    assert {key: list(value) for key, value in columns.items()} == {
        "range_m": [1, 3],
        "loss_db": [2.5, -100],
    }
    turned = np.asfortranarray(np.arange(6, dtype=">i2").reshape(2, 3))
    arrays = read_arrays(DataFile("x.npz", npz(a=turned, b=np.float32(2))))
    assert arrays["a"].tolist() == [[0, 1, 2], [3, 4, 5]]
    assert arrays["a"].dtype == arrays["b"].dtype == np.float64
    assert not arrays["a"].flags.writeable
    missing = read_arrays(DataFile("x.csv", b"a\nnan\n"), allow_nan=True)
    assert np.isnan(missing["a"]).all()
    assert np.isnan(read_arrays(DataFile("x.npz", npz(a=[np.nan])), allow_nan=True)["a"]).all()


@pytest.mark.parametrize(
    ("name", "contents", "message"),
    [
        ("x.txt", b"a\n1\n", "must be a .npz or a .csv file, by its name"),
        ("x.csv", b"", "is empty: a line of names and at least one of numbers are needed"),
        ("x.csv", b"a,b\n", "is empty"),
        ("x.csv", b"1,2\n3,4\n", "the first line must name the columns, not '1'"),
        ("x.csv", b"a,a\n3,4\n", "two columns are called 'a'"),
        ("x.csv", b"a,b\n3\n", "line 2: has 1 values for 2 columns"),
        ("x.csv", b"a\n1\n\nx\n", "line 4: a: must be a number, not 'x'"),
        ("x.csv", b"a\n1_0\n", "line 2: a: must be a number, not '1_0'"),
        ("x.csv", b"a\nnan\n", "line 2: a: must be a finite number, not nan"),
        ("x.csv", b"a\n-inf\n", "line 2: a: must be a finite number, not -inf"),
        ("x.csv", b"\xff\xfe", "is no CSV: not UTF-8 text"),
        ("x.csv", b'a\n"1', "is no CSV"),
        ("x.npz", b"", "is no npz file, or a damaged one"),
        ("x.npz", npz(a=np.arange(1000.0))[:-30], "is no npz file, or a damaged one"),
        ("x.npz", damaged(200), "is no array of NumPy"),
        ("x.npz", damaged(900), "is no npz file, or a damaged one"),
        ("x.npz", zipped(), "is empty: it holds no array"),
        ("x.npz", zipped(a=b"text"), "a: is no array of NumPy"),
        ("x.npz", npz(a=np.array([{}])), "a: holds Python objects, which could run any code"),
        ("x.npz", npz(a=np.array(["x"])), "a: must hold numbers, not <U1"),
        ("x.npz", npz(a=np.array([1j])), "a: must hold numbers, not complex128"),
        ("x.npz", npz(a=np.zeros((0, 3))), "a: is empty, of shape (0, 3)"),
        ("x.npz", npz(a=[[1.0, np.nan]]), "a[0, 1]: must be a finite number, not nan"),
        ("x.npz", npz(a=np.inf), "a[]: must be a finite number, not inf"),
        ("x.npz", zipped(a=header((10**12,)) + bytes(8)), "a: is damaged: its size is not that"),
        ("x.npz", zipped(a=bytes(9 * 10**7)), "is too large"),
    ],
)
def test_files_of_other_formats_are_refused(name, contents, message):
    with pytest.raises(InputError) as caught:
        read_arrays(DataFile(name, contents))
    assert str(caught.value).startswith(f"{name}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_runs_hold_copies_and_refuse_other_contents(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"), TINY)
    Trainer(scenario).save("run")
    (folder / "data/light.csv").unlink()
    shutil.move("run", "moved")
    (copy,) = (folder / "moved").glob("data-*")
    assert copy.read_text() == LIGHT
    run = RunFolder("moved")
    assert run.scenario() == scenario
    assert run.load_policy()
    Trainer(run.scenario()).save("again")
    assert [path.name for path in (folder / "again").glob("data-*")] == [copy.name]
    copy.write_text(LIGHT + "12,3\n")
    with pytest.raises(InputError, match=r"moved.scenario\.yaml:\d+: reward\.light: .* has other "):
        run.scenario()
    copy.unlink()
    with pytest.raises(InputError, match=r"moved.scenario\.yaml:\d+: reward\.light: no file"):
        run.scenario()


def test_runs_hold_copies_before_their_first_save(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"), TINY)
    found = []

    class Look(Callback):
        def on_start(self, training):
            found.extend(path.read_text() for path in training.runs[0].path.glob("data-*"))
            found.append((training.runs[0].path / "scenario.yaml").exists())

    train(scenario, "run", console=Console(quiet=True), callbacks=[Look()], evaluation_episodes=1)
    assert found == [LIGHT, False]


@pytest.mark.slow
def test_cells_of_a_study_carry_contents_and_bring_copies_back(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"), TINY)
    cell = pickle.dumps(Cell("g", "s", 1, scenario, "ppo", seed=0, episodes=1))
    (folder / "data/light.csv").unlink()
    output = run_cell(pickle.loads(cell), 0.0)
    assert output.record.scenario_hash == scenario.hash
    assert LIGHT.encode() in output.run.values()


def test_paths_in_a_study_count_from_its_file(folder):
    (folder / "studies").mkdir()
    settings = {**TINY, "reward": {"kind": "by_light", "light": "../data/light.csv"}}
    group = {"scenarios": ["best/k3-fdd"], "policies": ["greedy"], "seeds": [0], "episodes": 1}
    study = {"title": "Light", "groups": {"all": {**group, "settings": settings}}}
    (folder / "studies/s.yaml").write_text(json.dumps(study))
    (cell,) = expand(*load_study("studies/s.yaml"))
    assert cell.scenario.reward.light.contents == LIGHT.encode()


def test_yaml_names_files_as_asked(folder):
    scenario = load_scenario(write(folder / "a.yaml", "data/light.csv"))
    assert "path: X\n" in to_yaml(scenario, lambda file: "X")
