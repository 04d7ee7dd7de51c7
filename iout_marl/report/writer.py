"""The report as files: the page, and every figure as PNG, SVG and CSV."""

from __future__ import annotations

from pathlib import Path

from iout_marl.errors import InputError
from iout_marl.extras import require
from iout_marl.files import write_together
from iout_marl.report.document import Report, to_csv

require("iout_marl.report", "report")

from iout_marl.report.matplotlib_writer import draw  # noqa: E402
from iout_marl.report.page import render_page  # noqa: E402


def write_report(report: Report, folder: Path) -> None:
    """Write `report.html` and `figures/KEY.{png,svg,csv}`.

    All or none: where one cannot be written, an earlier report stays as it is. The page, which
    links to the others, takes its place last.

    Raises:
        InputError: the folder cannot be made or a file cannot be written.
        ValueError: two parts have the same key, or a key makes no file name.
    """
    pictures = {figure.key: draw(figure) for figure in report.figures()}
    page = render_page(report, {key: files["svg"] for key, files in pictures.items()})
    figures = folder / "figures"
    try:
        figures.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{figures}: cannot be made: {error.strerror}") from None
    files = {}
    for figure in report.figures():
        for ending, data in pictures[figure.key].items():
            files[figures / f"{figure.key}.{ending}"] = data
        files[figures / f"{figure.key}.csv"] = to_csv(figure.rows()).encode()
    write_together({**files, folder / "report.html": page.encode()})
