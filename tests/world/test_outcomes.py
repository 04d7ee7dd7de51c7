"""Every uplink that fails has a reason, which the parts of the scenario give."""

import numpy as np
import pytest

from iout_marl import InputError, World, parts
from iout_marl.core import reasons
from iout_marl.core.reasons import Reason

ENERGY = {"not_enough_energy", "only_charged", None}
#: Worlds, and the reasons that there are in them.
WORLDS = {
    "fdd-orthogonal": ("paper/k3-fdd", "orthogonal", ENERGY - {"only_charged"} | {"taken"}),
    "fdd-exclusive": (
        "paper/k3-fdd",
        "exclusive",
        {None, "not_enough_energy", "taken", "collision"},
    ),
    "tdd-exclusive": ("best/k5-tdd", "exclusive", {None, "only_charged", "taken", "collision"}),
    "tdd-interference": (
        "best/k5-tdd",
        "interference",
        {None, "only_charged", "taken", "interference", "charging_noise"},
    ),
}


def slots(world, seed=0):
    """States before and after random slots, and what happened in them."""
    rng, state = np.random.default_rng(seed), world.reset(seed=seed)
    shape = world.num_envs, world.num_auvs
    for _ in range(world.num_slots):
        action = np.stack([rng.integers(0, n, shape) for n in world.action_sizes], -1)
        before = state
        state, events = world.step(before, action)
        yield before, events, state


def make(scenario, access):
    return World(scenario, 3, overrides={"channel.access": access, "auvs.count": 3})


@pytest.mark.parametrize("case", WORLDS)
def test_every_failed_uplink_has_a_reason_of_its_world(case):
    scenario, access, expected = WORLDS[case]
    world, seen = make(scenario, access), set()
    for before, events, after in slots(world):
        found = world.outcomes(before, events, after)
        codes = [[reason and reason.code for reason in row] for row in found]
        assert np.array_equal(np.array(codes) == None, events.delivered)  # noqa: E711
        seen |= {code for row in codes for code in row}
    assert seen == expected


@pytest.mark.slow
@pytest.mark.parametrize("case", WORLDS)
def test_reasons_hold_by_what_the_slot_shows(case):
    """Said from the positions, energies and choices alone, by loops."""
    world = make(*WORLDS[case][:2])
    cells = world.grid.coordinate_table()
    for before, events, after in slots(world, seed=4):
        found = world.outcomes(before, events, after)
        for env in range(world.num_envs):
            heard, cell = events.heard[env], cells[after.cell[env]]
            for auv, reason in enumerate(found[env]):
                node = heard[auv]
                rivals = [a for a in range(world.num_auvs) if heard[a] == node and a != auv]
                if reason is reasons.TAKEN:
                    at = cells[before.node_cell[env, node]]
                    own = np.sum((cell[auv] - at) ** 2)
                    assert any(np.sum((cell[a] - at) ** 2) <= own for a in rivals)
                if reason is reasons.NO_ENERGY:
                    metres = np.linalg.norm(cell[auv] - cells[before.node_cell[env, node]])
                    budget = world.link.budget
                    per_snr_w = budget.power_per_snr_w(metres * world.scenario.grid.spacing_m)
                    cost_j = budget.required_energy_j(per_snr_w, world.link.slot_s)
                    assert events.available_j[env, node] <= cost_j * (1 + 1e-9)
                if reason is reasons.ONLY_CHARGED:
                    assert events.beta[env, auv] == 1
                if reason is reasons.COLLISION:
                    assert np.count_nonzero(events.spent_j[env]) >= 2
                if reason is reasons.CHARGING_NOISE:
                    assert (events.beta[env] > events.beta[env, auv]).any()
                if reason in (reasons.INTERFERENCE, reasons.CHARGING_NOISE):
                    assert events.spent_j[env, auv] == 0


def test_a_part_from_outside_adds_its_own(forgotten_parts):
    ship = Reason("ship", "a ship passed by")

    @parts.access_rules.register("jammed", version=1)
    class Jammed(parts.Access):
        def __call__(self, request, split):
            nothing = request.sends & False
            return parts.Uplinks(nothing, self.xp.where(nothing, split.required_j, self._zero))

        def why_lost(self, request, split):
            return {**super().why_lost(request, split), ship: request.sends}

    world = World("paper/k3-fdd", overrides={"channel.access": "jammed"})
    found = {world.outcomes(*slot)[0][0] for slot in slots(world)}
    assert found == {ship, reasons.NO_ENERGY}


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (lambda r: ["lost"], "reasons must be a mapping from Reason to flags, not list"),
        (lambda r: {"lost": r.sends}, "reason 'lost' must have flags of shape (1, 1)"),
        (lambda r: {reasons.TAKEN: True}, "must have flags of shape (1, 1)"),
    ],
    ids=["no-mapping", "no-reason", "no-array"],
)
def test_a_part_from_outside_that_gives_no_reasons_is_named(forgotten_parts, given, message):
    @parts.access_rules.register("odd", version=1)
    class Odd(parts.Access):
        def __call__(self, request, split):
            return parts.Uplinks(request.sends & False, split.required_j * 0)

        def why_lost(self, request, split):
            return given(request)

    world = World("paper/k3-fdd", overrides={"channel.access": "odd"})
    with pytest.raises(InputError, match="access 'odd': ") as raised:
        [world.outcomes(*slot) for slot in slots(world)]
    assert message in str(raised.value)


def test_a_part_from_outside_that_says_nothing(forgotten_parts):
    @parts.access_rules.register("mute", version=1)
    class Mute(parts.Access):
        def __call__(self, request, split):
            return parts.Uplinks(request.sends & False, split.required_j * 0)

    world = World("paper/k3-fdd", overrides={"channel.access": "mute"})
    found = {world.outcomes(*slot)[0][0] for slot in slots(world)}
    assert found == {reasons.NOT_STATED, reasons.NO_ENERGY}


@pytest.mark.parametrize("code", ["", "Not A Word", "9lives", 3])
def test_codes_are_words(code):
    with pytest.raises(InputError, match="a code is a word"):
        Reason(code, "text")


def test_texts_are_words():
    with pytest.raises(InputError, match="reason lost: its text must be words, not ' '"):
        Reason("lost", " ")
