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


class Visits:
    """Pages, which must not complain, nor ask for anything but the site's own files."""

    def __init__(self, browser):
        self.browser, self.all = browser, []

    def open(self, url, **options):
        watched = Watched(self.browser, url, offline=False, **options)
        self.all.append((url, watched))
        return watched.page

    def check(self):
        for url, watched in self.all:
            own = url[: url.index("/", 8) + 1] if url.startswith("http") else "file://"
            ours = ("data:", "blob:", own)
            assert [each for each in watched.requests if not each.startswith(ours)] == []
            assert watched.complaints == []

    def close(self):
        for _, watched in self.all:
            watched.context.close()


@pytest.fixture
def opened(browser):
    """Opens a page, and checks at the end what all of them did."""
    visits = Visits(browser)
    yield visits.open
    visits.close()
    visits.check()


# To load a page takes longer than all that is asked of it.
@pytest.fixture(scope="module")
def visited(browser, address, request):
    """A page of the site and its colour scheme, for tests of several sizes."""
    name, scheme = request.param
    visits = Visits(browser)
    page = visits.open(address + name, color_scheme=scheme)
    page.wait_for_load_state("networkidle")
    yield page, scheme, visits
    visits.close()
    visits.check()


SCHEMES = [
    pytest.param((name, scheme), id=f"{name}-{scheme}")
    for name in PAGES
    for scheme in ("light", "dark")
]


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=lambda size: str(size["width"]))
@pytest.mark.parametrize("visited", SCHEMES, indirect=True)
def test_page_can_be_read(visited, size):
    page, scheme, visits = visited
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
    visits.check()


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
