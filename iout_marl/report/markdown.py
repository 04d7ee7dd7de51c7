"""A report as Markdown, its figures as pictures beside it."""

from __future__ import annotations

from collections.abc import Iterator

from iout_marl.report.document import Answers, Report, Section, Table
from iout_marl.report.figure import Figure
from iout_marl.report.markup import markdown_path, markdown_text


def render_markdown(report: Report, figures: str) -> str:
    """The report as a Markdown text.

    Args:
        report: what it says.
        figures: where the folder with the figures lies, from the text's own folder.
    """
    lines = [f"# {markdown_text(report.title)}", ""]
    for paragraph in report.lead:
        lines += [markdown_text(paragraph), ""]
    lines += ["| | |", "|---|---|"]
    lines += [f"| {markdown_text(name)} | {markdown_text(value)} |" for name, value in report.facts]
    lines.append("")
    for section in report.sections:
        lines += _section(section, figures)
    return "\n".join(lines).rstrip() + "\n"


def _section(section: Section, figures: str) -> Iterator[str]:
    yield from (f"## {markdown_text(section.title)}", "")
    for paragraph in section.paragraphs:
        yield from (markdown_text(paragraph), "")
    for item in section.items:
        if isinstance(item, Figure):
            yield from (f"### {markdown_text(item.title)}", "")
            yield from (
                f"![{markdown_text(item.title)}]({markdown_path(figures)}/{item.key}.png)",
                "",
            )
            yield from (markdown_text(item.caption), "")
        elif isinstance(item, Table):
            yield from (
                f"### {markdown_text(item.title)}",
                "",
                *_table(item),
                "",
                markdown_text(item.caption),
                "",
            )
        else:
            yield from _answers(item)


def _table(table: Table) -> Iterator[str]:
    yield f"| {' | '.join(map(markdown_text, table.columns))} |"
    aligned = ("---:" if i in table.numeric else "---" for i in range(len(table.columns)))
    yield f"| {' | '.join(aligned)} |"
    for i, row in enumerate(table.rows):
        cells = (
            f"**{markdown_text(cell)}**" if (i, j) in table.marked and cell else markdown_text(cell)
            for j, cell in enumerate(row)
        )
        yield f"| {' | '.join(cells)} |"


def _answers(item: Answers) -> Iterator[str]:
    yield from (markdown_text(item.caption), "")
    yield from ("| claim | of | verdict |", "|---|---|---|")
    for answer in item.answers:
        cells = (markdown_text(answer.text), markdown_text(answer.source), f"**{answer.judged}**")
        yield f"| {' | '.join(cells)} |"
    yield ""
    for answer in item.answers:
        value = f" ({answer.value})" if answer.value else ""
        yield from (f"### {answer.claim}: {answer.judged}", "")
        yield from (f"{markdown_text(answer.source)}: {markdown_text(answer.text + value)}.", "")
        yield from (f"- {markdown_text(line)}" for line in answer.measured)
        if answer.explanation:
            yield from ("", "Why:", "")
            yield from (f"- {markdown_text(line)}" for line in answer.explanation)
        yield ""
