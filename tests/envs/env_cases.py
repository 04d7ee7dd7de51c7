"""Scenarios on which the APIs are tested: short episodes, every option that shapes an API."""

import functools
import itertools

from iout_marl import load_scenario

SLOTS = 10
#: Start cells of one AUV and of three; the second of the three starts at a node.
STARTS = {1: [[5, 5, 2]], 3: [[5, 5, 2], [1, 1, 1], [9, 9, 4]]}
RICH = {
    "observation.kind": "scaled",
    "observation.node_positions": True,
    "observation.time": True,
    "observation.agent_index": True,
    "observation.view_range_m": 300,
    "reward.credit": "difference",
}
LAYOUTS = {
    "fixed": {},
    "episode": {"nodes": {"kind": "random", "count": 3, "redraw": "episode"}} | RICH,
    "run": {"nodes": {"kind": "random", "count": 3, "redraw": "run"}},
}
MASKS = ("none", "info", "observation")


def scenario(duplex="fdd", auvs=1, layout="fixed", mask="none", slots=SLOTS, **changes):
    """A scenario of the paper with three nodes, and with the options named."""
    settings = {
        "auvs.start_cells": STARTS[auvs],
        "observation.action_mask": mask,
        "episode.duration_s": 25 * slots,
    }
    return load_scenario(f"paper/k3-{duplex}", settings | LAYOUTS[layout] | changes)


TABLE = {"observation.kind": "table"}
#: By name: every combination, but for layouts of the run, which shape no observation; and a few
#: in which an AUV may name nobody, or sees node tables.
CASES = {
    "-".join(map(str, case)): (case, {})
    for case in itertools.product(("fdd", "tdd"), STARTS, LAYOUTS, MASKS)
    if case[2:] not in (("run", "info"), ("run", "observation"))
} | {
    f"nobody-{'-'.join(map(str, case))}": (case, {"auvs.idle_choices": True})
    for case in (
        ("fdd", 1, "fixed", "none"),
        ("fdd", 3, "episode", "observation"),
        ("tdd", 1, "episode", "info"),
        ("tdd", 3, "fixed", "info"),
    )
}
CASES |= {
    f"table-{'-'.join(map(str, case))}": (case, TABLE | changes)
    for case, changes in {
        ("fdd", 1, "fixed", "none"): {},
        ("tdd", 3, "run", "info"): {"observation.view_range_m": 300},
        ("fdd", 3, "fixed", "observation"): {"auvs.idle_choices": True},
        ("tdd", 1, "fixed", "observation"): {"observation.form": "flat"},
    }.items()
}


@functools.cache
def case_scenario(name):
    """The scenario of one of `CASES`."""
    case, changes = CASES[name]
    return scenario(*case, **changes)
