"""What slots leave to chance: streams of their own, drawn beforehand, passed in."""

import numpy as np
import pytest

from iout_marl import load_scenario
from iout_marl.core.chance import Chance, Draw
from iout_marl.errors import InputError
from iout_marl.parts.duplex.fdd import FrequencyDivision
from iout_marl.policies import EpisodeStreams
from iout_marl.world import ChanceStream, World, has_chance
from iout_marl.world import chance as chance_of_worlds


@pytest.fixture
def drawing(monkeypatch):
    """A scenario that draws something in each slot, though nothing comes of it."""
    drawn = {"fading": Draw("normal", (1, 3)), "arrival": Draw("uniform", (1, 1))}
    monkeypatch.setattr(FrequencyDivision, "draws", lambda self, scenario: drawn)
    return load_scenario("paper/k3-fdd", {"episode.duration_s": 250})


def streams(*seeds):
    return [np.random.default_rng(seed) for seed in seeds]


def numbers(stream, slots):
    return [next(stream) for _ in range(slots)]


def assert_same(found, expected):
    for one, other in zip(found, expected, strict=True):
        for mine, theirs in zip(one, other, strict=True):
            np.testing.assert_array_equal(mine, theirs)


def test_nothing_is_drawn_where_nothing_is_left_to_chance():
    world = World("paper/k3-fdd", 2)
    assert not has_chance(world.scenario)
    assert (world.chance, world.expected) == ({}, None)
    assert next(world.draw_chance(0)) is None


def test_environments_have_the_same_chance_alone_and_in_a_batch(drawing, monkeypatch):
    monkeypatch.setattr(chance_of_worlds, "_AHEAD", 12)  # three slots
    together = numbers(ChanceStream(drawing, streams(5, 6, 7)), 10)
    assert all(each.fading.shape == (3, 1, 3) for each in together)
    assert all(each.wind.shape == (3, 0) for each in together)
    for i, seed in enumerate((5, 6, 7)):
        alone = numbers(ChanceStream(drawing, streams(seed)), 10)
        assert_same(alone, [each.map(lambda a, i=i: a[i : i + 1]) for each in together])
    flat = np.concatenate([each.fading.ravel() for each in together])
    assert len(np.unique(flat)) == flat.size  # nothing comes twice, and nothing is written over


def test_environments_that_begin_anew_leave_the_others_alone(drawing, monkeypatch):
    monkeypatch.setattr(chance_of_worlds, "_AHEAD", 12)
    through = numbers(ChanceStream(drawing, streams(0, 1)), 8)
    stream = ChanceStream(drawing, streams(0, 1))
    before = numbers(stream, 4)
    kept = [each.map(np.copy) for each in before]
    stream.restart([1], {1: np.random.default_rng(9)})
    after = numbers(stream, 4)
    assert_same(before, kept)
    first = [each.map(lambda a: a[:1]) for each in before + after]
    assert_same(first, [each.map(lambda a: a[:1]) for each in through])
    fresh = numbers(ChanceStream(drawing, streams(9)), 4)
    assert_same([each.map(lambda a: a[1:]) for each in after], fresh)


def test_layouts_and_policies_are_drawn_from_other_streams(drawing):
    rng, other = streams(3, 3)
    chance = next(ChanceStream(drawing, [rng]))
    assert rng.random() == other.random()
    of_policies = EpisodeStreams(3, 1).random((1, 50))
    assert not np.isin(chance.arrival, of_policies).any()


def test_a_world_with_chance_wants_to_be_given_it(drawing):
    world = World(drawing, 2)
    assert has_chance(drawing)
    state, action = world.reset(), np.zeros((2, 1, 3), dtype=np.int64)
    for step in (world.step, world.checked_step):
        with pytest.raises(InputError, match="leaves fading, arrival to chance: pass `chance`"):
            step(state, action)
    with pytest.raises(InputError, match=r"fading must have the shape \(2, 1, 3\)"):
        world.checked_step(state, action, next(World(drawing).draw_chance(0)))
    with pytest.raises(InputError, match="must be a Chance"):
        world.checked_step(state, action, 3)
    for chance in (next(world.draw_chance(0)), world.expected):
        after, _ = world.checked_step(state, action, chance)
        assert after.slot.tolist() == [1, 1]
    assert isinstance(world.expected, Chance)
    assert not world.expected.fading.any()
    assert world.expected.arrival.shape[-1] == 0
