"""How Typer is to show commands: plainly, and faults as they are."""

from __future__ import annotations

from typing import Any

LOOKS: dict[str, Any] = {
    "add_completion": False,
    "pretty_exceptions_enable": False,
    "rich_markup_mode": None,
}
