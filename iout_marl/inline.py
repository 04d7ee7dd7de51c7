"""Text inside the script elements of a page, which nothing in it can end."""

from __future__ import annotations

import re


def json_for_script(text: str) -> str:
    """JSON, with characters escaped that a page could take for its own."""
    return re.sub(r"[<>&\u2028\u2029]", lambda m: f"\\u{ord(m[0]):04x}", text)


def code_for_script(code: str) -> str:
    """JavaScript of somebody else's, as a page may hold it."""
    # Both would end a script element early or keep it from ending.
    return code.replace("</script", r"<\/script").replace("<!--", r"<\!--")
