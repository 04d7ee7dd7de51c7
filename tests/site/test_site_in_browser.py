"""The site in a real browser: silent, self-contained, readable on a phone and in the dark."""

import functools
import http.server
import threading

import pytest
from watched import DESKTOP, Watched

PHONE = {"width": 390, "height": 844}
PAGES = ["index.html", "scenario.html", "api.html", "model.html", "notebooks/paper_world.html"]


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_):
        """Nothing on the terminal."""


@pytest.fixture(scope="module")
def address(site):
    """Where the site is served: nothing else can be reached from the browser."""
    handler = functools.partial(Quiet, directory=site)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()


@pytest.fixture
def opened(browser):
    """Opens a page; it must not complain, nor ask for anything but the site's own files."""
    all_watched = []

    def make(url, **options):
        all_watched.append((url, Watched(browser, url, offline=False, **options)))
        return all_watched[-1][1].page

    yield make
    for url, watched in all_watched:
        watched.context.close()
        own = url[: url.index("/", 8) + 1] if url.startswith("http") else "file://"
        asked = [each for each in watched.requests if not each.startswith(("data:", "blob:", own))]
        assert asked == []
        assert watched.complaints == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=lambda size: str(size["width"]))
@pytest.mark.parametrize("name", PAGES)
def test_page_can_be_read(opened, address, name, size, scheme):
    page = opened(address + name, color_scheme=scheme)
    page.set_viewport_size(size)
    page.wait_for_load_state("networkidle")
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    assert page.locator("article h1").first.is_visible()
    colours = page.evaluate(
        "() => ['color', 'backgroundColor'].map((n) => getComputedStyle(document.body)[n])"
    )
    ink, ground = (sum(map(float, c[c.index("(") + 1 : -1].split(",")[:3])) for c in colours)
    assert (ink > ground) == (scheme == "dark")
    broken = "(image) => !image.complete || image.naturalWidth === 0"
    images = page.locator("article img")
    images.evaluate_all("(all) => all.forEach((image) => { image.loading = 'eager'; })")
    assert not any(image.evaluate(broken) for image in images.all())


@pytest.mark.parametrize("by", ["server", "disk"])
def test_search_finds_a_key(opened, address, site, by):
    page = opened(address if by == "server" else (site / "index.html").as_uri())
    page.get_by_placeholder("Search").click()
    page.keyboard.type("noise_level_db")
    page.locator(".md-search-result__item").first.wait_for()
    assert page.locator(".md-search-result__item").count() > 0


def test_equations_are_drawn_without_a_script(opened, address):
    page = opened(f"{address}model.html")
    assert page.locator("article math").count() > 10
    page.set_viewport_size(PHONE)
    reached = "(all) => all.filter((e) => { e.scrollLeft = 9; return e.scrollLeft > 0; }).length"
    assert page.locator(".equation").evaluate_all(reached) > 3, "what is wider than a phone scrolls"
    assert (
        page.locator("article math").first.evaluate("(m) => m.getBoundingClientRect().height") > 8
    )


def test_dark_mode_can_be_chosen(opened, address):
    page = opened(address, color_scheme="light")
    page.get_by_title("Dark mode").click()
    assert page.evaluate("document.body.dataset.mdColorScheme") == "slate"


def test_it_can_be_read_from_a_disk(opened, site):
    page = opened((site / "index.html").as_uri())
    page.get_by_role("link", name="The environment", exact=True).first.click()
    assert page.locator("article h1").first.inner_text().startswith("The environment")
