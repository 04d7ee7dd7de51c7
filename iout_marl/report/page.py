"""The report as one web page that needs nothing else and asks no host for anything."""

from __future__ import annotations

import base64
import importlib.resources
import re
from collections import Counter
from collections.abc import Mapping

import jinja2
from markupsafe import Markup

from iout_marl.inline import code_for_script
from iout_marl.report.document import Answers, Report, Table, Verdict
from iout_marl.report.figure import Figure, TrajectoryPlot
from iout_marl.report.markup import html_cell, html_text, json_script, plain_text
from iout_marl.report.matplotlib_writer import draw
from iout_marl.report.plot_layout import legend, name_lines
from iout_marl.report.plotly_writer import plotly_json
from iout_marl.words import counted

#: In words of a class name, and with a sign, so that no verdict rests on its colour alone.
_VERDICTS: dict[Verdict, tuple[str, str]] = {
    "reproduced": ("yes", "✓"),
    "reproduced in part": ("part", "≈"),
    "left open": ("open", "?"),
    "not reproduced": ("no", "✗"),
    "not measured": ("none", "–"),
}
_KEY = re.compile(r"[A-Za-z][\w.-]*")


def render_page(report: Report, pictures: Mapping[str, bytes] | None = None) -> str:
    """The page, an HTML document.

    Args:
        report: what it says.
        pictures: the SVG of every figure by key; drawn where not given.

    Raises:
        ValueError: two parts have the same key, or a key makes no anchor.
    """
    _check_keys(report)
    pictures = pictures or {figure.key: draw(figure)["svg"] for figure in report.figures()}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("iout_marl.report"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {
        "text": html_text,
        "cell": html_cell,
        "plain": plain_text,
        "slug": _slug,
    }
    environment.tests |= {
        "figure": lambda item: isinstance(item, Figure),
        "trajectory": lambda item: isinstance(item, TrajectoryPlot),
        "table": lambda item: isinstance(item, Table),
        "answers": lambda item: isinstance(item, Answers),
    }

    def inlined(name: str) -> Markup:
        return Markup(environment.get_template(name).render())

    return environment.get_template("report.html.j2").render(
        report=report,
        verdicts=_VERDICTS,
        style=inlined("report.css"),
        script=inlined("report.js"),
        plotly=Markup(code_for_script(_plotly())) if any(report.figures()) else "",
        data={f.key: json_script(plotly_json(f)) for f in report.figures()},
        pictures={key: _data_uri(svg) for key, svg in pictures.items()},
        alt={figure.key: _alternative(figure) for figure in report.figures()},
        entries={figure.key: _legend_lines(figure) for figure in report.figures()},
    )


def _check_keys(report: Report) -> None:
    keys = [section.key for section in report.sections]
    keys += [item.key for section in report.sections for item in section.items]
    # Folders of some systems do not tell small letters from capitals.
    count = Counter(key.casefold() for key in keys)
    for key in keys:
        if count[key.casefold()] > 1:
            raise ValueError(f"{key!r} is the key of {count[key.casefold()]} parts of the report")
        if not _KEY.fullmatch(key):
            raise ValueError(f"{key!r} is no key: an ASCII letter, then letters, digits, . _ -")


def _plotly() -> str:
    """Plotly for browsers, without loading it here: surroundings such as PLOTLY_RENDERER can
    keep that from being done."""
    path = importlib.resources.files("plotly") / "package_data" / "plotly.min.js"
    return path.read_text(encoding="utf-8")


def _data_uri(svg: bytes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg).decode()


def _slug(text: str) -> str:
    return re.sub(r"[^a-z0-9]+", "-", text.lower()).strip("-")


def _alternative(figure: Figure) -> str:
    """What those read who do not see the figure."""
    if isinstance(figure, TrajectoryPlot):
        episode = figure.episode
        size, auvs = " × ".join(map(str, episode.grid)), counted(len(episode.path[0]), "AUV")
        return plain_text(
            f"{figure.title}: {auvs} in {counted(len(episode.charged), 'slot')} in a grid of "
            f"{size} cells with {counted(len(episode.nodes), 'node')}. The CSV file has every slot."
        )
    names = ", ".join(dict.fromkeys(line.name for line in figure.lines))
    return plain_text(
        f"{figure.title}: {figure.y.label} over {figure.x.label} for {names}. "
        "The CSV file has the values."
    )


def _legend_lines(figure: Figure) -> int:
    if isinstance(figure, TrajectoryPlot):
        return 6 + len(figure.episode.path[0])
    return sum(len(name_lines(figure.lines[i].name)) for i in legend(figure))
