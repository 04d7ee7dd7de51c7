"""An episode as a web page that plays it, alone or beside another; it needs nothing else."""

from __future__ import annotations

import html
import importlib.resources
import itertools
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from iout_marl.errors import InputError
from iout_marl.files import to_json
from iout_marl.inline import code_for_script, json_for_script
from iout_marl.render import style
from iout_marl.render.hull import hull_svg
from iout_marl.render.labels import current_text, displayable, energy_text
from iout_marl.render.layout import drawn_edges, place_nodes, stretched_axes
from iout_marl.replay.film import TRAIL_SLOTS
from iout_marl.replay.names import short_names
from iout_marl.replay.recording import Recording
from iout_marl.scenario.spacing import edges_m, spacing_text
from iout_marl.words import counted, listed

#: Episodes that a page shows side by side at most.
MOST_EPISODES = 2


#: By what a page is known.
_SIGN = b'<meta name="generator" content="iout_marl replay">'
_SCRIPTS = ("data.js", "space.js", "flat.js", "charts.js", "player.js")


def render_page(recordings: Sequence[Recording]) -> str:
    """The page, an HTML document.

    Args:
        recordings: one episode, or two to be compared.

    Raises:
        InputError: there are none or too many, or their slots are not equally long.
    """
    check_together(recordings)
    shared, own = _facts(recordings)
    names = [displayable(r.scenario) for r in recordings]
    policies = [displayable(name) for name in short_names(recordings)]
    parts = {
        "title": html.escape(f"{names[0]}: {listed(policies)}"),
        "style": _asset("page.css"),
        "data": json_for_script(
            to_json(
                {
                    "scenario": listed(list(dict.fromkeys(names))),
                    "facts": shared,
                    "legend": _legend(recordings),
                    "look": _look(),
                    "episodes": [
                        {**_episode(recording), "policy": policy, "facts": facts}
                        for recording, policy, facts in zip(recordings, policies, own, strict=True)
                    ],
                }
            )
        ),
        "three": code_for_script(_asset("three", "three.min.js")),
        "script": "(() => {\n" + "\n".join(map(_asset, _SCRIPTS)) + "\n})();",
    }
    return re.sub(r"\{\{(\w+)\}\}", lambda found: parts[found[1]], _asset("page.html"))


def is_replay_page(path: Path) -> bool:
    """Whether a file is a page as `render_page` makes it."""
    if not path.is_file():  # a pipe would let it wait
        return False
    try:
        with path.open("rb") as file:
            return _SIGN in file.read(1000)
    except OSError:
        return False


def check_together(recordings: Sequence[Recording]) -> None:
    """See that a page can show these side by side.

    Raises:
        InputError: it cannot.
    """
    if not 1 <= len(recordings) <= MOST_EPISODES:
        raise InputError(f"a replay shows one episode or two, not {len(recordings)}")
    lengths = {recording.slot_s for recording in recordings}
    if len(lengths) > 1:
        raise InputError(
            "a replay has one clock, but slots last "
            + listed([f"{recording.slot_s:g} s" for recording in recordings])
        )


def _asset(*path: str) -> str:
    folder = importlib.resources.files("iout_marl.replay") / "assets"
    return folder.joinpath(*path).read_text(encoding="utf-8")


def _facts(recordings: Sequence[Recording]) -> tuple[str, list[str]]:
    """The scenario in one line: what all episodes share, and of each what is its own."""
    # Heading and legend show what `elsewhere` says, as long as it is the same.
    elsewhere = [(displayable(r.scenario), f"energy full at {_gauge(r)}") for r in recordings]
    facts = [
        (
            *names,
            recording.duplex,
            counted(recording.num_nodes, "node"),
            counted(recording.num_auvs, "AUV"),
            _cells(recording),
            f"{counted(recording.num_slots, 'slot')} of {recording.slot_s:g} s",
            "" if recording.seed is None else f"seed {recording.seed}",
            f"scenario {displayable(recording.scenario_hash)}",
        )
        for names, recording in zip(elsewhere, recordings, strict=True)
    ]
    differ = [len(set(texts)) > 1 for texts in zip(*facts, strict=True)]
    shared = [
        text
        for text, is_own in zip(facts[0], differ, strict=True)
        if not is_own and text not in elsewhere[0]
    ]
    lines = (" · ".join(filter(None, itertools.compress(texts, differ))) for texts in facts)
    return " · ".join(filter(None, shared)), list(lines)


def _cells(recording: Recording) -> str:
    """The grid in words."""
    cells = f"{' × '.join(map(str, recording.grid))} cells of {spacing_text(recording.spacing_m)}"
    stretched = stretched_axes(edges_m(recording.spacing_m))
    return f"{cells}, drawn with {stretched}" if stretched else cells


def _gauge(recording: Recording) -> str:
    """The energy at which the gauge of a node is full."""
    return energy_text(recording.snapshot(0).energy_yardstick_j)


def _legend(recordings: Sequence[Recording]) -> list[tuple[str, str]]:
    """What each kind of mark stands for."""
    oldest = listed(list(dict.fromkeys(f"{r.maximum_age:g}" for r in recordings)))
    gauges = set(map(_gauge, recordings))
    of_what = " or ".join(dict.fromkeys(r.snapshot(0).yardstick_text for r in recordings))
    # Several stand with the facts of each episode.
    gauge = f"{gauges.pop()}, {of_what}" if len(gauges) == 1 else of_what
    return [
        ("age", f"age of a node, 1 to {oldest} slots"),
        ("energy", f"energy stored; full at {gauge}"),
        ("charge", "charging"),
        ("data", "packet arrived"),
        ("fail", "no packet"),
        *_extra_legend(recordings),
    ]


def _extra_legend(recordings: Sequence[Recording]) -> list[tuple[str, str]]:
    """The marks of some scenarios."""
    shown: list[tuple[str, str, list[Any]]] = [
        ("battery", "battery of an AUV; red from 20 % on", [r.battery for r in recordings]),
        ("course", "under way to", [r.transit_slots for r in recordings]),
        ("dock", "dock", [r.docks for r in recordings]),
        ("asleep", "node asleep", [r.asleep for r in recordings]),
    ]
    return [
        (kind, text) for kind, text, values in shown if any(each is not None for each in values)
    ]


def _look() -> dict[str, Any]:
    return {
        "ages": style.AGE_STOPS,
        "energy": style.ENERGY,
        "data": style.DATA,
        "failed": style.FAILED,
        "chosen": style.FAILED,
        "auvs": style.AUVS,
        "low": style.LOW_BATTERY,
        "trail": TRAIL_SLOTS,
        "hull": hull_svg(),
    }


def _episode(r: Recording) -> dict[str, Any]:
    """What the page knows of an episode; lists are flat, slots or places first."""
    return {
        "grid": list(r.grid),
        "slot_s": r.slot_s,
        "max_age": r.maximum_age,
        "over_time": r.ages_over_time,
        "gauge_j": r.snapshot(0).energy_yardstick_j,
        "auvs": r.num_auvs,
        "reasons": [[reason.code, displayable(reason.text)] for reason in r.reasons],
        "nodes": r.nodes.tolist(),
        "places": {
            "above": _node_places(r, [0, 1]),
            "side": _node_places(r, [0, 2]),
        },
        "edges": {
            "above": _drawn_edges(r, [0, 1]),
            "side": _drawn_edges(r, [0, 2]),
            "space": _drawn_edges(r, [0, 1, 2]),
        },
        "path": r.path.ravel().tolist(),
        "stayed": np.where(r.blocked, 2, r.left_grid.astype(int)).ravel().tolist(),
        "charged": r.charged.ravel().tolist(),
        "heard": r.heard.ravel().tolist(),
        "outcome": r.outcome.ravel().tolist(),
        **(_polls(r) if r.polled.shape[2] else {}),
        "beta": _short(r.beta) if r.splits_slot else None,
        "harvested": _short(r.harvested_j),
        "spent": _short(r.spent_j),
        "ages": _short(r.ages),
        "energies": _short(r.energy_j),
        **({} if r.battery is None else {"battery": _short(r.battery)}),
        **({} if r.transit_slots is None else _moves(r)),
        **({} if r.docks is None else {"docks": r.docks.tolist()}),
        **({} if r.current_m_per_s is None else {"currents": _current_texts(r.current_m_per_s)}),
        **({} if r.asleep is None else {"asleep": r.asleep.astype(int).ravel().tolist()}),
    }


def _current_texts(current_m_per_s: npt.NDArray[np.float64]) -> list[str]:
    return [current_text(x, y) for x, y in current_m_per_s.reshape(-1, 2).tolist()]


def _moves(r: Recording) -> dict[str, Any]:
    """Of moves that take several slots: where they are by now, how long they last, and where to."""
    return {
        "spots": _short(r.positions()),
        "transit": np.array(r.transit_slots).ravel().tolist(),
        "heading": np.array(r.heading).ravel().tolist(),
    }


def _polls(r: Recording) -> dict[str, Any]:
    """The same of nodes polled beside."""
    return {
        "rounds": r.polled.shape[2],
        "polled": r.polled.ravel().tolist(),
        "polled_outcome": r.polled_outcome.ravel().tolist(),
        "polled_spent": _short(r.polled_j),
    }


def _node_places(recording: Recording, axes: list[int]) -> list[list[float]]:
    """Centre of each node in cells and its radius in the shortest edges, as seen along an axis."""
    sides = np.array(recording.grid)[axes] * _drawn_edges(recording, axes)
    centres, radii = place_nodes(recording.nodes[:, axes], smallest=0.016 * sides.max())
    return np.column_stack([centres, radii]).round(3).tolist()


def _drawn_edges(recording: Recording, axes: list[int]) -> list[float]:
    """Edges of a cell in a picture that shows these axes."""
    return drawn_edges([edges_m(recording.spacing_m)[axis] for axis in axes]).tolist()


def _short(values: npt.NDArray[np.float64]) -> list[float]:
    """Numbers of four digits, whole ones without a point."""
    numbers = (float(f"{value:.4g}") for value in values.ravel().tolist())
    return [int(number) if number.is_integer() else number for number in numbers]
