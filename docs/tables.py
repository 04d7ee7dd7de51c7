"""Writes the tables that pages have from the software itself: `make docs`.

A table stands between the lines `<!-- NAME -->` and `<!-- end of NAME -->` of its page.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from command_tables import commands_reference
from environment_tables import entries_tables, node_table, spaces_tables
from markdown_tables import numeral, page_of, table
from pretrained_tables import elsewhere_table, layouts_table, teams_table, unseen_table
from sea_tables import (
    conclusions_table,
    deployments_tables,
    energy_tables,
    fairness_table,
    life_table,
    steps_tables,
)

from iout_marl import World, load_scenario, metrics
from iout_marl.registry import Entry, registry_of
from iout_marl.report.markup import markdown_text
from iout_marl.scenario import Scenario
from iout_marl.scenario.families import Matrix
from iout_marl.scenario.keys import Model
from iout_marl.scenario.reference import Key, keys, keys_of_kind, text_of

HERE = Path(__file__).parent
_BETTER = {"less": "less", "more": "more", None: "–"}
#: Where entries of an observation have the ranges that the table gives.
EXAMPLE = (
    "paper/k10-fdd",
    {
        "auvs.count": 3,
        "observation.view_range_m": 500,
        "vehicle": {
            "kind": "battery",
            "capacity_j": 4e6,
            "drag_area_m2": 3.0,
            "drag_coefficient": 0.006,
            "propulsion_efficiency": 0.7,
            "hotel_w": 40.0,
            "max_speed_m_per_s": 5.0,
        },
        "current": {"kind": "tide", "speed_m_per_s": 0.5, "toward_deg": 45.0},
    },
)
#: What else an entry needs to have something to tell.
NEEDED = {"transit": {"episode.slot_s": 10.0}}
_OBSERVED = "observation entry"
_KEY_HEADINGS = ("Key", "Unit", "Range", "Plausible", "Default", "Meaning")


def pretrained_card() -> str:
    """What the weights that come with the package were made of."""
    from trainers.pretrained import load_modes

    rows = [
        (
            f"`{name}`",
            f"`pretrained/{name}`",
            f"{sum(weights.numel() for weights in mode.weights.values()):,}",
            f"{mode.about['env_steps']:,}",
            f"{mode.about['seconds'] / 60:.0f} min",
            mode.about["processor"],
            f"`{mode.about['hash'][:12]}`",
        )
        for name, mode in load_modes().items()
    ]
    headings = ("Mode", "Scenario", "Weights", "Environment steps", "Time", "One core of", "Hash")
    return page_of([table(headings, rows)])


def metrics_table() -> str:
    """The built-in metrics."""
    headings = ("Metric", "Symbol", "Unit", "Better", "Range", "What it is", "TensorBoard")
    rows = [
        (
            f"`{metric.name}`",
            metric.symbol or "–",
            metric.unit or "–",
            _BETTER[metric.better],
            _bounds(metric),
            metric.definition,
            f"`{metric.tag}`",
        )
        for metric in metrics.ALL
    ]
    return table(headings, (map(markdown_text, row) for row in rows))


def _bounds(metric: metrics.Metric) -> str:
    if math.isinf(metric.low):
        return "any"
    low = f"{'above' if metric.is_positive else 'from'} {metric.low:g}"
    return low if math.isinf(metric.high) else f"{low} to {metric.high:g}"


def scenario_reference() -> str:
    """Every section with its keys, and every role of parts with its kinds and their keys."""
    top = [key for key in keys(Scenario) if not key.sections]
    blocks = ["## At the top of a file", _keys_table(top)]
    blocks += ["## `matrix`", *_paragraphs(text_of(Matrix)), _keys_table(keys(Matrix))]
    for key in keys(Scenario):
        for section in key.sections:
            blocks += [f"## `{key.name}`", *_paragraphs(text_of(section))]
            blocks.append(_keys_table(keys(section)))
            for inner in keys(section):
                for within in inner.sections:
                    blocks += [f"### `{key.name}.{inner.name}`", *_paragraphs(text_of(within))]
                    blocks.append(_keys_table(keys(within)))
    for role in _roles(Scenario):
        blocks += _role(role)
    return page_of(blocks)


def _roles(model: Model) -> list[str]:
    """The roles of the parts that a section names, and of those that these name in turn."""
    found: dict[str, None] = {}
    for role in _named(model):
        found.setdefault(role)
    return list(found)


def _named(model: Model) -> Iterator[str]:
    for key in keys(model):
        for section in key.sections:
            yield from _named(section)
        if key.part:
            yield key.part.role
            for entry in registry_of(key.part.role):
                yield from (inner.part.role for inner in keys_of_kind(entry) if inner.part)


def _role(role: str) -> Iterator[str]:
    entries = list(registry_of(role))
    yield f"## {_title(role)}"
    yield _kinds_table(role, entries)
    for entry in entries:
        more, own = _paragraphs(text_of(entry.item))[1:], keys_of_kind(entry)
        if more or own:
            yield f"### {role}: `{entry.kind}`"
            yield from more
            if own:
                yield _keys_table(own)


def _title(role: str) -> str:
    return f"Kinds of {role}"


def _kinds_table(role: str, entries: Sequence[Entry[Any]]) -> str:
    texts = {e.kind: next(iter(_paragraphs(text_of(e.item))), "") for e in entries}
    if role != _OBSERVED:
        return table(("Kind", "What it is"), ((f"`{k}`", text) for k, text in texts.items()))
    headings = ("Kind", "Numbers", "Unit", "Range", "Divided by", "What it is")
    worlds = {kind: _Observed(kind) for kind in texts}
    rows = ((f"`{kind}`", *worlds[kind].cells, text) for kind, text in texts.items())
    return table(headings, rows)


def _keys_table(found: Sequence[Key]) -> str:
    return table(
        _KEY_HEADINGS,
        (
            (
                f"`{key.name}`",
                key.unit or "–",
                _range(key),
                key.plausible_text or "–",
                _default(key.default),
                markdown_text(key.text),
            )
            for key in found
        ),
    )


def _range(key: Key) -> str:
    if key.part is None:
        return key.range_text
    title = _title(key.part.role)
    link = f"[{key.part.role}](#{title.lower().replace(' ', '-')})"
    if key.is_list:
        return f"list: {link}, by word or mapping"
    return f"{link}, by word or mapping" if key.part.is_word else link


def _default(value: Any) -> str:
    if value is ...:
        return "–"
    if isinstance(value, bool) or value is None:
        return f"`{ {True: 'true', False: 'false', None: 'null'}[value] }`"
    if isinstance(value, dict):
        return "`{" + ", ".join(f"{key}: {inner}" for key, inner in value.items()) + "}`"
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return f"`{text}`" if text else "empty"


def _paragraphs(text: str) -> list[str]:
    """A docstring's paragraphs as Markdown; what is indented stays as it is."""
    paragraphs = [part for part in re.split(r"\n\s*\n", text) if part.strip()]
    return [p if p.startswith("    ") else markdown_text(" ".join(p.split())) for p in paragraphs]


class _Observed:
    """What an entry of an observation states of itself in worlds of several sizes."""

    def __init__(self, kind: str) -> None:
        self._kind = kind
        scenario, overrides = EXAMPLE
        self._entry = self._in(load_scenario(scenario, overrides))

    @property
    def cells(self) -> tuple[str, str, str, str]:
        """Number, unit, range, and what the numbers are divided by to be of order one."""
        ranges = self._entry.ranges()
        span = f"{numeral(ranges.low.min())} to {numeral(ranges.high.max())}"
        scales = sorted(set(ranges.scale.tolist()))
        scale = " and ".join(map(numeral, scales))
        return self._numbers(), self._entry.unit or "–", span, scale

    def _numbers(self) -> str:
        """How many numbers, by K nodes and M AUVs: a sum of multiples, found by trying."""
        two_two, more_nodes, more_auvs = (self._size(*sizes) for sizes in ((2, 2), (3, 2), (2, 3)))
        per_node, per_auv = more_nodes - two_two, more_auvs - two_two
        rest = two_two - 2 * per_node - 2 * per_auv
        if self._size(5, 4) != 5 * per_node + 4 * per_auv + rest:
            raise ValueError(f"{self._kind}: not linear in the numbers of nodes and AUVs")
        terms = [(per_node, "K"), (per_auv, "M"), (rest, "")]
        words = [f"{'' if n == 1 and of else n} {of}".strip() for n, of in terms if n]
        return " + ".join(words).replace("+ -", "− ") or "0"

    def _size(self, num_nodes: int, num_auvs: int) -> int:
        sizes = {"nodes.count": num_nodes, "auvs.count": num_auvs}
        size: int = self._in(load_scenario(EXAMPLE[0], EXAMPLE[1] | sizes)).size
        return size

    def _in(self, scenario: Scenario) -> Any:
        seen = {"observation.entries": [self._kind], **NEEDED.get(self._kind, {})}
        return World(load_scenario(scenario, seen)).observer.entries[-1]


#: The tables, by name, with the pages that they stand on.
TABLES: dict[str, tuple[Path, Callable[[], str]]] = {
    "commands": (HERE / "commands.md", commands_reference),
    "conclusions": (HERE / "at-sea.md", conclusions_table),
    "deployments": (HERE / "at-sea.md", deployments_tables),
    "energy at sea": (HERE / "at-sea.md", energy_tables),
    "entries": (HERE / "environment.md", entries_tables),
    "fairness at sea": (HERE / "at-sea.md", fairness_table),
    "life": (HERE / "at-sea.md", life_table),
    "metrics": (HERE / "metrics.md", metrics_table),
    "scenario": (HERE / "scenario.md", scenario_reference),
    "steps": (HERE / "at-sea.md", steps_tables),
    "spaces": (HERE / "environment.md", spaces_tables),
    "pretrained elsewhere": (HERE / "pretrained.md", elsewhere_table),
    "pretrained layouts": (HERE / "pretrained.md", layouts_table),
    "pretrained teams": (HERE / "pretrained.md", teams_table),
    "pretrained unseen": (HERE / "pretrained.md", unseen_table),
    "pretrained-card": (HERE / "pretrained.md", pretrained_card),
    "node-table": (HERE / "environment.md", node_table),
}


def written(name: str) -> str:
    """The page of a table, with the table as it is now."""
    page, make = TABLES[name]
    text = page.read_text(encoding="utf-8")
    pattern = rf"(<!-- {name} -->\n\n).*?(\n<!-- end of {name} -->\n)"
    parts = re.search(pattern, text, re.DOTALL)
    if parts is None:
        raise ValueError(f"{page}: has no place for the table {name}")
    return f"{text[: parts.start()]}{parts[1]}{make()}{parts[2]}{text[parts.end() :]}"


def main() -> None:
    """Write every table."""
    for name, (page, _) in TABLES.items():
        page.write_text(written(name), encoding="utf-8")


if __name__ == "__main__":
    main()
