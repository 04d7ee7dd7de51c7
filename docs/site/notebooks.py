"""Runs a notebook's cells as code, and writes the notebook with what they have printed."""

from __future__ import annotations

import ast
import base64
import contextlib
import html
import io
import json
import linecache
import sys
from pathlib import Path
from types import ModuleType
from typing import Any


class CellError(Exception):
    """A cell has failed."""


def as_markdown(path: Path) -> str:
    """A notebook as a page, its cells run in order.

    Raises:
        CellError: one of them has failed; the error is its cause.
    """
    blocks: list[str] = []
    # A module of its own, where what a cell defines is looked for, as in a kernel.
    module = sys.modules[path.stem] = ModuleType(path.stem)
    scope = vars(module)
    for number, cell in enumerate(json.loads(path.read_text(encoding="utf-8"))["cells"], 1):
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            blocks.append(source)
            continue
        blocks.append(f"```python\n{source}\n```")
        try:
            printed, pictures = _run(source, f"{path.name}, cell {number}", scope)
        except Exception as error:
            raise CellError(f"{path.name}, cell {number}: {error!r}") from error
        if printed:
            blocks.append(f'<pre class="printed">{html.escape(printed)}</pre>')
        for picture in pictures:
            data = base64.b64encode(picture).decode()
            blocks.append(
                f'<img alt="Figure of the cell above" src="data:image/png;base64,{data}">'
            )
    return "\n\n".join(blocks) + "\n"


def _run(source: str, name: str, scope: dict[str, Any]) -> tuple[str, list[bytes]]:
    """Run a cell; what it has printed, its last value included, and its figures as PNG."""
    import matplotlib as mpl

    mpl.use("agg")
    from matplotlib import pyplot as plt

    # What looks for the source of a class, such as the texts of its keys, finds it here.
    linecache.cache[name] = (len(source), None, source.splitlines(keepends=True), name)
    code = ast.parse(source)
    last = code.body.pop() if code.body and isinstance(code.body[-1], ast.Expr) else None
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(io.StringIO()):
        exec(compile(code, name, "exec", dont_inherit=True), scope)
        if isinstance(last, ast.Expr):
            value = eval(
                compile(ast.Expression(last.value), name, "eval", dont_inherit=True), scope
            )
            if value is not None:
                print(value)  # noqa: T201 (as a notebook shows it)
    pictures = []
    for figure in map(plt.figure, plt.get_fignums()):
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=100, bbox_inches="tight")
        pictures.append(stream.getvalue())
    plt.close("all")
    return printed.getvalue().rstrip("\n"), pictures
