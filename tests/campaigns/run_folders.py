"""Run folders that are damaged in every way: read as if they were whole, or refused in one line.

Some still have their checksums, which see any damage; of others the checksums are gone, or those
of what was done to the files, so that whatever reads the files has to see it.
"""

import functools
import io
import json
import os
import pickle
import shutil
import tempfile
from pathlib import Path

import safetensors.torch
import torch
from rich.console import Console
from tiny_study import TINY

from campaigns.campaign import Campaign, Tally
from iout_marl import InputError, evaluate, load_scenario
from trainers import DivergedError, train
from trainers.runs import saving
from trainers.runs.loading import load_run

SEED = 3
#: What a field, or a line, or a scalar of YAML may be replaced by.
VALUES = [None, True, -1, 0, 7, 2**70, 10**400, 1.5, "", "x", [], [1], {}, {"a": 1}]
TEXTS = [
    "", "null", "[]", "3", "{", "[" * 100_000, '{"a":' * 50_000, "\0", "\N{BOM}{}", "NaN", "1e400",
    "!!foo [1]", "!!python/object/apply:os.system ['touch sprung']", "&a [*a]", "a: &a [*a, *a]",
    "? [1]\n: 2", "<<: 3", "2001-13-99", "!!binary x", "!!float x", "!!int ''", "- " * 30_000,
]  # fmt: skip
TENSORS = [
    torch.zeros(()), torch.empty(0), torch.ones(3), torch.full((2, 2), float("nan")),
    torch.tensor([2**40]), torch.tensor(True), torch.zeros(2, dtype=torch.complex64),
    torch.zeros(2).to_sparse(), torch.zeros(1).expand(10**12),
]  # fmt: skip


class Trap:
    """What leaves a file named `sprung` when a pickle of it is loaded without care."""

    def __reduce__(self):
        return os.system, ("touch sprung",)


@functools.cache
def scenario(steps=240):
    changes = {**TINY, "training.steps": steps, "training.checkpoint_steps": 80}
    return load_scenario(load_scenario("best/k3-fdd", changes))


def _quietly(folder, steps=240, **options):
    quiet = {"console": Console(file=io.StringIO()), "evaluation_episodes": 2}
    return train(scenario(steps), folder, SEED, **quiet, **options)


@functools.cache
def originals():
    """Whole runs, a lone one and two of a group, and another's; a folder that is never removed."""
    folder = Path(tempfile.mkdtemp(prefix="iout-campaign-"))
    _quietly(folder / "lone")
    _quietly(folder / "group", replicas=2)
    other = load_scenario(scenario(), {"training.hidden_units": [9], "age.maximum": 12})
    train(other, folder / "other", 5, console=Console(file=io.StringIO()), evaluation_episodes=1)
    return folder


@functools.cache
def figures(name):
    """What evaluating a whole run gives, and what going on with it."""
    with tempfile.TemporaryDirectory() as folder:
        shutil.copytree(originals() / name, Path(folder) / name)
        return _evaluated(Path(folder) / _run(name)), _resumed(Path(folder) / name)


def _run(name):
    return "group/seed-4" if name == "group" else name


def _evaluated(run):
    loaded, own = load_run(run, scenario(), transfer=False)
    evaluation = evaluate(own, loaded.load_policy(), 2)
    return {name: values.tolist() for name, values in evaluation.samples.items()}


def _resumed(run):
    outcome = _quietly(run, 320, resume=True)
    return [
        {name: tensor.tolist() for name, tensor in outcome.trainer.weights(i).items()}
        for i in range(len(outcome.runs))
    ]


def _pick(rng, choices):
    return choices[int(rng.integers(len(choices)))]


def _places(data, path=()):
    if path:
        yield path
    keys = data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ()
    for key in keys:
        yield from _places(data[key], (*path, key))


def _replace(rng, data, values):
    """Replace, drop or add a value somewhere in nested mappings and lists."""
    path = _pick(rng, list(_places(data)))
    inner = data
    for key in path[:-1]:
        inner = inner[key]
    how = int(rng.integers(6))
    if how == 0 and isinstance(inner, dict):
        del inner[path[-1]]
    elif how == 1 and isinstance(inner, dict):
        inner["strange"] = _pick(rng, values)
    else:
        inner[path[-1]] = _pick(rng, values)
    return path


# What is done to a file: each gets the generator and the file, and tells what it has done.


def _flip(rng, path):
    data = bytearray(path.read_bytes())
    places = rng.integers(0, 8 * len(data), int(rng.integers(1, 4)))
    for place in places:
        data[place // 8] ^= 1 << (place % 8)
    path.write_bytes(data)
    return f"bits {places.tolist()} flipped"


def _truncate(rng, path):
    data = path.read_bytes()
    kept = int(rng.integers(0, len(data)))
    path.write_bytes(data[:kept])
    return f"cut to {kept} bytes"


def _garble(rng, path):
    data = bytearray(path.read_bytes())
    start = int(rng.integers(0, len(data)))
    garbage = rng.bytes(int(rng.integers(1, 400)))
    data[start : start + len(garbage)] = garbage
    path.write_bytes(data)
    return f"{len(garbage)} bytes garbled from {start}"


def _delete(rng, path):
    path.unlink()
    return "deleted"


def _swap(rng, path):
    other = originals() / "other" / path.name
    if not other.exists():
        other = originals() / "other/checkpoint.pt"
    shutil.copy(other, path)
    return "that of another run"


def _no_file(rng, path):
    path.unlink()
    how = int(rng.integers(3))
    if how == 0:
        path.mkdir()
    elif how == 1:
        os.mkfifo(path)
    else:
        path.symlink_to(path.name)
    return ("a folder", "a pipe", "a link to itself")[how]


def _text(rng, path):
    text = _pick(rng, TEXTS)
    path.write_text(text, encoding="utf-8")
    return f"holds {text[:60]!r}"


def _trap(rng, path):
    how = int(rng.integers(3))
    if how == 0:
        path.write_bytes(pickle.dumps({"format": 2, "world_version": 0, "trap": Trap()}))
    elif how == 1:
        torch.save({"format": 2, "world_version": 0, "trainer": Trap()}, path)
    else:
        path.write_text("!!python/object/apply:os.system ['touch sprung']")
    return f"trap {how}"


def _inner(rng, path):
    """Change a file from within, as its format goes."""
    if path.suffix == ".pt":
        saved = torch.load(path, weights_only=True)
        place = _replace(rng, saved, [*VALUES, *TENSORS])
        torch.save(saved, path)
        return f"changed at {place}"
    if path.suffix == ".safetensors":
        weights = safetensors.torch.load_file(path)
        name = _pick(rng, sorted(weights))
        weights[name] = _pick(rng, [t for t in TENSORS[:-2] if t.is_contiguous()])
        safetensors.torch.save_file(weights, path)
        return f"changed at {name}"
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    if path.suffix == ".json" and rng.integers(2):
        data = json.loads("".join(lines))
        place = _replace(rng, data, VALUES)
        path.write_text(json.dumps(data))
        return f"changed at {place}"
    i = int(rng.integers(len(lines)))
    key, colon, _ = lines[i].partition(":")
    text = _pick(rng, TEXTS)
    lines[i] = f"{key}{colon} {text}\n" if rng.integers(2) else f"{text}\n"
    path.write_text("".join(lines), encoding="utf-8")
    return f"line {i + 1} is {lines[i][:60]!r}"


DEEDS = (_flip, _truncate, _garble, _delete, _swap, _no_file, _text, _trap, _inner, _inner, _inner)
NAMES = (*saving.NAMES, saving.MANIFEST, "metrics.jsonl")


def _seal(run, group):
    """Give what is in a run's folder checksums that fit."""
    digests = {}
    for name in saving.NAMES:
        if (run / name).is_file():
            digests[name] = saving.digest((run / name).read_bytes())
    (run / saving.MANIFEST).write_bytes(saving.Manifest(digests, group is not None).to_bytes())
    if group is not None:
        manifest = json.loads((group / saving.GROUP).read_text())
        sealed = saving.digest((run / saving.MANIFEST).read_bytes())
        manifest["files"][f"{run.name}/{saving.MANIFEST}"] = sealed
        (group / saving.GROUP).write_text(json.dumps(manifest))


def _contents(folder):
    """Of what a save consists of, and the log."""
    return {
        path.relative_to(folder): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.name in NAMES and not path.is_symlink() and path.is_file()
    }


def _damaged(rng, folder):
    """A copy of a run, damaged: its name, and what was done to it."""
    name = _pick(rng, ["lone", "lone", "group"])
    shutil.copytree(originals() / name, folder / name)
    run, group = folder / _run(name), folder / "group" if name == "group" else None
    seals = _pick(rng, ["kept", "gone", "renewed"])
    if seals == "gone":
        for manifest in (run / saving.MANIFEST, folder / name / saving.GROUP):
            manifest.unlink(missing_ok=True)
        if group is not None:
            (group / "seed-3" / saving.MANIFEST).unlink()
    files = [each for each in NAMES if (run / each).exists()]
    path = run / _pick(rng, files)
    if group is not None and seals == "kept" and rng.integers(4) == 0:
        path = group / saving.GROUP
    done = _pick(rng, DEEDS)(rng, path)
    if seals == "renewed":
        if (run / saving.MANIFEST).is_dir():
            (run / saving.MANIFEST).rmdir()
        (run / saving.MANIFEST).unlink(missing_ok=True)
        _seal(run, group)
    return name, f"{name}, checksums {seals}: {path.relative_to(folder)} {done}"


def _read(rng, name, folder, tally, case):
    """Read a damaged run by one of its readers: in order, or in one line."""
    resumes = bool(rng.integers(2))
    before = _contents(folder / name)
    try:
        if resumes:
            is_same = _resumed(folder / name) == figures(name)[1]
        else:
            is_same = _evaluated(folder / _run(name)) == figures(name)[0]
    except InputError as error:
        if not str(error).isprintable():
            tally.fault(case, "refused in more than one line")
        elif not isinstance(error, DivergedError) and _contents(folder / name) != before:
            tally.fault(case, "the refusal has changed the folder")
        else:
            tally.note("resuming refused" if resumes else "evaluation refused")
        return
    if is_same:
        tally.note("gone on with, to the same weights" if resumes else "evaluated alike")
    elif case.split(":")[0].endswith("kept"):
        tally.fault(case, "other figures, unnoticed in spite of checksums")
    else:
        tally.note("other figures, without the checksums of the save")


def run(rng, cases):
    """Damage so many run folders, and read each."""
    tally = Tally()
    torch.set_num_threads(1)
    for _ in range(cases):
        with tempfile.TemporaryDirectory() as folder:
            name, case = _damaged(rng, Path(folder))
            try:
                _read(rng, name, Path(folder), tally, case)
            except Exception as error:  # whatever is no refusal is a fault
                tally.fault(case, error)
        if Path("sprung").exists():
            Path("sprung").unlink()
            tally.fault(case, "a file has made code run")
    return tally


CAMPAIGN = Campaign("mutated run folders", cases=2_000, short=40, run=run)
