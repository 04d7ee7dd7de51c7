"""A replay in a real browser: played, scrubbed, clicked, in light and dark, on a phone."""

import io
import math
import re
from dataclasses import replace

import numpy as np
import pytest
from batteries import BATTERY
from PIL import Image
from polling import polling
from watched import DESKTOP, Watched

from iout_marl import evaluate, record_policy
from iout_marl.render.style import AGE_STOPS, DATA, ENERGY, FAILED, rgba
from iout_marl.replay.page import render_page

PHONE = {"width": 390, "height": 844}
SLOTS = 24
SHORT = {"episode.duration_s": 25 * SLOTS}


@pytest.fixture(scope="module")
def recordings():
    names = ("tour", "random-walk")
    return [record_policy("multi/m2-k10-fdd", name, 3, overrides=SHORT) for name in names]


def without_webgl(page):
    """The page, to which the browser says that it has no WebGL."""
    blinded = (
        "<script>HTMLCanvasElement.prototype.getContext = ((get) => function (kind, ...rest) {"
        "return kind.startsWith('webgl') ? null : get.call(this, kind, ...rest); })"
        "(HTMLCanvasElement.prototype.getContext);</script><body>"
    )
    return page.replace("<body>", blinded, 1)


@pytest.fixture(scope="module")
def opened(browser, recordings, tmp_path_factory):
    path = tmp_path_factory.mktemp("replay") / "page.html"
    path.write_text(render_page(recordings), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    yield watched
    watched.context.close()


@pytest.fixture(scope="module")
def opened_flat(browser, recordings, tmp_path_factory):
    """Without WebGL, which is slow by software: for what does not depend on the view in space."""
    path = tmp_path_factory.mktemp("flat") / "page.html"
    path.write_text(without_webgl(render_page(recordings)), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    yield watched
    watched.context.close()


def at_start(watched):
    """The page as on a light desktop, at its start."""
    page = watched.page
    page.set_viewport_size(DESKTOP)
    page.emulate_media(color_scheme="light")
    page.evaluate("() => { document.activeElement.blur(); scrollTo(0, 0); }")
    page.keyboard.press("Escape")
    page.keyboard.press("Home")
    return page


@pytest.fixture
def page(opened):
    """The page at its start. It must not complain, nor ask for anything."""
    page = at_start(opened)
    yield page
    assert opened.complaints == []
    assert set(opened.requests) == {page.url}


@pytest.fixture
def flat_page(opened_flat):
    """The same without the view in space."""
    page = at_start(opened_flat)
    yield page
    assert opened_flat.complaints == []
    assert set(opened_flat.requests) == {page.url}


def place(page):
    return int(page.locator(".scrub").input_value())


def wait_until(page, done):
    for _ in range(300):
        if done():
            return
        page.wait_for_timeout(50)
    pytest.fail("not within a quarter of a minute")


def pixels(locator):
    return np.asarray(Image.open(io.BytesIO(locator.screenshot())).convert("RGB")).astype(int)


def near(image, colour, within=40):
    """Where an image has a colour."""
    return np.abs(image - 255 * rgba(colour)[:3]).max(axis=-1) < within


def rows(page, policy):
    table = page.get_by_role("region", name=policy).locator("table.now tbody tr")
    return [row.inner_text() for row in table.all()]


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["1280", "390"])
def test_plays_to_the_end(page, size):
    page.set_viewport_size(size)
    page.locator(".speed select").select_option("32")
    page.get_by_role("button", name="Play").click()
    wait_until(page, lambda: place(page) == SLOTS)
    wait_until(page, lambda: page.get_by_role("button", name="Play").is_visible())
    assert f"{SLOTS} / {SLOTS}" in page.locator(".clock").inner_text()
    page.get_by_role("button", name="Play").click()  # from the start once more
    wait_until(page, lambda: 0 < place(page) < SLOTS or place(page) == SLOTS)
    page.keyboard.press("Home")
    page.locator(".speed select").select_option("2")


def test_plays_without_motion_where_none_is_wanted(flat_page):
    page = flat_page
    page.emulate_media(reduced_motion="reduce")
    page.locator(".speed select").select_option("32")
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("Space")
    wait_until(page, lambda: place(page) == SLOTS)
    page.emulate_media(reduced_motion="no-preference")


def test_keys_and_buttons_step(flat_page):
    page = flat_page
    for key, expected in (
        *[("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("End", SLOTS)],
        *[("ArrowRight", SLOTS), ("Home", 0), ("ArrowLeft", 0)],
    ):
        page.keyboard.press(key)
        assert place(page) == expected
    page.get_by_role("button", name="One slot forward").click()
    page.get_by_role("button", name="One slot forward").click()
    page.get_by_role("button", name="One slot back").click()
    assert place(page) == 1
    page.get_by_role("button", name="First slot").click()
    assert place(page) == 0
    page.evaluate("() => document.activeElement.blur()")
    page.keyboard.press("Space")
    assert page.get_by_role("button", name="Pause").is_visible()
    page.keyboard.press("Space")
    assert page.get_by_role("button", name="Play").is_visible()


def test_scrub_bar_and_curves_seek(page):
    page.locator(".scrub").fill("17")
    assert page.locator(".clock b").inner_text() == f"17 / {SLOTS}"
    said = page.locator(".scrub").get_attribute("aria-valuetext")
    assert said.startswith(f"slot 17 of {SLOTS}, tour: mean AoI ")
    box = page.locator(".chart svg").first.bounding_box()
    page.locator(".chart svg").first.click(position={"x": box["width"] / 2, "y": 60})
    assert abs(place(page) - SLOTS / 2) <= 1
    bar = page.locator(".scrub").bounding_box()
    page.mouse.click(bar["x"] + 0.75 * bar["width"], bar["y"] + bar["height"] / 2)
    assert abs(place(page) - 0.75 * SLOTS) <= 1


def test_every_slot_says_what_was_chosen_and_why_it_failed(flat_page, recordings):
    page = flat_page
    seen = set()
    for slot in range(SLOTS):
        page.keyboard.press("ArrowRight")
        for recording in recordings:
            texts = rows(page, recording.policy)
            assert len(texts) == recording.num_auvs
            for auv, text in enumerate(texts):
                reason = recording.reason(slot, auv)
                seen.add(reason and reason.code)
                assert (reason.text if reason else "packet arrived") in text
                assert f"node {recording.charged[slot, auv]}:" in text
                assert f"node {recording.heard[slot, auv]}" in text
                if recording.left_grid[slot, auv]:
                    assert "edge of the grid" in text
    assert len(seen) > 1, "nothing has failed, or all has"
    for recording in recordings:
        section = page.get_by_role("region", name=recording.policy, exact=True)
        shown = section.locator("dd").all_inner_texts()
        assert shown[0] == f"{recording.ages[-1].mean():.2f}"
        assert shown[1] == f"{recording.ages[1:].mean():.2f}"
        assert shown[2] == str(recording.delivered.sum())
        arrived = f"{recording.delivered.sum()} of {recording.delivered.size} uplinks arrived"
        assert arrived in section.locator(".tally").inner_text()


def test_node_is_chosen_on_the_map_and_has_a_history(page, recordings):
    page.locator(".flat .mark").nth(4).click()
    assert page.locator(".pick").input_value() == "4"
    assert page.locator(".is-chosen").count() == 4  # of two maps each
    assert page.locator(".has-bold").count() == 4  # ages and energies
    parts = page.locator(".history")
    for recording, part in zip(recordings, parts.all(), strict=True):
        times = np.count_nonzero(recording.charged == 5) + np.count_nonzero(recording.heard == 5)
        assert part.locator("li[data-slot]").count() == times
        packets = np.count_nonzero(recording.delivered & (recording.heard == 5))
        assert f"{packets} packets" in part.locator("p").inner_text()
    parts.first.locator("li button").first.click()
    assert (
        place(page)
        == 1
        + np.flatnonzero((recordings[0].charged == 5).any(1) | (recordings[0].heard == 5).any(1))[0]
    )
    page.locator(".pick").select_option(value="-1")
    assert page.locator(".is-chosen, .has-bold, .history").count() == 0


def test_node_is_chosen_in_space(page):
    stage = page.locator(".stage canvas").first
    page.wait_for_timeout(200)
    yellow = near(pixels(stage), AGE_STOPS[0], 60)  # at the start all are young
    y, x = np.argwhere(yellow)[np.count_nonzero(yellow) // 2].tolist()
    stage.click(position={"x": x, "y": y})
    assert page.locator(".pick").input_value() != "-1"
    before = pixels(stage)
    stage.press("Shift+ArrowLeft")
    page.wait_for_timeout(200)
    assert np.abs(pixels(stage) - before).mean() > 1, "it has not turned"


def test_view_in_space_shows_energy_packets_and_losses(page, recordings):
    stage = page.locator(".stage canvas").nth(1)
    lost = np.flatnonzero(~recordings[1].delivered.all(1) & recordings[1].delivered.any(1))[0]
    page.locator(".scrub").fill(str(lost + 1))
    page.wait_for_timeout(300)
    image = pixels(stage)
    for colour in (ENERGY, DATA, FAILED):
        assert np.count_nonzero(near(image, colour)) > 30, colour


def test_dragging_turns_the_view(page):
    stage = page.locator(".stage canvas").first
    page.get_by_role("button", name="Whole grid").first.click()
    page.wait_for_timeout(200)
    box, before = stage.bounding_box(), pixels(stage)
    page.mouse.move(box["x"] + 200, box["y"] + 200)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 210, steps=4)
    page.mouse.up()
    page.wait_for_timeout(200)
    turned = pixels(stage)
    assert np.abs(turned - before).mean() > 1
    page.get_by_role("button", name="Whole grid").first.click()
    page.wait_for_timeout(200)
    assert np.abs(pixels(stage) - before).mean() < np.abs(turned - before).mean() / 4


def luminance(colour):
    parts = [int(part) / 255 for part in re.findall(r"\d+", colour)[:3]]
    parts = [p / 12.92 if p <= 0.04045 else ((p + 0.055) / 1.055) ** 2.4 for p in parts]
    return float(np.dot(parts, (0.2126, 0.7152, 0.0722)))


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_texts_are_legible_in(page, theme):
    page.emulate_media(color_scheme=theme)
    page.keyboard.press("End")
    page.locator(".flat .mark").first.click()
    ground, *texts = page.evaluate(
        """() => [getComputedStyle(document.documentElement).backgroundColor,
        ...["h1", ".facts", ".now td", ".arrived", ".lost", ".tally", "dt", "li.charged span",
            ".axis"].map((name) => {
                const style = getComputedStyle(document.querySelector(name));
                return name === ".axis" ? style.fill : style.color;
            })]"""
    )
    grounds = luminance(ground)
    assert (grounds > 0.5) == (theme == "light")
    for text in texts:
        low, high = sorted((grounds, luminance(text)))
        assert (high + 0.05) / (low + 0.05) >= 4.5, text
    image = pixels(page.locator(".stage canvas").first)
    assert (image.mean() > 127) == (theme == "light")


def test_theme_is_chosen_by_the_button(flat_page):
    page = flat_page
    page.get_by_role("button", name="Dark theme").click()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.reload()
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    page.get_by_role("button", name="Light theme").click()
    page.evaluate("localStorage.clear()")
    page.reload()


@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["1280", "390"])
def test_all_of_it_fits(page, size):
    page.set_viewport_size(size)
    page.wait_for_timeout(100)
    assert page.evaluate("document.documentElement.scrollWidth") == size["width"]
    for part in page.locator("button:visible, select, svg[role=img], canvas").all():
        box = part.bounding_box()
        assert box["x"] >= 0
        assert box["x"] + box["width"] <= size["width"] + 0.5
    # The controls stay in sight.
    box = page.locator("#transport").bounding_box()
    assert box["y"] + box["height"] <= size["height"] + 0.5


def test_everything_is_reached_by_the_keyboard_and_has_a_name(page):
    unnamed = page.evaluate(
        """() => [...document.querySelectorAll("button, select, input, [tabindex='0']")].filter(
            (part) => !(part.textContent.trim() || part.getAttribute("aria-label") ||
                part.labels?.length)).map((part) => part.outerHTML)"""
    )
    assert unnamed == []
    seen = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        name = "() => [document.activeElement.tagName, document.activeElement.className].join(' ')"
        outline = "() => getComputedStyle(document.activeElement).outlineStyle"
        seen.add(page.evaluate(name).strip())
        assert page.evaluate(outline) != "none" or "BODY" in page.evaluate(name)
    assert {"CANVAS", "SELECT pick", "INPUT scrub", "BUTTON play", "BUTTON theme"} <= seen


def test_fingers(browser, opened_flat):
    watched = Watched(browser, opened_flat.page.url, has_touch=True, is_mobile=True)
    page = watched.page
    page.set_viewport_size(PHONE)
    page.get_by_role("button", name="One slot forward").tap()
    assert place(page) == 1
    page.locator(".flat .mark").nth(2).tap()
    assert page.locator(".pick").input_value() == "2"
    page.get_by_role("button", name="Play").tap()
    wait_until(page, lambda: place(page) > 2)
    page.get_by_role("button", name="Pause").tap()
    assert watched.complaints == []
    watched.context.close()


def test_two_large_scenarios(browser, tmp_path):
    """Numbers of four digits are written, and each episode has facts of its own."""
    path = tmp_path / "page.html"
    settings = {"episode.duration_s": 50, "nodes": {"kind": "random", "count": 1000}}
    settings["grid.cells"] = [16, 16, 4]
    pair = [
        record_policy("paper/k3-fdd", "greedy", overrides=changes)
        for changes in (settings, {"episode.duration_s": 50})
    ]
    path.write_text(without_webgl(render_page(pair)), encoding="utf-8")
    watched = Watched(browser, path.as_uri())
    page = watched.page
    numbers = page.locator(".flat text.number", has_text="1000")
    assert numbers.count() == 2
    for number in numbers.all():
        assert float(number.get_attribute("font-size")) > 0
    assert "FDD" in page.locator(".top .facts").inner_text()
    shown = page.locator(".episode .facts").all_inner_texts()
    assert ["1,000 nodes" in shown[0], "3 nodes" in shown[1]] == [True, True]
    assert watched.complaints == []
    watched.context.close()


def test_maps_stand_in_where_there_is_no_webgl(flat_page):
    assert "no WebGL" in flat_page.locator(".no-space").first.inner_text()
    flat_page.keyboard.press("End")
    assert place(flat_page) == SLOTS
    assert flat_page.locator(".flat svg").first.is_visible()


def test_nodes_that_are_polled_are_told_and_counted(browser, tmp_path):
    changes = {"auvs.count": 2, "charging.power_w": 8000, "channel.access": "exclusive"}
    overrides = polling(3, **changes, **{"auvs.idle_choices": True, "episode.duration_s": 800})
    recording = record_policy("paper/k5-fdd", "random-walk", 3, overrides=overrides)
    path = tmp_path / "page.html"
    path.write_text(without_webgl(render_page([recording])), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    page = watched.page
    told = 0
    for slot in range(recording.slots):
        page.keyboard.press("ArrowRight")
        for auv, text in enumerate(rows(page, recording.policy)):
            nodes = [node for node in recording.polled[slot, auv] if node]
            _, _, polled = text.partition("Polled: ")
            assert bool(polled) == bool(nodes)
            assert [int(n) for n in re.findall(r"node (\d+) [✓✗]", polled)] == nodes
            told += len(nodes)
    assert told > 5
    arrived = int(recording.deliveries[-1].sum())
    asked = recording.asked.sum() + np.count_nonzero(recording.polled)
    assert f"{arrived} of {asked} uplinks arrived" in page.locator(".tally").inner_text()
    assert watched.complaints == []
    watched.context.close()


#: Two AUVs with batteries, which take three slots for a cell and soon lie still, and two docks.
SEA = {
    "episode": {"slot_s": 10, "duration_s": 10 * SLOTS},
    "auvs": {"count": 2, "idle_choices": True},
    "vehicle": {**BATTERY, "capacity_j": 1e5, "docks": [[5, 5, 2], [4, 5, 2]], "dock_power_w": 300},
    "storage": {"kind": "capacitor", "capacity_j": 300.0, "idle_w": 0.5},
}


@pytest.fixture(scope="module")
def sea(browser, tmp_path_factory):
    """A page of AUVs with batteries that make moves over several slots, and its recording."""
    recording = record_policy("paper/k5-fdd", "random-walk", 1, overrides=SEA)
    path = tmp_path_factory.mktemp("sea") / "page.html"
    path.write_text(render_page([recording]), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    yield watched, recording
    watched.context.close()


def test_batteries_moves_and_docks_stand_in_every_slot(sea):
    watched, recording = sea
    page, said = watched.page, set()
    page.keyboard.press("Home")
    for slot in range(recording.slots):
        page.keyboard.press("ArrowRight")
        for auv, text in enumerate(rows(page, recording.policy)):
            share, left = recording.battery[slot + 1, auv], recording.transit_slots[slot + 1, auv]
            assert f"battery {math.floor(100 * float(f'{share:.4g}') + 0.5)} %" in text
            to = ", ".join(map(str, recording.heading[slot + 1, auv]))
            assert (f"under way to ({to}), {left} slot" in text) == (left > 0)
            docked = bool(recording.snapshot(slot + 1).docked[auv])
            assert ("recharged in the dock" in text) == docked
            assert ("stranded" in text) == bool(recording.stranded[slot, auv])
            said |= {("under way", left > 0), ("docked", docked), ("stranded", "stranded" in text)}
        above = page.locator(".flat:not(.side) svg")
        assert above.locator(".course").count() == (recording.transit_slots[slot + 1] > 0).sum()
        assert above.locator(".sleeps .moon").count() == recording.asleep[slot].sum()
        hulls = [hull.get_attribute("fill") for hull in above.locator(".hull").all()]
        assert [fill == FAILED for fill in hulls] == recording.stranded[slot].tolist()
        widths = [float(bar.get_attribute("width")) for bar in above.locator("g > rect").all()]
        # A frame, and what fills it, of each AUV.
        shares = np.array(widths[1::2]) / widths[::2]
        assert shares == pytest.approx(recording.battery[slot + 1], abs=1e-3)
    assert len(said) == 6, "not all has happened, and not happened"
    assert page.locator(".flat:not(.side) svg .dock").count() == 2
    legend = page.locator(".legend").inner_text()
    assert all(word in legend for word in ("battery of an AUV", "under way to", "dock", "asleep"))
    assert watched.complaints == []


def test_an_auv_under_way_is_between_its_cells(sea):
    watched, recording = sea
    page = watched.page
    for slot in np.flatnonzero(recording.transit_slots[1:, 0])[:4].tolist():
        page.locator(".scrub").fill(str(slot + 1))
        hull = page.locator(".flat:not(.side) svg .hull").first
        x = float(
            re.search(r"translate\(([\d.]+)", hull.locator("..").get_attribute("transform"))[1]
        )
        # Ten cells are 400 units wide.
        assert x / 40 + 0.5 == pytest.approx(recording.positions()[slot + 1, 0, 0], abs=1e-3)
    assert watched.complaints == []


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["1280", "390"])
def test_the_page_of_the_sea_has_room_and_colours(sea, size, theme):
    watched, _ = sea
    page = watched.page
    page.emulate_media(color_scheme=theme)
    page.set_viewport_size(size)
    page.locator(".scrub").fill("2")
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    dock = page.locator(".legend .dock i")
    fill = dock.evaluate("(it) => getComputedStyle(it).backgroundColor")
    assert fill == {"light": "rgb(219, 227, 200)", "dark": "rgb(60, 74, 51)"}[theme]
    orange = near(pixels(page.locator(".space")), ENERGY)
    assert orange.sum() > 20, "no battery is seen in space"
    assert "Battery of every AUV" in page.locator(".charts").inner_text()
    assert watched.complaints == []


@pytest.mark.parametrize("scenario", ["multi/m2-k10-fdd", "best/k5-tdd"])
def test_an_auv_that_names_nobody_says_so_and_has_failed_in_nothing(browser, tmp_path, scenario):
    overrides = {**SHORT, "auvs.idle_choices": True}
    recording = record_policy(scenario, "random-walk", 3, overrides=overrides)
    # Often: a third of what is charged and heard.
    idle = np.random.default_rng(0).random(recording.heard.shape) < 0.3
    heard, outcome = recording.heard.copy(), recording.outcome.copy()
    codes = [reason.code for reason in recording.reasons]
    heard[idle & (outcome != 0)] = 0
    outcome[heard == 0] = codes.index("nobody_asked") + 1
    recording = replace(recording, heard=heard, outcome=outcome)
    path = tmp_path / "page.html"
    path.write_text(without_webgl(render_page([recording])), encoding="utf-8")
    watched = Watched(browser, path.as_uri(), color_scheme="light")
    page = watched.page
    for slot in range(recording.slots):
        page.keyboard.press("ArrowRight")
        for auv, text in enumerate(rows(page, recording.policy)):
            assert ("nobody was asked for a packet" in text) == (heard[slot, auv] == 0)
            assert ("✗" in text or "✓" in text) == (heard[slot, auv] > 0)
            named = np.count_nonzero([heard[slot, auv], recording.charged[slot, auv]])
            assert text.count("nobody") - text.count("nobody was") == 2 - named
    links = recording.asked.sum()
    tally = page.locator(".tally").inner_text()
    assert f"{recording.delivered.sum()} of {links} uplinks arrived" in tally
    assert f"Nobody asked: {recording.heard.size - links} ×." in tally
    assert watched.complaints == []
    watched.context.close()


def test_mean_so_far_is_that_of_the_metric_however_ages_are_taken(browser, tmp_path):
    changes = {**SHORT, "age.sampling": "packet_start"}
    for i, overrides in enumerate([SHORT, changes]):
        recording = record_policy("paper/k3-fdd", "tour", 0, overrides=overrides)
        path = tmp_path / f"{i}.html"
        path.write_text(without_webgl(render_page([recording])), encoding="utf-8")
        watched = Watched(browser, path.as_uri())
        watched.page.keyboard.press("End")
        shown = re.search(r"so far\s+([\d.]+)", watched.page.locator("body").inner_text())[1]
        found = evaluate("paper/k3-fdd", "tour", 1, overrides=overrides).metrics["mean_aoi"].mean
        assert shown == f"{found:.2f}"
        watched.context.close()
