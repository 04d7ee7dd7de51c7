"""The report's page in a real browser: drawn, silent, self-contained, readable everywhere."""

import io
import itertools
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from report_sample import ANSWERS, FIGURES, NODES, SAMPLE, TRAJECTORY
from watched import DESKTOP, PHONE, Watched

from iout_marl.report.build import build_report
from iout_marl.report.document import Table
from iout_marl.report.figure import Plot
from iout_marl.report.page import render_page
from iout_marl.study.results import read_results

ROOT = Path(__file__).parents[2]
PLOTS = [figure for figure in FIGURES if isinstance(figure, Plot)]


@pytest.fixture(scope="module")
def page_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render_page(SAMPLE), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def opened(browser, page_file):
    watched = Watched(browser, page_file.as_uri(), color_scheme="light")
    watched.page.evaluate("window.reportReady")
    yield watched
    watched.context.close()


@pytest.fixture
def page(opened):
    """The page as on a light desktop. Whatever a test does, the page must not complain."""
    opened.page.set_viewport_size(DESKTOP)
    opened.page.emulate_media(color_scheme="light", media="screen")
    wait_until(opened.page, "() => document.documentElement.dataset.theme === 'light'")
    yield opened.page
    assert opened.complaints == []


def test_page_asks_for_nothing_but_itself(page, opened, page_file):
    others = [url for url in opened.requests if not url.startswith(("data:", "blob:"))]
    assert others == [page_file.as_uri()]


def test_every_figure_is_interactive(page):
    assert page.locator(".js-plotly-plot").count() == len(FIGURES)
    assert page.locator(".undrawn").count() == 0


@pytest.mark.parametrize("plot", PLOTS, ids=lambda plot: plot.key)
def test_every_line_and_bar_is_drawn(page, plot):
    drawn = page.locator(f"[id='plot-{plot.key}']")
    if plot.x.is_categorical:
        shapes = drawn.locator(".barlayer .point > path")
        expected = sum(len(line.y) for line in plot.lines)
    else:
        # A band is an outline of no width.
        shapes = drawn.locator(".scatterlayer path.js-line:not([style*='stroke-width: 0px'])")
        expected = len(plot.lines)
    paths = [shape.get_attribute("d") for shape in shapes.all()]
    assert sum(bool(path) and len(path) > 8 for path in paths) == expected
    assert len(set(paths)) == expected


def test_points_without_an_interval_have_no_error_bar(page):
    for plot in PLOTS:
        if plot.key not in ("fig5-nodes", "fig6-energy"):
            continue
        known = sum(low == low for line in plot.lines for low in line.low)
        bars = page.locator(f"[id='plot-{plot.key}'] .errorbar path.yerror")
        assert sum(len(bar.get_attribute("d") or "") > 0 for bar in bars.all()) == known


def test_plots_follow_the_width_of_their_place(page):
    page.evaluate("document.querySelector('main').style.width = '320px'")
    wait_until(
        page,
        "() => [...document.querySelectorAll('.js-plotly-plot .main-svg')].every("
        "(plot) => plot.getBoundingClientRect().width <= 320)",
    )
    page.evaluate("document.querySelector('main').style.width = ''")


def test_trajectory_is_drawn_in_three_dimensions(page):
    figure = page.locator(f"#plot-{TRAJECTORY.key}")
    figure.scroll_into_view_if_needed()
    assert "WebGL" not in figure.inner_text()
    canvas = figure.locator("canvas").first
    pixels = np.asarray(Image.open(io.BytesIO(canvas.screenshot())).convert("HSV"))
    colourful = pixels[..., 0][(pixels[..., 1] > 120) & (pixels[..., 2] > 80)]
    assert colourful.size > 1000, "no path"
    assert len(np.unique(colourful // 16)) >= 5, "path is not coloured by slot"


SIZES = [DESKTOP, {"width": 1024, "height": 768}, {"width": 390, "height": 844}, PHONE]


@pytest.mark.parametrize(
    ("size", "theme"),
    list(zip(SIZES, itertools.cycle(["light", "dark"]))),
    ids=lambda each: each if isinstance(each, str) else str(each["width"]),
)
def test_page_never_scrolls_sideways_and_nothing_is_hidden(page, size, theme):
    page.emulate_media(color_scheme=theme)
    page.set_viewport_size(size)
    page.wait_for_timeout(300)
    wait_for_plots(page)
    widths = page.evaluate("[document.documentElement.scrollWidth, innerWidth]")
    assert widths[0] <= widths[1] == size["width"]
    # What is wider scrolls by itself or is not there; `overflow: hidden` would hide a fault.
    assert page.evaluate("getComputedStyle(document.body).overflowX") == "visible"
    for plot in page.locator(".js-plotly-plot .main-svg").all():
        assert plot.bounding_box()["width"] <= size["width"]
    assert unreachable(page) == []


def unreachable(page):
    """Tables whose last cells cannot be seen, however one scrolls."""
    return page.evaluate(
        """() => [...document.querySelectorAll(".scroll")].flatMap((box) => {
            const outer = box.getBoundingClientRect(), cells = box.querySelectorAll("th, td");
            if (outer.left < 0 || outer.right > innerWidth) return [box.textContent];
            box.scrollLeft = box.scrollWidth;
            const right = Math.max(...[...cells].map((c) => c.getBoundingClientRect().right));
            box.scrollLeft = 0;
            return right > outer.right + 1 ? [box.textContent] : [];
        })"""
    )


def test_tables_of_the_papers_report_fit_on_a_desktop(browser, tmp_path):
    made = build_report(read_results(ROOT / "docs" / "results" / "results.json"))
    tables = tuple(
        replace(section, items=tuple(i for i in section.items if isinstance(i, Table)))
        for section in made.sections
    )
    path = tmp_path / "report.html"
    path.write_text(render_page(replace(made, sections=tables)), encoding="utf-8")
    watched = Watched(browser, path.as_uri())
    wide = "(box) => box.scrollWidth > box.clientWidth ? [box.textContent] : []"
    found = f"[...document.querySelectorAll('.scroll')].flatMap({wide})"
    assert watched.page.locator(".scroll").count() > 8
    assert watched.page.evaluate(found) == []
    watched.page.set_viewport_size({"width": 390, "height": 844})
    assert unreachable(watched.page) == []
    assert watched.page.evaluate("document.documentElement.scrollWidth") == 390
    watched.context.close()


def rgb(text):
    return tuple(float(part) for part in re.findall(r"[\d.]+", text)[:3])


def contrast(first, second):
    """Contrast of two CSS colours, according to WCAG 2."""

    def luminance(colour):
        parts = (part / 255 for part in rgb(colour))
        red, green, blue = (
            part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts
        )
        return 0.2126 * red + 0.7152 * green + 0.0722 * blue

    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def colours(page):
    """Ground, and the colours of texts on it, of the page and of each flat plot."""
    return page.evaluate(
        """() => ({
        ground: getComputedStyle(document.documentElement).backgroundColor,
        texts: ["body", "figcaption p", "a[download]", ".contents a", "dt"].map(
            (name) => getComputedStyle(document.querySelector(name)).color),
        plots: [...document.querySelectorAll(".xtick text, .xtitle, .legendtext")].map(
            (text) => getComputedStyle(text).fill),
        scenes: [...document.querySelectorAll(".space .js-plotly-plot")].map(
            (plot) => plot._fullLayout.scene.xaxis.tickfont.color),
        badges: [...document.querySelectorAll(".badge")].map((badge) => {
            const style = getComputedStyle(badge);
            return [style.color, style.backgroundColor];
        }),
        marked: ["color", "backgroundColor"].map(
            (name) => getComputedStyle(document.querySelector(".marked"))[name]),
        })"""
    )


def wait_until(page, function):
    """Wait for a function of the page to be true."""
    # Playwright's own wait evaluates texts, which the page's security policy forbids.
    for _ in range(600):
        if page.evaluate(function):
            return
        page.wait_for_timeout(100)
    pytest.fail(f"not within a minute: {function}")


def wait_for_plots(page):
    """Wait until all plots have taken the theme of the page, and have been drawn in it."""
    wait_until(
        page,
        """() => {
        const all = (name) => document.querySelectorAll(name);
        const ink = getComputedStyle(document.body).color;
        const told = getComputedStyle(document.documentElement).getPropertyValue("--ink").trim();
        const drawn = [...all("figure:not(.space) .plot")].every((plot) => {
            const texts = [...plot.querySelectorAll(".xtick text, .xtitle, .legendtext")];
            return plot.querySelector(".xtitle") && plot.querySelector(".xtick text")
                && texts.every((text) => getComputedStyle(text).fill === ink);
        });
        return drawn && [...all(".js-plotly-plot")].every(
            (plot) => plot._fullLayout.font.color === told);
        }""",
    )


def assert_legible(found):
    for text in found["texts"] + found["plots"]:
        assert contrast(text, found["ground"]) >= 4.5
    for text, ground in [*found["badges"], found["marked"]]:
        assert contrast(text, ground) >= 4.5


def test_dark_and_light_are_legible_and_plots_follow(page):
    wait_for_plots(page)
    light = colours(page)
    page.emulate_media(color_scheme="dark")
    wait_for_plots(page)
    dark = colours(page)
    assert contrast(light["ground"], "rgb(0, 0, 0)") > 15
    assert contrast(dark["ground"], "rgb(255, 255, 255)") > 15
    for found in (light, dark):
        assert len(found["plots"]) > 20
        assert_legible(found)
    assert set(light["plots"]).isdisjoint(dark["plots"])
    assert light["scenes"] != dark["scenes"]
    page.emulate_media(color_scheme="light")
    wait_for_plots(page)


def test_chosen_theme_is_kept(browser, tmp_path):
    # To draw figures takes long, and one will do.
    others = [figure for figure in FIGURES if figure is not NODES]
    sections = [
        replace(section, items=tuple(item for item in section.items if item not in others))
        for section in SAMPLE.sections
    ]
    path = tmp_path / "report.html"
    path.write_text(render_page(replace(SAMPLE, sections=tuple(sections))), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    page = watched.page
    page.evaluate("window.reportReady")
    page.get_by_role("button", name="Dark theme").click()
    wait_for_plots(page)
    assert contrast(colours(page)["ground"], "rgb(255, 255, 255)") > 15
    page.reload()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert page.get_by_role("button", name="Light theme").is_visible()
    page.evaluate("window.reportReady")
    assert watched.complaints == []
    watched.context.close()


def test_print_shows_pictures_in_black_on_white(page):
    page.emulate_media(color_scheme="dark", media="print")
    for figure in page.locator("figure").all():
        assert figure.locator("img").is_visible()
        assert figure.locator("img").evaluate("(img) => img.complete && img.naturalWidth > 300")
        assert not figure.locator(".plot").is_visible()
    for name in (".contents", ".copy", ".filter", ".files"):
        assert not any(part.is_visible() for part in page.locator(name).all())
    assert contrast(colours(page)["ground"], "rgb(0, 0, 0)") > 15


def test_pictures_stand_in_where_scripts_are_off(browser, page_file):
    watched = Watched(browser, page_file.as_uri(), java_script_enabled=False)
    pictures = watched.page.locator("figure img")
    assert pictures.count() == len(FIGURES)
    assert all(picture.is_visible() for picture in pictures.all())
    for dead in (".copy", ".filter", ".theme", ".plot"):
        assert not any(part.is_visible() for part in watched.page.locator(dead).all())
    watched.context.close()


def test_filter_shows_the_claims_of_one_verdict(page):
    filters = page.get_by_role("group", name="Show claims by verdict")
    answers = page.locator(".answer")
    assert answers.count() == len(ANSWERS.answers)
    for verdict, sign in (("reproduced", "✓"), ("not reproduced", "✗"), ("not measured", "–")):
        filters.get_by_role("button").filter(has_text=f"{sign} {verdict}").click()
        shown = [a.locator("h3").inner_text() for a in answers.all() if a.is_visible()]
        assert shown == [a.claim for a in ANSWERS.answers if a.verdict == verdict]
        assert filters.locator("[aria-pressed=true]").count() == 1
    page.emulate_media(media="print")
    assert all(answer.is_visible() for answer in answers.all()), "a print lacks claims"
    page.emulate_media(media="screen")
    filters.get_by_role("button", name="All").click()
    assert all(answer.is_visible() for answer in answers.all())


def test_copy_button_copies_the_command(page, opened):
    opened.context.grant_permissions(["clipboard-read", "clipboard-write"])
    page.locator("figure .copy").first.click()
    wait_until(page, "() => document.querySelector('figure .copy').textContent === 'Copied'")
    assert page.evaluate("navigator.clipboard.readText()") == FIGURES[0].command


def test_copy_button_selects_where_copying_is_refused(page):
    page.evaluate("() => { navigator.clipboard.writeText = () => Promise.reject(Error()); }")
    page.locator("figure .copy").nth(1).click()
    wait_until(
        page,
        "() => /Copied|Selected/.test(document.querySelectorAll('figure .copy')[1].textContent)",
    )
    assert page.evaluate("String(getSelection())").strip() == FIGURES[1].command


def test_legend_is_beneath_the_plot_and_on_the_screen_of_a_phone(page):
    page.set_viewport_size(PHONE)
    page.wait_for_timeout(500)
    for plot in page.locator("figure:not(.space) .js-plotly-plot").all():
        legend, title = (plot.locator(name).bounding_box() for name in (".legend", ".xtitle"))
        outer = plot.bounding_box()
        assert legend["y"] >= title["y"] + title["height"] - 1
        assert legend["y"] + legend["height"] <= outer["y"] + outer["height"] + 1
        assert legend["x"] + legend["width"] <= PHONE["width"] + 1
