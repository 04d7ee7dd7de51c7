"""`iout_marl.testing` passes on sound environments, and each of its checks can fail."""

import random

import numpy as np
import pytest
from env_cases import CASES, SLOTS, case_scenario, scenario
from gymnasium import spaces
from gymnasium.vector import AutoresetMode

from iout_marl import iout_v0, testing
from iout_marl.envs import AUVEnv, AUVParallelEnv, AUVVectorEnv

WORLD = scenario("fdd", 3, "episode", slots=6)
MASKED = scenario("fdd", 3, "episode", "observation", slots=6)
#: In mid-episode: a check that looks at the first slot only must not get by.
FAULTY_SLOT = 4


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_environment_passes(case):
    world = case_scenario(case)
    testing.check_parallel_env(lambda: iout_v0.parallel_env(world), seeds=(0,))


@pytest.mark.slow
def test_environment_passes_by_every_default_seed():
    assert 0 in testing.SEEDS
    testing.check_parallel_env(lambda: iout_v0.parallel_env(WORLD))


@pytest.mark.slow
@pytest.mark.parametrize("duplex", ["fdd", "tdd"])
def test_environment_of_the_paper_passes(duplex):
    testing.check_parallel_env(lambda: iout_v0.parallel_env(f"paper/k10-{duplex}"), seeds=(0,))


def must_fail(check, make, message):
    """The check finds the fault by every seed, and `check_parallel_env` does so too."""
    for seed in testing.SEEDS:
        with pytest.raises(AssertionError, match=message):
            check(make, seed)
    with pytest.raises(AssertionError):
        testing.check_parallel_env(make)


# What a slot hands out ------------------------------------------------------------------


class Faulty(AUVParallelEnv):
    """Sound but for one slot, in which `fault` changes what `step` returns."""

    def __init__(self, fault, world=WORLD):
        super().__init__(world)
        self.fault = fault
        self.slot = 0

    def reset(self, seed=None, options=None):
        self.slot = 0
        return super().reset(seed, options)

    def step(self, actions):
        returned = super().step(actions)
        self.slot += 1
        if self.slot == FAULTY_SLOT:
            self.fault(self, *returned)
        return returned


def cast_observation(env, observations, *_):
    observations["auv_1"] = observations["auv_1"].astype(np.float64)


def leave_the_space(env, observations, *_):
    observations["auv_1"][0] = 1.5


def lose_an_entry(env, observations, *_):
    observations["auv_1"] = observations["auv_1"][:-1]


def observe_nan(env, observations, *_):
    observations["auv_1"][0] = np.nan


def observe_nothing(env, observations, *_):
    del observations["auv_1"]


def observe_a_stranger(env, observations, *_):
    observations["auv_9"] = observations["auv_1"]


def leave_the_bounds_of_a_mask(env, observations, *_):
    observations["auv_1"]["action_mask"][0] = 2


def cast_mask(env, observations, *_):
    observations["auv_1"]["action_mask"] = observations["auv_1"]["action_mask"].astype(bool)


def lose_mask(env, observations, *_):
    del observations["auv_1"]["action_mask"]


def reward_nan(env, observations, rewards, *_):
    rewards["auv_1"] = float("nan")


def reward_infinity(env, observations, rewards, *_):
    rewards["auv_1"] = float("-inf")


def reward_by_numpy(env, observations, rewards, *_):
    rewards["auv_1"] = np.float64(rewards["auv_1"])


def reward_nobody(env, observations, rewards, *_):
    rewards.clear()


def flag_termination_by_numpy(env, observations, rewards, terminations, *_):
    terminations["auv_1"] = np.False_


def flag_truncation_by_a_number(env, observations, rewards, terminations, truncations, infos):
    truncations["auv_1"] = 0


def terminate_one(env, observations, rewards, terminations, *_):
    terminations["auv_1"] = True


def end_for_all_but_live_on(env, observations, rewards, terminations, truncations, infos):
    truncations.update(dict.fromkeys(truncations, True))


def die_before_the_end(env, *_):
    env.agents = []


def leave_unnoticed(env, *_):
    env.agents = ["auv_0", "auv_2"]


def leave_altogether(env, *returned):
    for mapping in returned:
        del mapping["auv_1"]
    env.agents = ["auv_0", "auv_2"]


def tell_nothing(env, *returned):
    del returned[-1]["auv_1"]


def tell_more(env, *returned):
    returned[-1]["auv_1"]["extra"] = 1.0


def tell_less(env, *returned):
    del returned[-1]["auv_1"]["jain"]


def tell_nan(env, *returned):
    returned[-1]["auv_1"]["jain"] = float("nan")


def tell_a_word(env, *returned):
    returned[-1]["auv_1"]["jain"] = "0.5"


def tell_none(env, *returned):
    returned[-1]["auv_1"]["jain"] = None


IN_A_SLOT = {
    cast_observation: "auv_1 is float64, its space float32",
    leave_the_space: "auv_1 lies outside its space",
    lose_an_entry: "auv_1 lies outside its space",
    observe_nan: "auv_1 lies outside its space",
    observe_nothing: "observations are of",
    observe_a_stranger: "observations are of",
    reward_nan: "reward is nan",
    reward_infinity: "reward is -inf",
    reward_by_numpy: "reward is a .*float64",
    reward_nobody: r"but got \[\]",
    flag_termination_by_numpy: "a termination is not a bool",
    flag_truncation_by_a_number: "a truncation is not a bool",
    terminate_one: "agents end in different slots",
    end_for_all_but_live_on: "alive after their end",
    die_before_the_end: "dead before it",
    leave_unnoticed: "an agent left in mid-episode",
    leave_altogether: "observations are of",
    tell_nothing: "infos are of",
    tell_more: "the keys of auv_1's info change",
    tell_less: "the keys of auv_1's info change",
    tell_nan: "info jain is nan",
    tell_a_word: "info jain is not a number",
    tell_none: "info jain is not a number",
}
IN_A_MASK = {
    leave_the_bounds_of_a_mask: r"auv_1\[action_mask\] lies outside its space",
    cast_mask: r"auv_1\[action_mask\] is bool, its space int8",
    lose_mask: "auv_1 has the keys",
}


def name_of(fault):
    return getattr(fault, "__name__", None)


@pytest.mark.slow
@pytest.mark.parametrize(("fault", "message"), IN_A_SLOT.items(), ids=name_of)
def test_fault_in_what_a_slot_hands_out_is_found(fault, message):
    must_fail(testing.check_contained, lambda: Faulty(fault), message)


@pytest.mark.parametrize(("fault", "message"), IN_A_MASK.items(), ids=name_of)
def test_fault_in_a_part_of_an_observation_is_found(fault, message):
    must_fail(testing.check_contained, lambda: Faulty(fault, MASKED), message)


class StateInFloat64(AUVParallelEnv):
    def state(self):
        return super().state().astype(np.float64)


class StateOutsideItsSpace(AUVParallelEnv):
    def state(self):
        return super().state() - 1


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (StateInFloat64, "state is float64, its space float32"),
        (StateOutsideItsSpace, "state lies outside"),
    ],
)
def test_fault_in_the_state_is_found(broken, message):
    must_fail(testing.check_contained, lambda: broken(WORLD), message)


class Endless(AUVParallelEnv):
    """Begins a new episode by itself."""

    def step(self, actions):
        observations, rewards, terminations, _, infos = super().step(actions)
        if not self.agents:
            observations, infos = self.reset()
        return observations, rewards, terminations, dict.fromkeys(rewards, False), infos


def test_an_episode_without_an_end_is_found(monkeypatch):
    monkeypatch.setattr(testing.environments, "MAX_SLOTS", 50)
    must_fail(testing.check_contained, lambda: Endless(WORLD), "no end within 50 slots")


class NobodyThere(AUVParallelEnv):
    def reset(self, seed=None, options=None):
        returned = super().reset(seed, options)
        self.agents = []
        return returned


def test_an_environment_without_agents_is_found():
    must_fail(testing.check_contained, lambda: NobodyThere(WORLD), "no agent is alive")


# Seeds and streams ----------------------------------------------------------------------


class Noisy(AUVParallelEnv):
    """Rewards are noisy in the last slot."""

    def step(self, actions):
        returned = super().step(actions)
        if not self.agents:
            returned[1].update(auv_2=float(np.random.default_rng().random()))
        return returned


class NoisyState(AUVParallelEnv):
    def state(self):
        state = super().state()
        state[-1] = np.random.default_rng().random()
        return state


class SeedlessNextEpisode(AUVParallelEnv):
    """A reset without a seed forgets the stream, rather than going on with it."""

    def reset(self, seed=None, options=None):
        return super().reset(np.random.SeedSequence().entropy if seed is None else seed, options)


class ZeroIsNoSeed(AUVParallelEnv):
    def reset(self, seed=None, options=None):
        return super().reset(seed or None, options)


@pytest.mark.parametrize("broken", [Noisy, NoisyState, SeedlessNextEpisode])
def test_what_does_not_follow_from_the_seed_is_found(broken):
    must_fail(testing.check_deterministic, lambda: broken(WORLD), "equal seeds differ")


def test_seed_zero_taken_for_none_is_found():
    testing.check_deterministic(lambda: ZeroIsNoSeed(WORLD), 1)
    with pytest.raises(AssertionError, match="equal seeds differ"):
        testing.check_parallel_env(lambda: ZeroIsNoSeed(WORLD))


class CountsEpisodes(AUVParallelEnv):
    episodes = 0

    def reset(self, seed=None, options=None):
        self.episodes += 1
        observations, infos = super().reset(seed, options)
        infos["auv_0"]["jain"] = float(self.episodes)
        return observations, infos


class SeedsOnlyOnce(AUVParallelEnv):
    seeded = False

    def reset(self, seed=None, options=None):
        seed, self.seeded = None if self.seeded else seed, True
        return super().reset(seed, options)


class KeepsTheFirstSeed(AUVParallelEnv):
    """The first seed decides for good."""

    first = None

    def reset(self, seed=None, options=None):
        if seed is not None:
            seed = self.first = seed if self.first is None else self.first
        return super().reset(seed, options)


class KeepsTheLastReward(AUVParallelEnv):
    """An episode that was broken off leaves its reward to the next one."""

    kept = 0.0

    def step(self, actions):
        returned = super().step(actions)
        returned[1]["auv_0"] += self.kept
        self.kept = returned[1]["auv_0"] if self.agents else 0.0
        return returned


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (CountsEpisodes, "a second reset with the same seed differs"),
        (SeedsOnlyOnce, "a second reset with the same seed differs"),
        (KeepsTheFirstSeed, "a reset with another seed leaves something behind"),
        (KeepsTheLastReward, "a reset in mid-episode leaves something behind"),
    ],
)
def test_a_reset_that_does_not_start_afresh_is_found(broken, message):
    must_fail(testing.check_reset_repeats, lambda: broken(WORLD), message)


class SeedsNumPy(AUVParallelEnv):
    def reset(self, seed=None, options=None):
        if seed is not None:
            np.random.seed(seed)  # noqa: NPY002
        return super().reset(seed, options)


class DrawsFromNumPy(AUVParallelEnv):
    def step(self, actions):
        np.random.random()  # noqa: NPY002
        return super().step(actions)


class DrawsFromPython(AUVParallelEnv):
    def step(self, actions):
        random.random()
        return super().step(actions)


class DrawsItsSeed(AUVParallelEnv):
    """From the global generator, where it is given none."""

    def reset(self, seed=None, options=None):
        if seed is None:
            seed = np.random.randint(1000)  # noqa: NPY002
        return super().reset(seed, options)


class DrawsItsFirstSeed(AUVParallelEnv):
    """From the global generator, where it is never given one."""

    fresh = True

    def reset(self, seed=None, options=None):
        if seed is None and self.fresh:
            seed = random.randrange(1000)
        self.fresh = False
        return super().reset(seed, options)


@pytest.fixture
def _global_generators():
    """Puts back what broken environments do to them."""
    python, numpy = random.getstate(), np.random.get_state()  # noqa: NPY002
    yield
    random.setstate(python)
    np.random.set_state(numpy)  # noqa: NPY002


@pytest.mark.slow
@pytest.mark.usefixtures("_global_generators")
@pytest.mark.parametrize(
    ("broken", "whose"),
    [
        (SeedsNumPy, "NumPy"),
        (DrawsFromNumPy, "NumPy"),
        (DrawsFromPython, "Python"),
        (DrawsItsSeed, "NumPy"),
        (DrawsItsFirstSeed, "Python"),
    ],
)
def test_use_of_a_global_generator_is_found(broken, whose):
    must_fail(
        testing.check_global_generators_untouched,
        lambda: broken(WORLD),
        f"{whose}'s global generator was touched",
    )


# Memory ---------------------------------------------------------------------------------


class ReusesArrays(AUVParallelEnv):
    """Every observation of an AUV is written into the same array."""

    def step(self, actions):
        observations, *others = super().step(actions)
        for agent, observation in observations.items():
            self.buffers.setdefault(agent, observation.copy())[...] = observation
        return (dict(self.buffers), *others)

    def reset(self, seed=None, options=None):
        self.buffers = {}
        return super().reset(seed, options)


class ReusesDictionaries(AUVParallelEnv):
    """Every `step` hands out the same dictionary of rewards."""

    def step(self, actions):
        observations, rewards, *others = super().step(actions)
        self.rewards.update(rewards)
        return (observations, self.rewards, *others)

    def reset(self, seed=None, options=None):
        self.rewards = {}
        return super().reset(seed, options)


class ReusesInfos(AUVParallelEnv):
    """The first info of an agent is the one of the whole episode."""

    def step(self, actions):
        *others, infos = super().step(actions)
        for agent, info in infos.items():
            self.kept[agent].update(info)
        return (*others, dict(self.kept))

    def reset(self, seed=None, options=None):
        observations, self.kept = super().reset(seed, options)
        return observations, dict(self.kept)


class ReusesTheState(AUVParallelEnv):
    buffer = None

    def state(self):
        if self.buffer is None:
            self.buffer = super().state()
        self.buffer[...] = super().state()
        return self.buffer


@pytest.mark.slow
@pytest.mark.parametrize("broken", [ReusesArrays, ReusesDictionaries, ReusesInfos, ReusesTheState])
def test_change_of_what_was_handed_out_is_found(broken):
    must_fail(
        testing.check_nothing_is_mutated,
        lambda: broken(WORLD),
        "something handed out was changed later",
    )


class HandsOutItsCount(AUVParallelEnv):
    """An info is the very array that the next reward is made of."""

    def reset(self, seed=None, options=None):
        self.count = np.zeros(1)
        return super().reset(seed, options)

    def step(self, actions):
        self.count = self.count + 1
        returned = super().step(actions)
        returned[1]["auv_0"] += self.count.item()
        return returned

    def _infos(self):
        infos = super()._infos()
        for info in infos.values():
            info["count"] = self.count
        return infos


class RemembersActions(AUVParallelEnv):
    """The last action is kept as it was given, and counts in the next slot."""

    last = None

    def step(self, actions):
        returned = super().step(actions)
        if self.last is not None:
            returned[1]["auv_0"] += float(self.last["auv_0"].sum())
        self.last = actions if self.agents else None
        return returned

    def reset(self, seed=None, options=None):
        self.last = None
        return super().reset(seed, options)


class RemembersObservations(AUVParallelEnv):
    """The last observation is kept as it was handed out, and counts in the next slot."""

    def step(self, actions):
        returned = super().step(actions)
        returned[1]["auv_0"] += float(self.last["auv_0"].sum())
        self.last = dict(returned[0])
        return returned

    def reset(self, seed=None, options=None):
        observations, infos = super().reset(seed, options)
        self.last = dict(observations)
        return observations, infos


class HandsOutItsAgents(AUVParallelEnv):
    """The observations' dictionary is the environment's own list of who is alive."""

    def step(self, actions):
        if not self.known:
            raise RuntimeError("the environment has lost its agents")
        return super().step(actions)

    def reset(self, seed=None, options=None):
        self.known, infos = super().reset(seed, options)
        return self.known, infos


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (HandsOutItsCount, "writing into what was handed out"),
        (RemembersActions, "writing into what was handed out"),
        (RemembersObservations, "writing into what was handed out"),
        (HandsOutItsAgents, "the environment has lost its agents"),
    ],
)
def test_memory_shared_with_the_caller_is_found(broken, message):
    must_fail(testing.check_nothing_is_mutated, lambda: broken(WORLD), message)


class PickleReseeds(AUVParallelEnv):
    """The stream of layouts is not the pickle's, nor the copy's."""

    def __getstate__(self):
        return {"agents": self.agents, "episode": self._episodes}

    def __setstate__(self, state):
        self.__init__(WORLD)
        self.agents, self._episodes = state["agents"], state["episode"]
        self._episodes._rngs = [np.random.default_rng()]


class PickleForgets(AUVParallelEnv):
    """A copy is in the episode's first slot."""

    def __reduce__(self):
        return _begun, ()


def _begun():
    env = PickleForgets(WORLD)
    env.reset(seed=0)
    return env


class CopySharesTheEpisode(AUVParallelEnv):
    def __deepcopy__(self, memo):
        twin = CopySharesTheEpisode(WORLD)
        twin.agents, twin._episodes = self.agents[:], self._episodes
        return twin


class CanNotBePickled(AUVParallelEnv):
    def __init__(self, world):
        super().__init__(world)
        self.hook = lambda: None


@pytest.mark.slow
@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (PickleReseeds, "a deep copy continues differently"),
        (PickleForgets, "a deep copy continues differently"),
        (CopySharesTheEpisode, "a deep copy continues differently"),
        (CanNotBePickled, "cannot be copied"),
    ],
)
def test_a_copy_that_goes_on_otherwise_is_found(broken, message):
    must_fail(testing.check_copies_continue, lambda: broken(WORLD), message)


# Batched environments -------------------------------------------------------------------


class NextStep(AUVVectorEnv):
    metadata = AUVVectorEnv.metadata | {"autoreset_mode": AutoresetMode.NEXT_STEP}


class SameSeeds(AUVVectorEnv):
    def reset(self, *, seed=None, options=None):
        return super().reset(seed=None if seed is None else [seed] * self.num_envs)


class WrongReward(AUVVectorEnv):
    def step(self, actions):
        returned = super().step(actions)
        returned[1][-1] += 1e-6
        return returned


class NoFinalObservation(AUVVectorEnv):
    def step(self, actions):
        returned = super().step(actions)
        returned[-1].pop("final_obs", None)
        return returned


class FinalObservationOfTheNextEpisode(AUVVectorEnv):
    def step(self, actions):
        observations, *others, infos = super().step(actions)
        if "final_obs" in infos:
            infos["final_obs"][:] = list(observations)
        return (observations, *others, infos)


class Float32Rewards(AUVVectorEnv):
    def step(self, actions):
        observations, rewards, *others = super().step(actions)
        return (observations, rewards.astype(np.float32), *others)


class OtherSpace(AUVVectorEnv):
    def __init__(self, *args):
        super().__init__(*args)
        self.single_observation_space = spaces.Box(0, 1, (15,))


class SharesItsState(AUVVectorEnv):
    def _infos(self):
        return super()._infos() | {"total_spent_j": self._episodes.current.spent_j}


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (NextStep, "the autoreset mode is"),
        (SameSeeds, "differs from single ones"),
        (WrongReward, "in their rewards"),
        (Float32Rewards, r"in their rewards \(dtype\)"),
        (NoFinalObservation, r"in their infos \(keys\)"),
        (FinalObservationOfTheNextEpisode, "final_obs"),
        (OtherSpace, "single_observation_space differs"),
        (SharesItsState, "total_spent_j"),
    ],
)
def test_fault_of_a_batched_environment_is_found(broken, message):
    with pytest.raises(AssertionError, match=message):
        testing.check_vector_env(lambda: broken(WORLD, 2), lambda: AUVEnv(WORLD), seeds=(0,))


def test_a_batch_without_an_end_is_found(monkeypatch):
    monkeypatch.setattr(testing.environments, "MAX_SLOTS", SLOTS)
    with pytest.raises(AssertionError, match=f"no end within {SLOTS} slots"):
        testing.check_vector_env(lambda: AUVVectorEnv(WORLD, 2), lambda: AUVEnv(WORLD))


# Sampling and comparing -----------------------------------------------------------------

SPACES = [
    spaces.Discrete(3, start=5),
    spaces.MultiDiscrete([2, 3], start=[4, -2]),
    spaces.MultiBinary(4),
    spaces.Box(-1, 1, (2, 2)),
    spaces.Box(-np.inf, np.inf, (3,)),
    spaces.Box(0, 255, (2,), dtype=np.uint8),
    spaces.Dict({"move": spaces.Discrete(6), "power": spaces.Box(0, 1, (1,))}),
    spaces.Tuple((spaces.Discrete(6), spaces.MultiDiscrete([2, 2]))),
    spaces.Text(5),
    spaces.Sequence(spaces.Discrete(3)),
]


class OneAgent:
    """As much of an environment as `sample_actions` looks at."""

    agents = ("one",)

    def __init__(self, space):
        self.space = space

    def action_space(self, agent):
        return self.space


@pytest.mark.parametrize("space", SPACES, ids=str)
def test_actions_are_sampled_from_any_space_by_the_generator_given(space):
    env = OneAgent(space)

    def sample(seed):
        rng = np.random.default_rng(seed)
        return [testing.sample_actions(env, rng)["one"] for _ in range(20)]

    actions = sample(0)
    assert all(space.contains(action) for action in actions)
    testing.assert_equal(actions, sample(0), "equal generators")
    with pytest.raises(AssertionError):
        testing.assert_equal(actions, sample(1), "different generators")


def test_sampling_leaves_the_streams_of_spaces_alone():
    space = spaces.Discrete(1000, seed=0)
    testing.sample_actions(OneAgent(space), np.random.default_rng(0))
    assert space.sample() == spaces.Discrete(1000, seed=0).sample()


@pytest.mark.parametrize(
    ("first", "second"),
    [
        (1, True),
        (1, 1.0),
        (1.0, np.float64(1)),
        (0.1, 0.1 + 1e-16 * 2),
        ([1], [1, 2]),
        ({"a": 1}, {"a": 2}),
        ({"a": 1}, {"b": 1}),
        ({"a": 1}, [("a", 1)]),
        (np.zeros(2), np.zeros(3)),
        (np.zeros(2), np.zeros(2, dtype=np.float32)),
        (np.zeros(1), [0.0]),
        (np.zeros(1), np.array([1e-300])),
        ({"a": [np.zeros(1)]}, {"a": [np.ones(1)]}),
    ],
    ids=str,
)
def test_records_that_differ_are_told_apart(first, second):
    testing.assert_equal(first, first, "the same")
    with pytest.raises(AssertionError, match="difference"):
        testing.assert_equal(first, second, "difference")


def test_nans_in_the_same_places_are_equal():
    testing.assert_equal(np.array([1, np.nan]), np.array([1, np.nan]), "NaN")
