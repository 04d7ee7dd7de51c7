"""A report as Markdown, its figures as pictures beside it."""

from __future__ import annotations

from collections.abc import Iterator

from iout_marl.report.content import Answers, Plot, Report, Section, Table, Trajectory

#: In a table a bar would end the cell.
_ESCAPES = str.maketrans({"|": "\\|", "<": "&lt;", ">": "&gt;", "*": "\\*"})


def render_markdown(report: Report, figures: str) -> str:
    """The report as a Markdown text.

    Args:
        report: what it says.
        figures: where the folder with the figures lies, from the text's own folder.
    """
    lines = [f"# {report.title}", ""]
    for paragraph in report.lead:
        lines += [_text(paragraph), ""]
    lines += ["| | |", "|---|---|"]
    lines += [f"| {_text(name)} | {_text(value)} |" for name, value in report.facts]
    lines.append("")
    for section in report.sections:
        lines += _section(section, figures)
    return "\n".join(lines).rstrip() + "\n"


def _text(text: str) -> str:
    """Escaped, but for what stands between backticks."""
    parts = text.split("`")
    return "`".join(p if i % 2 else p.translate(_ESCAPES) for i, p in enumerate(parts))


def _section(section: Section, figures: str) -> Iterator[str]:
    yield from (f"## {section.title}", "")
    for paragraph in section.paragraphs:
        yield from (_text(paragraph), "")
    for item in section.items:
        if isinstance(item, Plot | Trajectory):
            yield from (f"### {item.title}", "")
            yield from (f"![{item.title}]({figures}/{item.key}.png)", "")
            yield from (_text(item.caption), "")
        elif isinstance(item, Table):
            yield from (f"### {item.title}", "", *_table(item), "", _text(item.caption), "")
        else:
            yield from _answers(item)


def _table(table: Table) -> Iterator[str]:
    yield f"| {' | '.join(map(_text, table.columns))} |"
    aligned = ("---:" if i in table.numeric else "---" for i in range(len(table.columns)))
    yield f"| {' | '.join(aligned)} |"
    for i, row in enumerate(table.rows):
        cells = (
            f"**{_text(cell)}**" if (i, j) in table.marked and cell else _text(cell)
            for j, cell in enumerate(row)
        )
        yield f"| {' | '.join(cells)} |"


def _answers(item: Answers) -> Iterator[str]:
    yield from (_text(item.caption), "")
    yield from ("| claim | of | verdict |", "|---|---|---|")
    for answer in item.answers:
        yield f"| {_text(answer.text)} | {_text(answer.source)} | **{answer.verdict}** |"
    yield ""
    for answer in item.answers:
        value = f" ({answer.value})" if answer.value else ""
        yield from (f"### {answer.claim}: {answer.verdict}", "")
        yield from (f"{_text(answer.source)}: {_text(answer.text + value)}.", "")
        yield from (f"- {_text(line)}" for line in answer.measured)
        if answer.explanation:
            yield from ("", "Why:", "")
            yield from (f"- {_text(line)}" for line in answer.explanation)
        yield ""
