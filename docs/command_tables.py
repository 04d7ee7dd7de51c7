"""Every command with its arguments and options, for `docs/commands.md`."""

from __future__ import annotations

import html
import inspect
import re
from collections.abc import Iterator
from typing import Any

import typer
from markdown_tables import page_of, table

from iout_marl.cli import app
from iout_marl.report.markup import markdown_text


def commands_reference() -> str:
    """A section for each command, as Typer knows it."""
    group: Any = typer.main.get_command(app)
    with group.make_context("iout", [], resilient_parsing=True) as context:
        names = group.list_commands(context)
        return page_of(
            block
            for name in names
            for block in _command(name, group.get_command(context, name), context)
        )


def _command(name: str, command: Any, context: Any) -> Iterator[str]:
    if subcommands := getattr(command, "commands", {}):
        for inner, subcommand in subcommands.items():
            yield from _command(f"{name} {inner}", subcommand, context)
        return
    yield f"## `iout {name}`"
    yield from map(_text, re.split(r"\n\s*\n", inspect.cleandoc(command.help or "")))
    arguments = [p for p in command.params if p.param_type_name == "argument"]
    options = [p for p in command.params if p.param_type_name == "option" and p.name != "help"]
    yield f"```console\n{_usage(name, arguments, options)}\n```"
    rows = [(f"`{p.metavar}`", _text(p.help)) for p in arguments]
    for names, text in (p.get_help_record(context) for p in options):
        words = re.sub(r"<(\w+)>", lambda found: found[1].upper(), names)
        # Within code a bar would end the cell, and a backslash before it would show.
        shown = html.escape(words).replace("|", "&#124;")
        rows.append((f"<code>{shown}</code>" if "|" in words else f"`{words}`", _text(text)))
    if rows:
        yield table(("Argument or option", "Meaning"), rows)


def _usage(name: str, arguments: list[Any], options: list[Any]) -> str:
    words = [p.metavar if p.required else f"[{p.metavar}]" for p in arguments]
    return " ".join(["iout", name, *words, *(["[OPTIONS]"] if options else [])])


def _text(text: str) -> str:
    return markdown_text(" ".join(text.split()))
