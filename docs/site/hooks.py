"""What MkDocs does beside its own work for the site: `make site`.

- Pages link to files of the repository, as they must on a code host: each file that is linked
  becomes a page of the site below `repository/`, and the link leads there.
- Notebooks of `docs/notebooks/` are run, and are pages with what their cells have printed. One
  that fails ends the build.
- Equations between `$` or `$$` become MathML, which browsers draw without a script.
"""

from __future__ import annotations

import html
import json
import os
import posixpath
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files, InclusionLevel
from mkdocs.structure.pages import Page

sys.path.insert(0, str(Path(__file__).parent))
from notebooks import CellError, as_markdown

ROOT = Path(__file__).parents[2]
#: Where files of the repository are pages.
FOLDER = "repository"
_FENCE = re.compile(r"^ {0,3}(`{3,}|~{3,})")
_LINK = re.compile(r"(\]\()([^)\s#]+)((?:#[^)\s]*)?\))")
_EQUATION = re.compile(r'<(span|div) class="arithmatex">\\[(\[](.*?)\\[)\]]</\1>', re.DOTALL)
_LANGUAGES = {".py": "python", ".yaml": "yaml", ".toml": "toml", ".cff": "yaml", ".txt": "text"}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the notebooks, and the files of the repository that pages or the navigation name."""
    for path in sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")):
        try:
            text = as_markdown(path)
        except CellError as error:
            raise PluginError(str(error)) from error
        files.append(File.generated(config, f"notebooks/{path.stem}.md", content=text))
    wanted = [
        ROOT / name.removeprefix(f"{FOLDER}/").removesuffix(".md")
        for name in _named(config.nav)
        if name.startswith(f"{FOLDER}/")
    ]
    wanted = [path if path.is_file() else path.with_name(f"{path.name}.md") for path in wanted]
    for file in files.documentation_pages():
        wanted += _linked(file.content_string, file.src_uri)
    while wanted:
        path = wanted.pop()
        uri = _uri(path)
        if path.is_relative_to(ROOT / "docs") or files.get_file_from_path(uri):
            continue
        text = _as_page(path)
        page = File.generated(config, uri, content=text, inclusion=InclusionLevel.NOT_IN_NAV)
        files.append(page)
        wanted += _linked(text, uri)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Lead links to files of the repository to their pages."""
    uri = page.file.src_uri

    def on_site(link: re.Match[str]) -> str:
        path = _target(link[2], uri)
        if path is None:
            return link[0]
        return f"{link[1]}{posixpath.relpath(_uri(path), posixpath.dirname(uri) or '.')}{link[3]}"

    return _outside_code(markdown, lambda line: _LINK.sub(on_site, line))


def on_page_content(content: str, page: Page, config: MkDocsConfig, files: Files) -> str:  # noqa: ARG001
    """Equations as MathML."""

    def drawn(found: re.Match[str]) -> str:
        latex = html.unescape(found[2]).strip()
        if found[1] == "span":
            return convert(latex)
        return f'<div class="equation">{convert(latex, display="block")}</div>'

    return _EQUATION.sub(drawn, content)


#: Makes a worker of its text, where pages that are read from a disk may not load one.
_WORKER_OF_TEXT = """if (location.protocol === "file:") {
  window.Worker = class extends Worker {
    constructor() {
      super(URL.createObjectURL(new Blob([%s], { type: "text/javascript" })));
    }
  };
}
"""


def on_post_build(config: MkDocsConfig) -> None:
    """The search for pages that are read from a disk, which load scripts and nothing else.

    The theme looks for its index in `search_index.js` there; its worker comes as a text.
    """
    site = Path(config.site_dir)
    index = site / "search" / "search_index.json"
    text = f"var __index = {index.read_text(encoding='utf-8')}"
    index.with_suffix(".js").write_text(text, encoding="utf-8")
    (worker,) = site.glob("assets/javascripts/workers/search.*.min.js")
    source = json.dumps(worker.read_text(encoding="utf-8")).replace("</", "<\\/")
    (site / "search" / "worker.js").write_text(_WORKER_OF_TEXT % source, encoding="utf-8")


def _named(nav: Any) -> Iterator[str]:
    """All pages that the navigation names."""
    if isinstance(nav, str):
        yield nav
    elif nav:
        for item in nav.values() if isinstance(nav, dict) else nav:
            yield from _named(item)


def _linked(markdown: str, uri: str) -> Iterator[Path]:
    """The files of the repository that a page links to."""
    for line in _outside_code(markdown, lambda line: line, code="").splitlines():
        for link in _LINK.finditer(line):
            if path := _target(link[2], uri):
                yield path


def _target(link: str, uri: str) -> Path | None:
    """The file or folder of the repository that a link of a page means, if it does."""
    if "://" in link or link.startswith(("/", "mailto:")):
        return None
    source = ROOT / (
        uri.removeprefix(f"{FOLDER}/") if uri.startswith(f"{FOLDER}/") else f"docs/{uri}"
    )
    path = Path(os.path.normpath(source.parent / link))
    if path.is_dir() and (path / "README.md").is_file():
        path /= "README.md"
    return path if path.exists() and path.is_relative_to(ROOT) else None


def _uri(path: Path) -> str:
    """Where a file of the repository is on the site, as MkDocs names sources."""
    if path.is_relative_to(ROOT / "docs") and path.is_file():
        return path.relative_to(ROOT / "docs").as_posix()
    name = f"{FOLDER}/{path.relative_to(ROOT).as_posix()}"
    return f"{name}/index.md" if path.is_dir() else name if path.suffix == ".md" else f"{name}.md"


def _as_page(path: Path) -> str:
    """A file or folder of the repository as Markdown."""
    name = path.relative_to(ROOT).as_posix()
    if path.is_dir():
        found = sorted(file.name for file in path.iterdir() if file.is_file())
        return f"# {name}\n\n" + "".join(f"- [{file}]({file})\n" for file in found)
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".md":
        return text
    language = _LANGUAGES.get(path.suffix, "text")
    return f"---\nsearch:\n  exclude: true\n---\n\n# {name}\n\n~~~~~{language}\n{text}~~~~~\n"


def _outside_code(markdown: str, change: Callable[[str], str], code: str | None = None) -> str:
    """Change the lines outside of fenced code; `code` stands in for those inside, if given."""
    lines, fence = [], ""
    for line in markdown.split("\n"):
        mark = _FENCE.match(line)
        if fence:
            lines.append(line if code is None else code)
            if mark and mark[1].startswith(fence) and not line.strip(" `~"):
                fence = ""
        elif mark:
            fence = mark[1]
            lines.append(line if code is None else code)
        else:
            lines.append(change(line))
    return "\n".join(lines)
