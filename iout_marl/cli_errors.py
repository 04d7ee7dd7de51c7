"""What went wrong, in one line, where it is not the fault of this program."""

from __future__ import annotations

from typing import cast

import typer

from iout_marl.errors import InputError, is_lack_of_memory, printable

#: What Typer raises for a command line that it cannot read.
UsageError = cast("type[Exception]", typer.BadParameter.__base__)


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
