"""Each contract can fail, in one line that names role, kind, contract and where."""

import itertools
from typing import Annotated

import numpy as np
import pytest
from pydantic import Field

from iout_marl import InputError, parts
from iout_marl.parts.beta_rule.paper import PaperRule
from iout_marl.parts.channel.table import Table
from iout_marl.testing import check_part

COUNTER = itertools.count()


@pytest.fixture
def registered():
    """Registers parts under the name `mine` for the time of a test."""
    registries = []

    def register(registry, part):
        registries.append(registry)
        registry.register("mine", version=1)(part)

    yield register
    for registry in registries:
        registry.unregister("mine")


def reward(function, **members):
    """A reward of one term for all AUVs alike."""
    members["__call__"] = lambda part, state, events: {"mine": function(part, state, events)}
    return type("Mine", (parts.Reward,), {"__module__": __name__, **members})


def oldest(part, state):
    return -part.xp.max(state.age, axis=-1, keepdims=True)


REWARDS = {
    "values: the reward must lie": reward(
        lambda part, state, events: oldest(part, state), bounds=lambda *_: {"age.maximum": 8.0}
    ),
    "values: term 'mine' must be finite": reward(
        lambda part, state, events: 1 / (state.slot - 9.0)[:, None]
    ),
    "values: must not change the State": reward(
        lambda part, state, events: (
            np.multiply(state.age, -1, out=state.age)[:, :1]
            if (state.slot > 9).all()
            else state.age[:, :1]
        )
    ),
    "the same twice: slot 0: reward": reward(
        lambda part, state, events: oldest(part, state) + next(COUNTER)
    ),
    "a batch equals single worlds: slot": reward(
        lambda part, state, events: oldest(part, state) * 0 + state.age.mean()
    ),
    "torch equals NumPy: term 'mine' must be an array": reward(
        lambda part, state, events: np.max(np.asarray(state.age), axis=-1, keepdims=True)
    ),
    "permuted nodes: slot": reward(lambda part, state, events: -state.age[:, :1]),
    "permuted AUVs: slot": reward(
        lambda part, state, events: part.xp.cumulative_sum(events.harvested_j, axis=1)
    ),
    "a single environment equals the batch: slot": reward(
        lambda part, state, events: (
            oldest(part, state) * (2.0 if "Symbol" in type(state.age).__name__ else 1.0)
        )
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("contract", REWARDS)
def test_contracts_that_fail(registered, contract):
    registered(parts.rewards, REWARDS[contract])
    with pytest.raises(AssertionError, match=f"^reward 'mine': {contract}.*") as error:
        check_part(parts.rewards, "mine")
    assert str(error.value).isprintable()
    assert " AUV" in str(error.value)


@pytest.mark.slow
def test_a_part_says_what_depends_on_numbers_of_nodes(registered):
    first_counts = reward(lambda part, state, events: -state.age[:, :1], nodes_are_alike=False)
    registered(parts.rewards, first_counts)
    check_part("reward", "mine")


def test_settings_that_are_lost(registered):
    class Settings(parts.Settings):
        weight: Annotated[float, Field(exclude=True)] = 1.0

    mine = reward(lambda part, state, events: oldest(part, state), Settings=Settings)
    registered(parts.rewards, mine)
    with pytest.raises(
        AssertionError, match=r"^reward 'mine': settings: YAML changes the scenario"
    ):
        check_part(parts.rewards, "mine", {"weight": 2.0})


def test_what_does_not_come_into_a_scenario(registered):
    wrong = reward(lambda part, state, events: oldest(part, state), bounds=lambda *_: 3)
    registered(parts.rewards, wrong)
    with pytest.raises(AssertionError, match=r"^reward 'mine': in a scenario: .*bounds\(\) must"):
        check_part(parts.rewards, "mine")
    with pytest.raises(InputError, match=r"^reward 'mine': weight: unknown key"):
        check_part(parts.rewards, "mine", {"weight": 2.0})


def draws(function, redraws="episode"):
    """A placement of two nodes."""

    class Mine(parts.Placement):
        num_nodes = 2
        weights = None

        def draw(self, grid, rng):
            return np.array(function(rng))

    Mine.redraws = redraws
    return Mine


PLACEMENTS = {
    "two nodes in one cell": draws(lambda rng: [[int(rng.integers(2)), 0, 0], [1, 0, 0]]),
    r"seed \d+ gives two layouts": draws(lambda _: [[next(COUNTER) % 3, 0, 0], [3, 0, 0]]),
    "redraws is 'never', but layouts differ": draws(
        lambda rng: [[int(rng.integers(3)), 0, 0], [3, 0, 0]], "never"
    ),
    "redraws is 'run', but 20 seeds give one layout": draws(
        lambda _: [[1, 0, 0], [3, 0, 0]], "run"
    ),
}


@pytest.mark.parametrize("message", PLACEMENTS)
def test_placements(registered, message):
    registered(parts.placements, PLACEMENTS[message])
    with pytest.raises(AssertionError, match=f"^placement 'mine': .*{message}"):
        check_part(parts.placements, "mine")


class Quieter(Table):
    """A channel in which sound grows."""

    def attenuation_db(self, distance_m, frequency_khz):
        return 40 - 0.01 * distance_m


class Pump(parts.Absorption):
    def db_per_km(self, frequency_khz):
        return 3.0 - 0.04 * frequency_khz


class Free(PaperRule):
    """Asks for less than its tables of levels have it."""

    def split(self, *args):
        split = super().split(*args)
        return split._replace(required_j=0.0 * split.required_j)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("registry", "part", "message"),
    [
        (parts.channels, Quieter, "attenuation_db falls beyond"),
        (parts.absorptions, Pump, "db_per_km is negative at"),
        (parts.beta_rules, Free, "a node is richer than search_tables have it"),
    ],
    ids=["channel", "absorption", "beta-rule"],
)
def test_what_a_role_promises(registered, registry, part, message):
    registered(registry, part)
    contract = f"^{registry.role} 'mine': what its role promises: .*{message}"
    with pytest.raises(AssertionError, match=contract):
        check_part(registry, "mine")


def test_unknown_roles_and_kinds():
    with pytest.raises(InputError, match="unknown role 'rewards'; did you mean 'reward'"):
        check_part("rewards", "paper")
    with pytest.raises(InputError, match="unknown reward 'papr'; did you mean 'paper'"):
        check_part("reward", "papr")


def test_in_a_scenario_of_ones_own():
    check_part("motion", "hover", scenario="paper/k3-fdd", overrides={"episode.duration_s": 100})
