"""What a text is in a page, in Plotly, in a picture, in Markdown and on a terminal.

In the texts of a report, words between backticks are code. A user's own text, be it a title,
a name or a message, is data: it goes through `as_data` once, where results become a report,
and is then shown as it is wherever it comes to stand.
"""

from __future__ import annotations

import re
from html import escape
from urllib.parse import quote

from markupsafe import Markup

from iout_marl.inline import json_for_script
from iout_marl.render.labels import displayable, shortened

#: Stands for a backtick of a user's, which marks no code; Unicode keeps it free for programs.
_BACKTICK = "\ufdd0"
_CODE = re.compile(r"`([^`]+)`")
_INTERVAL = re.compile(r" (\([^()]+\))(?=$|;)")

#: Markdown's own characters, and GitHub's: a formula, an emoji, an entity.
_MARKS = re.compile(
    r"""[|*\[\]\\~`]  # wherever they stand
    | (?<![^\W_])_ | _(?![^\W_])  # within a word it marks nothing
    | (?<!\w)\#(?=\#*(\s|$)) | (?<=\s)\#+$  # a heading
    | ^[-+=>](?=\s|[-+=]|$) | ^\d+[.)](?=\s|$)  # a list, a rule, a quotation
    """,
    re.VERBOSE,
)
_ENTITIES = {"<": "&lt;", ">": "&gt;", "$": "&#36;"}
_IS_ENTITY = re.compile(r"&(?=#?\w+;)")
_EMOJI = re.compile(r":(?=[\w+-]+:)")


def as_data(text: str) -> str:
    """A user's text for a report: one line without control characters, and no code in it."""
    return displayable(text).replace("`", _BACKTICK)


def plain_text(text: str, length: int | None = None) -> str:
    """A text where nothing is marked up: a terminal, a CSV file, a picture.

    Args:
        text: the text.
        length: columns at which it is cut short.
    """
    text = text.replace(_BACKTICK, "`")
    return text if length is None else shortened(text, length)


def html_text(text: str) -> Markup:
    """A text for a page."""
    return Markup(plain_text(_CODE.sub(r"<code>\1</code>", escape(text))))


def html_cell(text: str) -> Markup:
    """A text for a cell of a table; an interval in brackets stays on one line."""
    return Markup(_INTERVAL.sub(r' <span class="whole">\1</span>', str(html_text(text))))


def json_script(text: str) -> Markup:
    """JSON for a script element, which no text in it can end."""
    return Markup(json_for_script(text))


def plotly_text(text: str, length: int | None = None) -> str:
    """A text for Plotly, which reads tags and entities."""
    return escape(plain_text(text, length), quote=False)


def plotly_template(text: str, length: int | None = None) -> str:
    """A text within a template of Plotly's, which reads `%{...}` as well."""
    return plotly_text(text, length).replace("%{", "%\N{WORD JOINER}{")


def markdown_text(text: str) -> str:
    """A text for a paragraph, a heading or a cell of Markdown."""
    parts = _CODE.split(text.strip())
    return "".join(_code(p) if i % 2 else _escaped(p) for i, p in enumerate(parts))


def markdown_path(path: str) -> str:
    """A path as the target of a link in Markdown."""
    return quote(path, safe="/.-_~", errors="surrogateescape")


def _escaped(text: str) -> str:
    text = _IS_ENTITY.sub("&amp;", text)
    text = _MARKS.sub(lambda m: f"{m[0][:-1]}\\{m[0][-1]}", text)
    text = _EMOJI.sub("&#58;", text)
    return plain_text("".join(_ENTITIES.get(c, c) for c in text)).replace("`", "\\`")


def _code(text: str) -> str:
    """A code span; a bar would end a cell even there."""
    text = plain_text(text).replace("|", "\\|")
    longest = max(map(len, re.findall("`+", text)), default=0)
    fence = "`" * (longest + 1)
    return f"{fence} {text} {fence}" if longest else f"`{text}`"
