"""Makes the pictures beside it, of the README and the pages: `make images`.

The picture of the report keeps a fingerprint of what it was made from: a test tells when the
page has become another.
"""

from __future__ import annotations

import hashlib
import io
import itertools
import shutil
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from iout_marl import World, load_scenario
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline
from iout_marl.render import Snapshot, as_picture
from iout_marl.report.build import build_report
from iout_marl.report.document import Report
from iout_marl.report.markdown import render_markdown
from iout_marl.report.page import render_page
from iout_marl.study.results import read_results

HERE = Path(__file__).parent
TEMPLATES = HERE.parents[1] / "iout_marl" / "report" / "templates"
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


def report_picture() -> bytes:
    """The claims on the report's page in a browser, as PNG."""
    from playwright.sync_api import sync_playwright

    path = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))))
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"]
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        page_file = Path(folder) / "report.html"
        page_file.write_text(render_page(committed_report()), encoding="utf-8")
        browser = playwright.chromium.launch(executable_path=path, args=options)
        context = browser.new_context(viewport=SIZE, color_scheme="light", offline=True)
        page = context.new_page()
        page.goto(page_file.as_uri())
        page.locator("#answers").evaluate("(part) => part.scrollIntoView()")
        shown = page.screenshot()
        browser.close()
    return shown


def main() -> None:
    """Make all pictures."""
    for name in SLOTS:
        Image.fromarray(slot_picture(name)).save(HERE / f"{name}.png", optimize=True)
    made_from = PngInfo()
    made_from.add_text(MADE_FROM, fingerprint())
    shown = Image.open(io.BytesIO(report_picture())).convert("RGB")
    shown.save(HERE / "report.png", optimize=True, pnginfo=made_from)


if __name__ == "__main__":
    main()
