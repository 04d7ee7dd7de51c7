"""The documentation site: whole, linked up, and of one source with what a code host shows."""

import html
import json
import re
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

import iout_marl
from iout_marl import envs, physics

ROOT = Path(__file__).parents[2]
#: What a page may load of itself; anything else would need a network.
LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src"}


class Links(HTMLParser):
    """The anchors of a page, its links, and what it loads."""

    def __init__(self, path):
        super().__init__()
        self.anchors, self.links, self.loaded, self.text = {""}, [], [], []
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attrs):
        named = dict(attrs)
        self.anchors |= {named[key] for key in ("id", "name") if named.get(key)}
        if tag == "a" and named.get("href") is not None:
            self.links.append(named["href"])
        is_loaded = tag != "link" or named.get("rel") not in ("canonical", "next", "prev")
        if is_loaded and named.get(LOADED.get(tag, "")):
            self.loaded.append(named[LOADED[tag]])


@pytest.fixture(scope="module")
def pages(site):
    return {path: Links(path) for path in sorted(site.rglob("*.html"))}


def test_is_made_by_make_site():
    assert "mkdocs build --strict" in (ROOT / "Makefile").read_text(encoding="utf-8")


def test_every_page_of_docs_is_on_it(site):
    sources = [path.relative_to(ROOT / "docs") for path in (ROOT / "docs").glob("*.md")]
    assert sources
    assert [s for s in sources if not (site / s).with_suffix(".html").is_file()] == []


def test_no_link_is_broken(site, pages):
    broken = []
    for path, page in pages.items():
        if path.name == "404.html":
            continue  # its links are from the root
        for link in page.links:
            parts = urlsplit(link)
            if parts.scheme in ("http", "https", "mailto", "javascript"):
                continue
            target = (path.parent / unquote(parts.path)).resolve() if parts.path else path
            if target.is_dir():
                target /= "index.html"
            anchor = unquote(parts.fragment)
            if not target.is_file() or (target in pages and anchor not in pages[target].anchors):
                broken.append(f"{path.relative_to(site)}: {link}")
    assert broken == []


def test_nothing_is_fetched_from_elsewhere(site, pages):
    for path, page in pages.items():
        assert [url for url in page.loaded if urlsplit(url).netloc] == [], path
    for style in site.rglob("*.css"):
        found = re.findall(r"url\(['\"]?(https?:[^)]*)", style.read_text(encoding="utf-8"))
        assert found == [], style


def test_files_of_the_repository_that_are_linked_are_pages(site, pages):
    shown = (site / "repository/examples/extending/policy.py.html").read_text(encoding="utf-8")
    assert "OldestFirst" in shown
    assert (site / "repository/scenarios/training/fast.yaml.html").is_file()
    assert any(
        link.endswith("repository/examples/extending/policy.py.html")
        for link in pages[site / "python.html"].links
    )


def test_no_markup_is_left_over(site):
    """A list, table or fence that one dialect of Markdown knows and the site's does not."""
    for path in site.rglob("*.html"):
        text = re.sub(r"(?s)<(pre|script|style).*?</\1>", "", path.read_text(encoding="utf-8"))
        left = re.findall(r"<p>(?:[^<]*\n)?(?:[-*] |\d+\. |\||```|\$\$).*", text)
        assert left == [], path


@pytest.mark.parametrize(
    ("page", "path"),
    [
        *(
            ("extending-examples", path)
            for path in sorted((ROOT / "examples/extending").glob("*.py"))
        ),
        ("train", ROOT / "trainers/ppo.py"),
    ],
    ids=lambda value: getattr(value, "stem", value),
)
def test_file_is_shown_in_full(site, page, path):
    shown = re.sub(r"<[^>]*>", "", (site / f"{page}.html").read_text(encoding="utf-8"))
    assert path.read_text(encoding="utf-8").strip() in html.unescape(shown)


def test_notebooks_are_kept_without_what_they_print_and_shown_with_it(site):
    notebooks = sorted((ROOT / "docs/notebooks").glob("*.ipynb"))
    assert len(notebooks) == 2
    for path in notebooks:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        code = [cell for cell in cells if cell["cell_type"] == "code"]
        assert all(not cell["outputs"] and cell["execution_count"] is None for cell in code)
        shown = (site / "notebooks" / f"{path.stem}.html").read_text(encoding="utf-8")
        assert shown.count('class="printed"') > 2
    assert "no policy has a mean AoI below" in (site / "notebooks/paper_world.html").read_text()
    assert "peak AoI" in (site / "notebooks/own_parts.html").read_text()


def test_every_public_name_is_in_the_api(pages, site):
    anchors = pages[site / "api.html"].anchors
    names = [f"iout_marl.{name}" for name in iout_marl.__all__]
    names += [f"iout_marl.physics.{name}" for name in physics.__all__ if name.islower()]
    names += [f"iout_marl.envs.{name}" for name in envs.__all__]
    later = {
        "iout_marl.Trainer": "trainers.Trainer",
        "iout_marl.bound": "iout_marl.bounds.bound.bound",
        "iout_marl.pretrained": "trainers.pretrained.pretrained",
        "iout_marl.train": "trainers.train",
    }
    lacking = [name for name in names if later.get(name, name) not in anchors]
    assert lacking == []
