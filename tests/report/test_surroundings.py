"""Reports and pictures are the same in any surroundings, and in a font that has the characters."""

import hashlib
import itertools
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from report_sample import BARS

from iout_marl import World, load_scenario
from iout_marl.render import Snapshot, as_picture
from iout_marl.render.fonts import DEFAULT_FONT, fonts_for
from iout_marl.report.figure import Axis
from iout_marl.report.matplotlib_writer import draw
from iout_marl.world import node_codes

FOLDER = Path(__file__).parent
#: Prints what is drawn and written, in short.
PROGRAM = """
import hashlib
from report_sample import BARS, TRAJECTORY, Report, Section
from test_render import play
from iout_marl.render import as_picture
from iout_marl.report.page import render_page
digest = hashlib.sha256(as_picture(play("paper/k3-tdd", slots=3)).tobytes())
page = render_page(Report("Title", ("Lead.",), (), (Section("s", "S", (), (BARS, TRAJECTORY)),)))
digest.update(page.encode())
print(digest.hexdigest())
"""
SETTINGS = """
backend: Qt5Agg
text.usetex: True
font.family: a font that nobody has
font.size: 31
axes.unicode_minus: False
axes.formatter.use_locale: True
axes.facecolor: black
figure.dpi: 37
figure.autolayout: True
savefig.bbox: tight
savefig.dpi: 20
savefig.transparent: True
lines.linewidth: 9
svg.fonttype: none
xtick.direction: in
"""


def printed(program, **surroundings):
    """What a program prints in a process of its own; nothing may go to standard error."""
    folders = [str(FOLDER), str(FOLDER.parent), str(FOLDER.parent / "render")]
    path = os.pathsep.join([*folders, os.environ.get("PYTHONPATH", "")])
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        env={**os.environ, "PYTHONPATH": path, **surroundings},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (result.returncode, result.stderr) == (0, "")
    return result.stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [b"axes.formatter.use_locale: True", b"\xff\xfe\0", b"text.usetex: perhaps\nx"]
)
def test_a_matplotlibrc_with_faults_does_no_harm(settings, tmp_path):
    (tmp_path / "matplotlibrc").write_bytes(settings)
    program = """
from test_render import play
from iout_marl.render import as_picture
print(as_picture(play("paper/k3-tdd")).shape)
"""
    surroundings = {"MATPLOTLIBRC": str(tmp_path), "LC_ALL": "xx_XX"}
    assert printed(program, **surroundings) == "(600, 960, 3)"


@pytest.fixture(scope="module")
def usual():
    return printed(PROGRAM)


@pytest.mark.slow
@pytest.mark.parametrize(
    "surroundings",
    [
        {
            "MPLBACKEND": "module://a_notebook_that.is_not_here",
            "PLOTLY_RENDERER": "a renderer that is not here",
            "TZ": "Asia/Kolkata",
            "LC_ALL": "tr_TR.UTF-8",
            "MPLCONFIGDIR": "/proc/nowhere",
        },
        {"MPLBACKEND": "svg", "PLOTLY_RENDERER": "browser", "PYTHONUTF8": "0", "LC_ALL": "C"},
    ],
    ids=["a notebook's", "another's"],
)
def test_what_is_drawn_is_the_same_in_any_surroundings(usual, surroundings, tmp_path):
    (tmp_path / "matplotlibrc").write_text(SETTINGS)
    assert printed(PROGRAM, MATPLOTLIBRC=str(tmp_path), **surroundings) == usual


@pytest.mark.slow
def test_the_users_settings_are_as_before():
    program = """
from test_render import play
from iout_marl.render import as_picture
as_picture(play("paper/k3-tdd"))
import matplotlib, os
matplotlib.rcParams["lines.linewidth"] = 7
as_picture(play("paper/k3-tdd"))
print(matplotlib.get_backend(), os.environ["MPLBACKEND"], matplotlib.rcParams["lines.linewidth"])
"""
    assert printed(program, MPLBACKEND="svg") == "svg svg 7.0"


# ---- fonts


@pytest.fixture
def font(tmp_path):
    """Installs a font of some characters; returns the function that does."""
    from matplotlib import font_manager

    manager = font_manager.fontManager
    before = list(manager.ttflist)
    number = itertools.count()

    def install(characters):
        pen = TTGlyphPen(None)
        pen.moveTo((0, 0))
        for corner in ((0, 700), (700, 0), (350, 350)):
            pen.lineTo(corner)
        pen.closePath()
        name = f"Noto Sans Test {next(number)}"
        builder = FontBuilder(1000, isTTF=True)
        builder.setupGlyphOrder([".notdef", "shape"])
        builder.setupCharacterMap({ord(c): "shape" for c in characters})
        builder.setupGlyf({glyph: pen.glyph() for glyph in (".notdef", "shape")})
        builder.setupHorizontalMetrics(dict.fromkeys((".notdef", "shape"), (1000, 0)))
        builder.setupHorizontalHeader(ascent=800, descent=-200)
        builder.setupNameTable({"familyName": name, "styleName": "Regular"})
        builder.setupOS2(sTypoAscender=800)
        builder.setupPost()
        path = tmp_path / f"{name}.ttf"
        builder.save(path)
        manager.addfont(path)
        return name

    yield install
    manager.ttflist[:] = before
    manager._findfont_cached.cache_clear()


#: In no font that this software brings along.
FOREIGN = "能量"


def test_a_font_that_has_the_characters_is_found(font):
    first, second = font("能x"), font("量")
    families, instead = fonts_for(f"plain {FOREIGN}")
    assert families[0] == DEFAULT_FONT
    assert {first, second} <= set(families)
    assert not instead
    assert fonts_for("plain")[0] == (DEFAULT_FONT,)


def test_signs_without_a_shape_of_their_own_are_left_out_where_no_font_has_them():
    signs = "\N{LANGUAGE TAG}\N{MONGOLIAN VOWEL SEPARATOR}"
    _, instead = fonts_for(signs)
    assert set(instead.values()) <= {""}


@pytest.mark.slow
def test_characters_without_a_font_are_one_sign_and_no_warning(font):
    _, instead = fonts_for(f"{FOREIGN}x")
    if not instead:
        pytest.skip("this machine has a font for them")
    assert f"{FOREIGN}x".translate(instead) == "\N{REPLACEMENT CHARACTER}" * 2 + "x"
    before = digests()  # a warning would fail here
    font(FOREIGN)
    assert all(a != b for a, b in zip(before, digests(), strict=True))


def snapshot():
    world = World(load_scenario("paper/k3-tdd"))
    state = world.reset(node_codes(world.scenario, world.grid, [np.random.default_rng(0)]))
    return Snapshot.from_world(world, state, None)


def digests():
    lines = tuple(replace(line, name=f"{line.name} {FOREIGN}") for line in BARS.lines)
    drawn = draw(replace(BARS, x=Axis(FOREIGN, scale="categories"), y=Axis(FOREIGN), lines=lines))
    picture = as_picture(replace(snapshot(), title=f"a {FOREIGN}"))
    return [hashlib.sha256(d).hexdigest() for d in (drawn["png"], drawn["svg"], picture.tobytes())]


def test_fonts_that_cannot_be_read_are_left_alone(font, tmp_path):
    from matplotlib import font_manager

    name = font("ꙮ")
    (path,) = (f.fname for f in font_manager.fontManager.ttflist if f.name == name)
    Path(path).write_bytes(b"no font any more")
    assert name not in fonts_for("ꙮ and ꚙ")[0]
