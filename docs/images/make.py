"""Makes the pictures beside it, of the README and the pages: `make images`.

Pictures of pages keep a fingerprint of what they were made from: a test tells when a page has
become another. The film is of a policy that is trained here, once, for a minute and a half: its
episode is kept beside it; where that is deleted, a policy is trained anew.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.PngImagePlugin import PngInfo

import trainers
from iout_marl import Recording, World, load_scenario, record_policy
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline
from iout_marl.render import Snapshot, as_picture
from iout_marl.render.film import write_film
from iout_marl.replay.film import frames
from iout_marl.replay.page import render_page as render_replay
from iout_marl.report.build import build_report
from iout_marl.report.document import Report
from iout_marl.report.markdown import render_markdown
from iout_marl.report.page import render_page
from iout_marl.study.results import read_results

HERE = Path(__file__).parent
PACKAGE = HERE.parents[1] / "iout_marl"
TEMPLATES = PACKAGE / "report" / "templates"
#: The film of the README and the replay: the scenario, the episode, and how fast it plays.
TRAINED = "multi/m3-k10-fdd"
EPISODE, FILM, FPS = HERE / "trained.json", HERE / "trained.gif", 5
#: The slot of the replay's picture.
REPLAYED = 46
#: Pictures of a slot: scenario, and the slot that is over. The tour plays.
SLOTS = {"k10-fdd": ("paper/k10-fdd", 62), "m3-k10-fdd": ("multi/m3-k10-fdd", 30)}
#: Where a PNG keeps the fingerprint.
MADE_FROM = "made-from"
SIZE = {"width": 1180, "height": 820}


def snapshot(name: str) -> Snapshot:
    """The slot that a picture shows."""
    scenario, slot = SLOTS[name]
    world = World(load_scenario(scenario))
    slots = play(world, make_baseline("tour"), 0)
    state, events = next(itertools.islice(slots, slot, None))
    return Snapshot.from_world(world, state, events)


def slot_picture(name: str) -> npt.NDArray[np.uint8]:
    """A picture of a slot, (height, width, 3)."""
    return as_picture(snapshot(name))


def committed_report() -> Report:
    """The report of the committed results of the paper's study."""
    return build_report(read_results(HERE.parent / "results" / "results.json"))


def fingerprint() -> str:
    """Of all that the picture of the report is made from."""
    parts = [path.read_bytes() for path in sorted(TEMPLATES.iterdir())]
    parts.append(render_markdown(committed_report(), "figures").encode())
    return hashlib.sha256(b"\0".join(parts)).hexdigest()


def trained_episode() -> Recording:
    """An episode of a policy that is trained for as long as its scenario says."""
    if EPISODE.exists():
        return Recording.load(EPISODE)
    with tempfile.TemporaryDirectory() as folder:
        outcome = trainers.train(load_scenario(TRAINED), Path(folder) / "PPO")
        recording = record_policy(TRAINED, outcome.run.load_policy())
    recording = replace(recording, policy="PPO")
    recording.save(EPISODE)
    return recording


def replay_page() -> str:
    """The replay of the trained policy beside greedy."""
    return render_replay([trained_episode(), record_policy(TRAINED, "greedy")])


def replay_fingerprint() -> str:
    """Of all that the picture of the replay is made from."""
    return hashlib.sha256(replay_page().encode()).hexdigest()


def page_picture(html: str, theme: str, prepare: str) -> bytes:
    """What a page shows in a browser, as PNG.

    Args:
        html: the page.
        theme: light or dark.
        prepare: JavaScript that brings it where it is shown.
    """
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    options += ["--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder) / "page.html"
        page_file.write_text(html)
        browser = playwright.chromium.launch(executable_path=path, args=options)
        context = browser.new_context(viewport=SIZE, color_scheme=theme, offline=True)
        page = context.new_page()
        page.goto(page_file.as_uri())
        page.evaluate(prepare)
        page.wait_for_timeout(1000)
        shown = page.screenshot()
        browser.close()
    return shown


def save_page(name: str, shown: bytes, made_from: str) -> None:
    """Keep the picture of a page, with the fingerprint of what it was made from."""
    text = PngInfo()
    text.add_text(MADE_FROM, made_from)
    image = Image.open(io.BytesIO(shown)).convert("RGB")
    image.save(HERE / f"{name}.png", optimize=True, pnginfo=text)


def main() -> None:
    """Make all pictures."""
    for name in SLOTS:
        Image.fromarray(slot_picture(name)).save(HERE / f"{name}.png", optimize=True)
    write_film(FILM, frames([trained_episode()]), FPS)
    claims = "() => document.querySelector('#answers').scrollIntoView()"
    save_page(
        "report", page_picture(render_page(committed_report()), "light", claims), fingerprint()
    )
    step = f"""() => {{
        const scrub = document.querySelector(".scrub");
        scrub.value = {REPLAYED};
        scrub.dispatchEvent(new Event("input"));
    }}"""
    save_page("replay", page_picture(replay_page(), "dark", step), replay_fingerprint())


if __name__ == "__main__":
    main()
