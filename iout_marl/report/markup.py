"""Plain texts in the markup of a web page and of Plotly."""

from __future__ import annotations

import re
from html import escape

from markupsafe import Markup

_CODE = re.compile(r"`([^`]+)`")


def html_text(text: str) -> Markup:
    """A text for a page: words between backticks become `<code>`, all else is escaped."""
    return Markup(_CODE.sub(r"<code>\1</code>", escape(text)))


def plotly_text(text: str) -> str:
    """A text for Plotly, which reads tags, entities and `%{...}`."""
    return escape(text, quote=False).replace("%{", "%\N{WORD JOINER}{")
