"""A mask leaves out nodes that charging would bring nothing."""

import numpy as np
import pytest

from iout_marl import World, load_scenario
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline

#: Nodes harvest from less than 200 m.
NEAR = {
    "grid.spacing_m": 100,
    "auvs.idle_choices": True,
    "channel.kind": "sonar",
    "channel.spreading_factor": 2.0,
    "harvester": {"kind": "aperture", "area_m2": 0.02, "efficiency": 0.5, "threshold_w": 1e-3},
}
#: Out of that reach of the first three nodes.
FAR = {"auvs.idle_choices": False, "auvs.start_cells": [[10, 10, 1]]}


@pytest.mark.parametrize("motion", ["six", "hover", "planar"])
def test_masked_nodes_would_harvest_nothing_whatever_the_move(motion):
    world = World(load_scenario("paper/k5-fdd", {**NEAR, "auvs.motion": motion}))
    link, masked, left = world.link, 0, 0
    for state, _ in play(world, make_baseline("random-walk")):
        mask = world.action_mask(state)[0, 0]
        to_charge = mask[world.action_sizes[0] :][: world.num_nodes + 1]
        offset = link.offset(world.motion.neighbours(state.cell)[0, 0][:, None], state.node_cell)
        most_w = link.at(link.harvested_w, offset).max(axis=0)
        assert np.array_equal(to_charge[:-1], most_w > 0)
        assert to_charge[-1]
        masked, left = masked + (most_w == 0).sum(), left + (most_w > 0).sum()
    assert masked > 0
    assert left > 0


def test_where_every_node_harvests_something_none_is_masked():
    world = World("paper/k5-fdd")
    for state, _ in play(world, make_baseline("random-walk")):
        first = world.action_sizes[0]
        assert world.action_mask(state)[0, 0, first : first + world.num_nodes].all()


def test_where_an_auv_must_charge_somebody_any_may_be_chosen_far_from_all():
    world = World(load_scenario("paper/k3-fdd", {**NEAR, **FAR}))
    state = world.reset()
    first = world.action_sizes[0]
    assert world.action_mask(state)[0, 0, first : first + world.num_nodes].all()
