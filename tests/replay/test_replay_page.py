"""What a replay's page is made of, and how large it is and how long it takes."""

import json
import re
from dataclasses import replace
from importlib.resources import files

import matplotlib as mpl
import numpy as np
import pytest

from iout_marl import InputError, record_policy
from iout_marl.core.reasons import Reason
from iout_marl.render import style
from iout_marl.render.hull import hull_path, hull_svg
from iout_marl.render.labels import energy_text
from iout_marl.replay.page import render_page

ASSETS = files("iout_marl.replay") / "assets"


@pytest.fixture(scope="module")
def recording():
    return record_policy("paper/k3-fdd", "greedy")


def test_a_large_episode_is_small():
    """100 slots, 50 nodes, 4 AUVs: at most 1.5 MB beside the library's code."""
    recording = record_policy("multi/m4-k50-fdd", "greedy")
    assert (recording.slots, recording.num_nodes, recording.num_auvs) == (100, 50, 4)
    page = render_page([recording, recording])
    library = (ASSETS / "three" / "three.min.js").read_text(encoding="utf-8")
    assert library in page
    assert len(page.encode()) - len(library.encode()) < 1.5e6


def data_of(page):
    return json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])


def test_page_holds_the_episode(recording):
    (episode,) = data_of(render_page([recording]))["episodes"]
    assert episode["ages"] == recording.ages.ravel().tolist()
    assert episode["path"] == recording.path.ravel().tolist()
    assert np.allclose(episode["energies"], recording.energy_j.ravel(), rtol=1e-3)
    assert episode["outcome"] == recording.outcome.ravel().tolist()


def test_cells_are_drawn_in_proportion_as_far_as_layers_can_be_seen(recording):
    page = data_of(render_page([replace(recording, spacing_m=(100.0, 150.0, 10.0))]))
    assert page["episodes"][0]["edges"] == {"above": [1, 1.5], "side": [3, 1], "space": [3, 3, 1]}
    assert "cells of 100 × 150 × 10 m, drawn with x × 1.5, z × 5 · " in page["facts"]
    page = data_of(render_page([recording]))
    assert page["episodes"][0]["edges"] == {"above": [1, 1], "side": [1, 1], "space": [1, 1, 1]}
    assert "cells of 100 m · " in page["facts"]


def test_texts_of_users_are_texts(recording):
    evil = "</script><img src=x onerror=alert(1)>\u202e\n"
    page = render_page(
        [
            replace(
                recording,
                policy=evil, scenario=evil, reasons=(Reason("evil", evil),),
            )
        ]
    )  # fmt: skip
    assert "<img" not in page
    assert page.count("</script>") == 3
    assert page.count("{{") == 0


def test_facts_stand_once_where_equal_and_else_with_each_episode(recording):
    facts = "FDD · 3 nodes · 1 AUV · 10 × 10 × 4 cells of 100 m · 100 slots of 25 s"
    hash_ = f"scenario {recording.scenario_hash}"
    alone = data_of(render_page([recording]))
    assert alone["facts"] == f"{facts} · seed 0 · {hash_}"
    assert [each["facts"] for each in alone["episodes"]] == [""]
    seeds = data_of(render_page([recording, replace(recording, seed=None)]))
    assert seeds["facts"] == f"{facts} · {hash_}"
    assert [each["facts"] for each in seeds["episodes"]] == ["seed 0", ""]
    assert seeds["legend"] == alone["legend"]


def test_two_scenarios_have_facts_of_their_own(recording):
    other = record_policy("paper/k5-tdd", "greedy")
    data = data_of(render_page([recording, other]))
    assert data["facts"] == "1 AUV · 10 × 10 × 4 cells of 100 m · 100 slots of 25 s · seed 0"
    for each, shown in zip([recording, other], data["episodes"], strict=True):
        full = energy_text(each.snapshot(0).energy_yardstick_j)
        assert shown["facts"].split(" · ") == [
            *(each.scenario, f"energy full at {full}", each.duplex),
            *(f"{each.num_nodes} nodes", f"scenario {each.scenario_hash}"),
        ]
    assert dict(data["legend"])["energy"] == ("energy stored; full at an uplink over half the grid")


def test_one_clock(recording):
    with pytest.raises(InputError, match=r"has one clock, but slots last 25 s and 30 s"):
        render_page([recording, replace(recording, slot_s=30.0)])
    for wrong in ([], [recording] * 3):
        with pytest.raises(InputError, match="one episode or two"):
            render_page(wrong)


def test_library_is_the_version_that_it_says():
    package = json.loads((ASSETS / "three" / "package.json").read_text())
    version = package["dependencies"]["three"]
    code = (ASSETS / "three" / "three.min.js").read_text(encoding="utf-8")
    assert code.startswith(f"/* three.js {version}, MIT licence")
    assert "REVISION:()=>" in code
    assert f'"{version.split(".")[1]}"' in code
    assert "MIT" in (ASSETS / "three" / "LICENSE").read_text()


def test_colours_of_ages_are_those_of_pictures():
    colours = mpl.colormaps[style.AGE_COLOURS](np.linspace(0, 1, len(style.AGE_STOPS)))
    assert [mpl.colors.to_hex(colour) for colour in colours] == list(style.AGE_STOPS)


def test_outline_of_an_auv_is_that_of_pictures():
    numbers = np.array(re.findall(r"-?[\d.]+", hull_svg()), dtype=float).reshape(-1, 2)
    assert np.allclose(numbers, hull_path().vertices[:-1])
    letters = re.findall(r"[A-Z]", hull_svg())
    codes = hull_path().codes
    assert letters.count("C") * 3 == np.count_nonzero(codes == hull_path().CURVE4)
    assert letters.count("L") == np.count_nonzero(codes == hull_path().LINETO)
