"""What went wrong, in one line, where it is not the fault of this program."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, cast

import typer

from iout_marl.errors import InputError, Note, is_lack_of_memory, printable
from iout_marl.terminal import complain

#: What Typer raises for a command line that it cannot read.
UsageError = cast("type[Exception]", typer.BadParameter.__base__)


@contextmanager
def notes_in_a_line() -> Iterator[None]:
    """Print a `Note` as one line on standard error, other warnings as Python does."""
    with warnings.catch_warnings():
        show = warnings.showwarning

        def show_note(message: Any, category: type[Warning], *where: Any, **options: Any) -> None:
            if issubclass(category, Note):
                complain(f"note: {printable(str(message))}")
            else:
                show(message, category, *where, **options)

        warnings.showwarning = show_note
        yield


def reason_of(error: Exception) -> str | None:
    """The line for an error that bad input or the machine has led to; None for any other."""
    if isinstance(error, InputError):
        return str(error)
    if isinstance(error, UsageError):
        said = getattr(error, "format_message", error.__str__)()
        return printable(f"{said} (see: iout --help)")
    if isinstance(error, OSError):
        return printable(f"{error.filename or 'input or output'}: {error.strerror or error}")
    if is_lack_of_memory(error):
        return "not enough memory"
    if isinstance(error, RecursionError):
        return "something in the input is nested too deeply"
    if isinstance(error, OverflowError):
        return printable(f"a number in the input is too large to compute with ({error})")
    if isinstance(error, ImportError):
        return printable(f"{error.name or 'a package'} cannot be imported: {error}")
    return None
