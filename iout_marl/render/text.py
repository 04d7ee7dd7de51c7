"""An environment as text for a terminal: the map from above, the AUVs, the nodes."""

from __future__ import annotations

import math
import sys
from collections import defaultdict

from rich.cells import cell_len, set_cell_size

from iout_marl.render.labels import (
    age_text,
    auv_name,
    current_text,
    energy_text,
    number_text,
    shortened,
    total_energy_text,
)
from iout_marl.render.snapshot import Integers, Snapshot
from iout_marl.words import counted

MAX_COLUMNS = 100
MAX_MAP_ROWS = 40
MAX_NODES = 40
MAX_AUVS = 12

_BAR_LENGTH = 14


def as_text(snapshot: Snapshot) -> str:
    """The environment as plain characters, in lines of at most `MAX_COLUMNS`.

    The map shows x to the right and y up; depth z is in the tables. A number on the map
    is a node, `@` the AUV, or A, B, … where there are several, and `+` stands for what
    does not fit. Tables that are too long are cut short, maps that are too large scaled.
    """
    snapshot = snapshot.drawable()
    names = _auv_names(snapshot)
    lines = [
        _header(snapshot),
        "",
        *_map(snapshot, names),
        "",
        *_auv_table(snapshot, names),
        "",
        *_node_table(snapshot, names),
    ]
    return "\n".join(_fitted(line) for line in lines)


def _auv_names(s: Snapshot) -> list[str]:
    return ["@"] if s.num_auvs == 1 else [auv_name(i) for i in range(s.num_auvs)]


def _fitted(line: str) -> str:
    line = line.rstrip()
    if cell_len(line) > MAX_COLUMNS:
        line = set_cell_size(line, MAX_COLUMNS - 1) + "…"
    return line


def print_text(text: str) -> None:
    """Print a text; what the encoding of standard output lacks is shown as `?`."""
    stream = sys.stdout
    if stream is not None:  # as in a process without a terminal
        encoding = getattr(stream, "encoding", None) or "utf-8"
        stream.write(text.encode(encoding, "replace").decode(encoding) + "\n")


def _header(s: Snapshot) -> str:
    return "   ".join(
        [
            shortened(s.title, 32),
            s.duplex,
            f"slot {s.slot}/{s.num_slots}",
            f"mean AoI {number_text(s.mean_age, 2)}",
            f"Jain {s.jain:.2f}",
            f"harvested {total_energy_text(s.total_harvested_j)}",
        ]
    )


def _map(s: Snapshot, names: list[str]) -> list[str]:
    """The grid from above. Where it is too large, a place stands for a square of cells."""
    size_x, size_y, _ = s.grid_shape
    gutter = len(str(size_y)) + 4
    room = MAX_COLUMNS - gutter
    digits = len(str(s.num_nodes))
    # A place holds a blank, a node's number and beside it an AUV, if the grid is not wide.
    width = max(digits + 1, min(digits + 2, room // size_x))
    scale = max(math.ceil(size_x / (room // width)), math.ceil(size_y / MAX_MAP_ROWS))
    columns, rows = math.ceil(size_x / scale), math.ceil(size_y / scale)

    nodes = _by_place(s.node_positions, scale)
    auvs = _by_place(s.auv_positions, scale)
    lines = []
    for row in reversed(range(rows)):
        places = "".join(
            _place([names[i] for i in auvs[column, row]], nodes[column, row], width)
            for column in range(columns)
        )
        label = "y" if row == rows - 1 else " "
        lines.append(f"{label}{1 + row * scale:>{gutter - 3}} |{places}")
    lines.append(f"{'x':<{gutter}}{_ruler(columns, scale, width)}")
    if scale > 1:
        lines.append(f"{'':{gutter}}one place is {scale} x {scale} cells")
    return lines


def _by_place(positions: Integers, scale: int) -> dict[tuple[int, int], list[int]]:
    """Indices of what lies in each place of the map."""
    places: dict[tuple[int, int], list[int]] = defaultdict(list)
    for index, (x, y) in enumerate((positions[:, :2] - 1) // scale):
        places[int(x), int(y)].append(index)
    return places


def _place(auvs: list[str], nodes: list[int], width: int) -> str:
    """What stands in a place of the map, `width` characters."""
    numbers = [str(node + 1) for node in nodes]
    content = "".join([*auvs, *numbers]) or "."
    # Two of a kind side by side would read as one, so would two places without a blank.
    if len(auvs) > 1 or len(numbers) > 1 or len(content) >= width:
        content = [*auvs, *numbers][0] + "+"
    return f"{content if len(content) <= width else '+':>{width}}"


def _ruler(columns: int, scale: int, width: int) -> str:
    """The numbers of x below the map, as many as fit."""
    widest = len(str(1 + (columns - 1) * scale))
    every = math.ceil((widest + 1) / width)
    ruler = ""
    for column in range(0, columns, every):
        ruler += f"{1 + column * scale:>{(column + 1) * width - len(ruler)}}"
    return ruler


def _auv_table(s: Snapshot, names: list[str]) -> list[str]:
    charged = dict(s.charging())
    heard: dict[int, list[tuple[int, bool]]] = defaultdict(list)
    for auv, node, arrived in s.hearing():
        heard[auv].append((node, arrived))
    lines = []
    for auv, name in enumerate(names[:MAX_AUVS]):
        asked: list[tuple[int | None, bool]] = [*heard[auv]] or [(None, False)]
        words = [f"AUV {name:<2} {_cell(s.auv_positions[auv]):<12}"]
        if s.transit_slots is not None and s.headings is not None and s.under_way[auv]:
            left = counted(int(s.transit_slots[auv]), "slot")
            words.append(f"to {_cell(s.headings[auv])} in {left}")
        if s.heard is not None:
            chosen, arrived = asked[0]
            polled = heard[auv][1:]
            words.append(f"charged {charged[auv] + 1 if auv in charged else '-':<3}")
            words.append(f"heard {'-' if chosen is None else chosen + 1:<3}")
            words.append(
                "delivered" if arrived else "nobody asked" if chosen is None else "no packet"
            )
            if polled:
                words.append("polled " + ", ".join(_polled(*each) for each in polled))
        if s.splits_slot and s.beta is not None:
            words.append(f"beta {s.beta[auv]:.2f}")
        if s.battery is not None:
            share = s.battery[auv]
            words.append(f"battery {share:.0%}" if share > 0 else "battery empty")
        if s.currents is not None:
            words.append(f"current {current_text(*s.currents[auv])}")
        if condition := s.condition(auv):
            words.append(condition)
        lines.append("  ".join(words))
    if s.num_auvs > MAX_AUVS:
        lines.append(f"… and {s.num_auvs - MAX_AUVS} more AUVs")
    return lines


def _polled(node: int, arrived: bool) -> str:  # noqa: FBT001
    return f"{node + 1}" if arrived else f"{node + 1} (lost)"


def _node_table(s: Snapshot, names: list[str]) -> list[str]:
    full_j = s.energy_yardstick_j
    age_title = f"age, full {number_text(s.maximum_age)}"
    energy_title = f"energy, full {energy_text(full_j)}"
    lines = [f"node  cell x,y,z    {age_title:<20} {energy_title:<26} last slot"]
    for node in range(min(s.num_nodes, MAX_NODES)):
        age, energy_j = float(s.ages[node]), float(s.energies_j[node])
        lines.append(
            f"{node + 1:>4}  {_cell(s.node_positions[node]):<12} "
            f"{age_text(age):>4} {_bar(age / s.maximum_age)}  "
            f"{energy_text(energy_j):>8} {_bar(energy_j / full_j)}    {_marks(s, node, names)}"
        )
    if s.num_nodes > MAX_NODES:
        lines.append(f"… and {s.num_nodes - MAX_NODES} more")
    return lines


def _marks(s: Snapshot, node: int, names: list[str]) -> str:
    """What happened to a node in the last slot, and through whom if there are several AUVs."""
    done = {
        "charged": [names[auv] for auv, other in s.charging() if other == node],
        "heard": [names[auv] for auv, other, _ in s.hearing() if other == node],
        "delivered": [
            names[auv] for auv, other, arrived in s.hearing() if other == node and arrived
        ],
    }
    marks = [
        f"{what} {','.join(by)}" if s.num_auvs > 1 else what for what, by in done.items() if by
    ]
    if s.asleep is not None and s.asleep[node]:
        marks.append("asleep")
    return "  ".join(marks)


def _cell(position: Integers) -> str:
    return ",".join(str(c) for c in position)


def _bar(share: float) -> str:
    """A bar of fixed length; a `+` at its end says that it would be longer."""
    filled = min(math.ceil(share * _BAR_LENGTH - 1e-9), _BAR_LENGTH)
    bar = "#" * filled + "." * (_BAR_LENGTH - filled)
    return bar[:-1] + "+" if share > 1 else bar
