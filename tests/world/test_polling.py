"""AUVs that poll: who is heard, in what order, and who says so."""

import numpy as np
import pytest
import torch
from polling import MODEM, polling

from iout_marl import InputError, Trainer, World, evaluate, iout_v0, load_scenario
from iout_marl.breakdown import Tally
from iout_marl.envs import AUVEnv, AUVVectorEnv
from iout_marl.evaluation import play
from iout_marl.policies import make_baseline
from iout_marl.testing import check_parallel_env, check_vector_env
from iout_marl.tracing.unrolled import unrolled_slot

WORLDS = ("paper/k5-fdd", "paper/k5-tdd")
every_world = pytest.mark.parametrize("name", WORLDS)
#: Along the first row: each node alone in its cell, the AUV in that of the first.
ROW = {"nodes.cells": [[1, 1, 1], [2, 1, 1], [3, 1, 1], [4, 1, 1], [9, 9, 4]]}
STAYS = {"auvs.motion": "hover", "auvs.start_cells": [[1, 1, 1]]}
#: Every node has energy for a packet, from the first slot on.
RICH = {"storage": {"kind": "capacitor", "capacity_j": 1e4, "initial_j": 1e4}}


def world_of(most, name="paper/k5-fdd", envs=1, library=np, **changes):
    return World(load_scenario(name, polling(most, name, **changes)), envs, library)


def actions_of(world, slots=40, seed=0):
    rng = np.random.default_rng(seed)
    shape = (slots, world.num_envs, world.num_auvs)
    return np.stack([rng.integers(0, n, shape) for n in world.action_sizes], axis=-1)


def played(world, actions):
    state = world.reset(seed=0)
    for action in actions:
        before = state
        state, events = world.step(before, world.backend.integers(action))
        yield before, events, state


def aged(world, *ages):
    """The first state, with these ages."""
    state = world.reset()
    return state._replace(age=world.backend.floats([ages]))


def test_the_chosen_node_comes_first_then_the_oldest_and_of_equals_the_lowest():
    world = world_of(4, **ROW, **STAYS, **RICH)
    state = aged(world, 3, 7, 9, 7, 2)
    after, events = world.step(state, np.array([[[6, 0, 4]]]))
    assert events.delivered.item()
    # The first column would be that of a node in the place of the chosen one.
    assert events.polled[0, 0].tolist() == [5, 2, 1, 3]
    assert events.polled_delivered[0, 0].tolist() == [False, True, True, True]
    assert after.age[0].tolist() == [4, 1, 1, 1, 1]
    assert after.deliveries[0].tolist() == [0, 1, 1, 1, 1]
    spent_j = events.spent_j.sum() + events.polled_j.sum()
    assert spent_j == pytest.approx((events.available_j - after.energy_j).sum())


def test_a_chosen_node_that_cannot_pay_is_skipped_with_its_reason_and_others_are_polled():
    world = world_of(2, **ROW, **STAYS, **RICH)
    state = aged(world, 3, 7, 9, 7, 2)
    poor = state.energy_j.copy()
    poor[0, [2, 4]] = 0
    state = state._replace(energy_j=poor)
    after, events = world.step(state, np.array([[[6, 0, 4]]]))
    assert not events.delivered.item()
    assert events.spent_j.item() == 0
    assert events.polled[0, 0].tolist() == [1, 3]
    assert world.outcomes(state, events, after)[0][0].code == "not_enough_energy"
    assert world.polled_outcomes(state, events, after) == [[[None, None]]]


def test_packets_take_the_time_that_there_is():
    """Packets of 20 s and the way: two in a slot of 50 s."""
    slow = {**MODEM["uplink"], "bit_rate_bps": 400.0}
    world = world_of(5, uplink=slow, **ROW, **STAYS, **RICH)
    after, events = world.step(world.reset(), np.array([[[6, 0, 0]]]))
    assert after.deliveries.sum() == 2
    assert events.polled[0, 0].tolist() == [5, 1, 5, 5, 5]


def test_call_and_answer_take_time_too():
    """Without them the second packet would just fit."""
    lasts = float(World(load_scenario("paper/k5-fdd", MODEM)).link.least_uplink_s.min())
    for slots, expected in ((2.0, 1), (2.01, 2)):
        world = world_of(2, **{"episode.slot_s": lasts * slots}, **ROW, **STAYS, **RICH)
        after, _ = world.step(world.reset(), np.array([[[6, 0, 0]]]))
        assert after.deliveries.sum() == expected


def test_in_time_division_they_share_what_charging_leaves():
    world = world_of(5, "paper/k5-tdd", **ROW, **STAYS, **RICH)
    for beta_max, expected in ((0.94, 1), (0.88, 2), (0.5, 5)):
        world = world_of(5, "paper/k5-tdd", **{"duplex.beta_max": beta_max}, **ROW, **STAYS, **RICH)
        after, events = world.step(world.reset(), np.array([[[6, 0]]]))
        assert events.beta.item() == pytest.approx(beta_max)
        assert after.deliveries.sum() == expected


def test_where_the_whole_slot_is_for_charging_nobody_is_heard():
    world = world_of(5, "paper/k5-tdd", **ROW, **STAYS, **RICH)
    state = world.reset()
    poor = state.energy_j.copy()
    poor[0, 4] = 0  # in the farthest corner
    after, events = world.step(state._replace(energy_j=poor), np.array([[[6, 4]]]))
    assert events.beta.item() == 1
    assert after.deliveries.sum() == 0


@every_world
def test_who_names_nobody_polls_nobody(name):
    world = world_of(3, name, **{"auvs.idle_choices": True}, **RICH)
    nobody = world.num_nodes
    action = np.full((1, 1, len(world.action_sizes)), nobody)
    action[..., 0] = 0
    after, events = world.step(world.reset(), action)
    assert (events.polled == nobody).all()
    assert after.deliveries.sum() == 0
    assert world.metrics(after)["uplink_success"] == 0


@every_world
@pytest.mark.parametrize("sampling", ["slot_end", "packet_start"])
def test_one_at_most_is_as_one_where_the_chosen_node_can_pay(name, sampling):
    """To the last bit, whatever is drawn."""
    changes = {"age.sampling": sampling, **RICH}
    polls = world_of(1, name, 3, **changes)
    one = World(load_scenario(polls.scenario, {"hearing": "one"}), 3)
    actions = actions_of(one)
    for ours, theirs in zip(played(polls, actions), played(one, actions), strict=True):
        assert ours[1].delivered.all()
        for mine, other in zip(ours[1:], theirs[1:], strict=True):
            fields = set(type(mine)._fields) - {"polled", "polled_delivered", "polled_j"}
            for field in fields:
                assert np.array_equal(getattr(mine, field), getattr(other, field)), field


def test_ages_are_from_the_starts_of_packets_which_end_with_the_slot():
    world = world_of(3, **{"age.sampling": "packet_start"}, **ROW, **STAYS, **RICH)
    after, _ = world.step(aged(world, 3, 7, 9, 7, 2), np.array([[[6, 0, 4]]]))
    lasts_s = [
        world.link.least_uplink_s[world.link.offset(after.cell[0, 0], after.node_cell[0, node])]
        for node in (4, 2, 1)
    ]
    for i, node in enumerate((4, 2, 1)):
        assert after.age[0, node] * world.link.slot_s == pytest.approx(sum(lasts_s[i:]))


@pytest.mark.parametrize("auvs", [1, 3])
def test_success_is_a_share_of_the_packets_asked_for(auvs):
    world = world_of(3, envs=4, **{"auvs.count": auvs, "channel.access": "exclusive"})
    asked = arrived = 0
    slots = list(played(world, actions_of(world)))
    after = slots[-1][2]
    for _, events, _ in slots:
        asked = asked + auvs + (events.polled < world.num_nodes).sum(axis=(1, 2))
        arrived = arrived + events.delivered.sum(axis=1)
        arrived = arrived + events.polled_delivered.sum(axis=(1, 2))
    assert world.metrics(after)["uplink_success"] == pytest.approx(arrived / asked)
    assert (arrived == after.deliveries.sum(axis=1)).all()
    assert (world.metrics(after)["uplink_success"] < 1).all()


def test_two_auvs_share_the_nodes_between_them_and_the_nearest_gets_one_that_both_want():
    world = world_of(
        3, **ROW, **RICH, **{"auvs.start_cells": [[1, 1, 1], [4, 1, 1]], "auvs.motion": "hover"}
    )
    after, events = world.step(aged(world, 2, 9, 8, 2, 1), np.array([[[6, 0, 0], [6, 0, 3]]]))
    # Both would have node 1 first, which is nearer to the first AUV, and then node 4.
    assert events.polled[0].tolist() == [[5, 1, 5], [5, 2, 4]]
    assert after.deliveries.sum() == 5


def test_under_exclusive_access_a_collision_ends_it_and_has_its_reason():
    team = {"auvs.start_cells": [[1, 1, 1], [4, 1, 1]], "auvs.motion": "hover"}
    world = world_of(3, **ROW, **RICH, **team, **{"channel.access": "exclusive"})
    state = world.reset()
    after, events = world.step(state, np.array([[[6, 0, 0], [6, 0, 3]]]))
    assert after.deliveries.sum() == 0
    assert (events.spent_j > 0).all()
    assert (events.polled == 5).all()
    poor = state.energy_j.copy()
    poor[0, 0] = 0
    state = state._replace(energy_j=poor)
    after, events = world.step(state, np.array([[[6, 4, 0], [6, 4, 3]]]))
    # In the place of the node that cannot pay another one sends: at the same time as node 3.
    assert events.polled[0].tolist() == [[1, 5, 5], [5, 5, 5]]
    (first, second), *_ = world.polled_outcomes(state, events, after)
    assert [reason and reason.code for reason in first] == ["collision", None, None]
    assert second == [None, None, None]


@pytest.mark.slow
@every_world
@pytest.mark.parametrize("auvs", [1, 2])
def test_torch_and_the_traced_slot_agree(name, auvs):
    changes = {"auvs.count": auvs, "age.sampling": "packet_start", "charging.power_w": 8000}
    world, other = (world_of(3, name, library=library, **changes) for library in (np, torch))
    slot, actions = unrolled_slot(world.scenario), actions_of(world)
    assert slot is not None
    pairs = zip(played(world, actions), played(other, actions), actions, strict=True)
    polled = 0
    for (before, events, after), (_, their_events, theirs), action in pairs:
        polled += events.polled_delivered.sum()
        flat = tuple(x for array in before for x in np.asarray(array).ravel().tolist())
        numbers, of_events, *_ = slot(flat, action.ravel().tolist())
        for mine, traced, torchs in (
            (after, slot.state(numbers), theirs),
            (events, slot.events(of_events), their_events),
        ):
            for field in type(mine)._fields:
                expected = getattr(mine, field)
                assert np.array_equal(getattr(traced, field), expected), field
                np.testing.assert_allclose(getattr(torchs, field), expected, 1e-12, err_msg=field)
    assert polled > 10


def test_info_breakdown_and_energies_count_every_packet():
    scenario = load_scenario(
        "paper/k5-fdd", polling(3, **{"auvs.count": 2, "charging.power_w": 4000})
    )
    world = World(scenario)
    slots = list(play(world, make_baseline("greedy"), 0))
    tally = Tally(world, slots[0][0])
    for state, events in slots[1:]:
        tally.add(state, events)
    found = tally.result(slots[-1][0])
    last = slots[-1][0]
    assert found.auvs["packets"].sum() == last.deliveries.sum() > len(slots)
    assert found.nodes["spent_j"].sum() == pytest.approx(last.spent_j.sum())
    gained_j = found.nodes["harvested_j"] - found.nodes["spent_j"]
    np.testing.assert_allclose(gained_j, last.energy_j, atol=1e-6)
    env = iout_v0.parallel_env(scenario)
    env.reset(seed=0)
    state, received = world.reset(seed=0), 0
    for action in actions_of(world):
        state, _ = world.step(state, action)
        *_, infos = env.step(dict(zip(env.agents, action[0], strict=True)))
        received += sum(info["delivered"] for info in infos.values())
        assert received == state.deliveries.sum()
    assert received > 0


def test_rewards_count_each_node_served_too_often():
    world = world_of(3, **ROW, **STAYS, **RICH, **{"episode.duration_s": 300})
    state = world.reset()
    state = state._replace(deliveries=state.deliveries + np.array([[0, 9, 0, 9, 9]]))
    after, events = world.step(state, np.array([[[6, 0, 4]]]))
    assert events.polled[0, 0].tolist() == [5, 0, 1]
    penalty = world.scenario.reward.occurrence_penalty
    assert world.reward_terms(after, events)["occurrence"].item() == -2 * penalty


@pytest.mark.slow
@every_world
@pytest.mark.parametrize("policy", ["random-walk", "greedy", "round-robin", "tour", "planner"])
def test_policies_play(name, policy):
    scenario = load_scenario(name, polling(3, name, **{"episode.duration_s": 1000}))
    assert evaluate(scenario, policy, 1).metrics["mean_aoi"].mean >= 1


@pytest.mark.parametrize("changes", [{}, {"age.sampling": "packet_start", "auvs.count": 2}])
def test_trainings_go_on_from_where_they_were(tiny, changes):
    first, second = (Trainer(tiny(polling(2, "paper/k3-fdd", **changes)), seed) for seed in (0, 1))
    first.iterate()
    saved = first.state_dict()
    assert saved["collector"]["state"]["polled"].sum() >= 0
    second.load_state_dict(saved)
    first.iterate()
    second.iterate()
    expected = first.weights()
    assert all(torch.equal(tensor, expected[name]) for name, tensor in second.weights().items())


def test_ordinary_worlds_have_nothing_of_it():
    world = World("paper/k3-fdd", 2)
    state = world.reset()
    assert state.polled.size == 0
    _, events = world.step(state, np.zeros((2, 1, 3), dtype=np.int64))
    assert events.polled.shape == events.polled_j.shape == (2, 1, 0)
    assert events.polled_delivered.dtype == np.bool_
    assert load_scenario("paper/k3-fdd", {"hearing": "one"}).hash == world.scenario.hash
    polls = load_scenario("paper/k3-fdd", polling(1))
    assert load_scenario(polls, {"hearing": "one"}).world_hash != polls.world_hash


@pytest.mark.parametrize(
    ("message", "changes"),
    [
        (
            "hearing.kind: 'polling' needs packets that take a time.*one of 'shannon' takes all",
            {"hearing": {"kind": "polling", "max_nodes_per_slot": 2}},
        ),
        (
            "'modem' does not raise its level against other uplinks",
            polling(2, **{"auvs.count": 2, "channel.access": "interference"}),
        ),
        (
            r"hearing\.max_nodes_per_slot: .*greater than or equal to 1|from 1",
            polling(0),
        ),
        ("hearing.max_nodes_per_slot: is missing", {**MODEM, "hearing": "polling"}),
    ],
)
def test_what_cannot_work_is_said_in_one_line(message, changes):
    with pytest.raises(InputError, match=message) as error:
        load_scenario("paper/k5-fdd", changes)
    assert "\n" not in str(error.value)


def test_a_single_auv_may_poll_under_interference():
    world = world_of(3, **ROW, **STAYS, **RICH, **{"channel.access": "interference"})
    after, _ = world.step(world.reset(), np.array([[[6, 0, 4]]]))
    assert after.deliveries.sum() == 3


@pytest.mark.slow
@every_world
def test_environments_keep_their_contracts(name):
    changes = {"auvs.count": 2, "episode.duration_s": 1000, "charging.power_w": 4000}
    scenario = load_scenario(name, polling(3, name, **changes))
    check_parallel_env(lambda: iout_v0.parallel_env(scenario))
    check_vector_env(lambda: AUVVectorEnv(scenario, 3), lambda: AUVEnv(scenario), seeds=(7,))


@pytest.mark.slow
@every_world
def test_the_slot_is_one_graph(name):
    changes = {"auvs.count": 2, "age.sampling": "packet_start", "charging.power_w": 4000}
    world = world_of(2, name, 3, torch, **changes)
    torch.compiler.reset()
    slot = torch.compile(world.slot, fullgraph=True, backend="eager")
    first, *actions = actions_of(world, slots=10)
    # A state of which no slot has been played lies in memory otherwise: a graph of its own.
    expected = state = world.slot(world.reset(seed=0), world.backend.integers(first))[0]
    for action in actions:
        state, *_ = slot(state, world.backend.integers(action))
        expected, *_ = world.slot(expected, world.backend.integers(action))
    assert all(map(torch.equal, state, expected))
