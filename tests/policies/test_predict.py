"""`predict`: in every form in which environments hand out observations, what evaluation plays."""

import copy

import gymnasium
import numpy as np
import pytest

import iout_marl
from iout_marl import InputError, World, evaluate, iout_v0, load_policy, make_baseline
from iout_marl.envs import AUVEnv, AUVVectorEnv
from iout_marl.policies import EpisodeStreams, as_policy
from trainers import Trainer
from trainers.trained import TrainedPolicy

SEED, ENVS = 5, 3
MASKS = ("none", "info", "observation")
#: Layouts that differ from episode to episode, so that seeds tell.
CHANGES = {
    "nodes": {"kind": "random", "count": 2},
    "observation.node_positions": True,
    # Masks and actions are longer than nodes are many.
    "auvs.idle_choices": True,
}


@pytest.fixture(scope="module")
def world(tiny):
    """Makes the scenario of so many AUVs, with masks where they are wanted."""

    def make(auvs=2, mask="none", **more):
        settings = {"auvs.count": auvs, "observation.action_mask": mask}
        return tiny({**CHANGES, **settings, **more})

    return make


@pytest.fixture(scope="module")
def trained(world):
    """Makes a policy that was trained for a moment, with or without masks."""

    def make(scenario, *, sampled=False, use_mask=False):
        trainer = Trainer(scenario, overrides={"training.mask_actions": use_mask})
        trainer.iterate()
        policy = trainer.policy()
        policy.sampled = sampled
        return policy

    return make


class Anyone:
    """A policy of a user's that has nothing but `act`, with chance of another kind."""

    name = "anyone"

    def act(self, world, state, rng):
        shape = state.cell.shape
        return np.stack([rng.choice(size, shape) for size in world.action_sizes], axis=-1)


def by_first_entries(observation):
    """Actions that depend on the position alone."""
    return observation[..., :3].astype(int) % 2


# Ways to play an episode of seed SEED, or ENVS of them: mean AoI and return of each. -----


def by_agents(scenario, predict):
    env = iout_v0.parallel_env(scenario)
    observations, infos = env.reset(seed=SEED)
    total = 0.0
    while env.agents:
        mask = {a: infos[a]["action_mask"] for a in env.agents} if masked(env) else None
        observations, rewards, *_, infos = env.step(predict(observations, mask, env=env))
        total += np.mean(list(rewards.values()))
    return [infos["auv_0"]["time_mean_aoi"]], [total]


def agent_by_agent(scenario, predict):
    env = iout_v0.env(scenario)
    env.reset(seed=SEED)
    total = 0.0
    for agent in env.agent_iter():
        observation, reward, _, over, info = env.last()
        total += reward / env.max_num_agents
        if over:
            env.step(None)
            continue
        mask = {agent: info["action_mask"]} if masked(env.unwrapped) else None
        env.step(predict({agent: observation}, mask, env=env)[agent])
    return [info["time_mean_aoi"]], [total]


def all_agents_stacked(scenario, predict):
    env = iout_v0.parallel_env(scenario)
    observations, infos = env.reset(seed=SEED)
    total = 0.0
    while env.agents:
        stacked, mask = list(observations.values()), None
        if env.scenario.observation.action_mask == "observation":
            mask = np.stack([each["action_mask"] for each in stacked])
            stacked = [each["observation"] for each in stacked]
        elif masked(env):
            mask = np.stack([infos[a]["action_mask"] for a in env.agents])
        actions = predict(np.stack(stacked), mask, env=env)
        assert actions.shape == (env.max_num_agents, 3)
        observations, rewards, *_, infos = env.step(dict(zip(env.agents, actions, strict=True)))
        total += np.mean(list(rewards.values()))
    return [infos["auv_0"]["time_mean_aoi"]], [total]


def one_controller(scenario, predict):
    env = gymnasium.make("iout_marl:AUV-v0", scenario=scenario, disable_env_checker=True)
    observation, info = env.reset(seed=SEED)
    total, over = 0.0, False
    while not over:
        action = predict(observation, info.get("action_mask"), env=env)
        assert env.action_space.contains(action)
        observation, reward, _, over, info = env.step(action)
        total += reward
    return [info["time_mean_aoi"]], [total]


def batched(scenario, predict):
    env = AUVVectorEnv(scenario, ENVS, autoreset_mode="Disabled")
    observation, info = env.reset(seed=SEED)
    total, over = np.zeros(ENVS), np.zeros(1, dtype=bool)
    while not over.all():
        actions = predict(observation, info.get("action_mask"), env=env)
        assert env.action_space.contains(actions)
        observation, rewards, _, over, info = env.step(actions)
        total += rewards
    return info["time_mean_aoi"], total


def batched_by_auv(scenario, predict):
    """(envs, auvs, entries), as the world itself has them."""
    env = AUVVectorEnv(scenario, ENVS, autoreset_mode="Disabled")
    env.reset(seed=SEED)
    total = np.zeros(ENVS)
    for _ in range(env.scenario.num_slots):
        has_masks = scenario.observation.action_mask != "none"
        vectors, mask = env.episodes.observe(), env.episodes.masks() if has_masks else None
        actions = predict(vectors, mask, env=env)
        assert actions.shape == (ENVS, env.scenario.num_auvs, 3)
        *_, rewards, _, _, info = env.step(actions.reshape(ENVS, -1))
        total += rewards
    return info["time_mean_aoi"], total


def masked(env):
    return env.scenario.observation.action_mask == "info"


WAYS = (by_agents, agent_by_agent, all_agents_stacked, one_controller, batched, batched_by_auv)
each_way = pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)


def assert_as_evaluated(found, scenario, policy):
    mean_aoi, total = found
    expected = evaluate(scenario, policy, len(mean_aoi), SEED).samples
    assert mean_aoi == pytest.approx(expected["mean_aoi"][: len(mean_aoi)], rel=1e-12)
    assert total == pytest.approx(expected["reward"][: len(mean_aoi)], rel=1e-9)


@pytest.mark.slow
@each_way
@pytest.mark.parametrize("auvs", [1, 2])
@pytest.mark.parametrize("use_mask", [False, True], ids=["unmasked", "masked"])
@pytest.mark.parametrize("mask", MASKS)
def test_trained_policy(way, auvs, use_mask, mask, world, trained):
    scenario = world(auvs, mask)
    policy = trained(scenario, use_mask=use_mask)

    def predict(observation, mask, env):
        # Only where a mask is wanted and not handed out the environment is asked.
        is_told = scenario.observation.action_mask != "none" or not use_mask
        return policy.predict(observation, mask, env=None if is_told else env)

    assert_as_evaluated(way(scenario, predict), scenario, policy)


@pytest.mark.slow
@each_way
@pytest.mark.parametrize("mask", MASKS)
@pytest.mark.parametrize(
    "policy",
    [*("greedy", "random-walk", "round-robin", "tour"), Anyone(), by_first_entries],
    ids=lambda policy: getattr(policy, "__name__", getattr(policy, "name", policy)),
)
def test_policy_by_the_state_of_the_world(way, mask, policy, world):
    scenario = world(2, mask)
    asked = load_policy(policy) if isinstance(policy, str) else as_policy(policy)
    assert_as_evaluated(way(scenario, asked.predict), scenario, policy)


@pytest.mark.slow
@pytest.mark.parametrize("way", [w for w in WAYS if w is not agent_by_agent])
def test_sampled_actions_follow_the_environments_seed(way, world, trained):
    scenario = world()
    policy = trained(scenario, sampled=True)
    assert_as_evaluated(way(scenario, policy.predict), scenario, policy)


def test_one_agent_alone_and_without_an_environment(world, trained):
    scenario = world(2)
    policy = trained(scenario)
    env = iout_v0.parallel_env(scenario)
    observations, _ = env.reset(seed=SEED)
    together = policy.predict(observations)
    assert list(together) == env.agents
    for agent, observation in observations.items():
        alone = policy.predict(observation)
        assert alone.shape == (3,)
        assert np.issubdtype(alone.dtype, np.integer)
        assert (alone == together[agent]).all()
        assert (policy.predict(observation.tolist()) == alone).all()
    assert policy.predict({}) == {}


def test_observations_with_masks_as_one_agent_sees_them(world, trained):
    scenario = world(2, "observation")
    policy = trained(scenario, use_mask=True)
    env = iout_v0.parallel_env(scenario)
    observations, _ = env.reset(seed=SEED)
    one = observations["auv_1"]
    chosen = policy.predict(one)
    assert (policy.predict(one["observation"], one["action_mask"]) == chosen).all()
    # A single choice of each entry is left, nobody of the last.
    only = np.zeros_like(one["action_mask"])
    only[[2, env.action_spaces["auv_0"].nvec[0] + 1, -1]] = 1
    assert policy.predict(one["observation"], only).tolist() == [2, 1, 2]
    # Who was trained without masks heeds none, here as in evaluation.
    free = trained(scenario)
    assert (free.predict(one["observation"], only) == free.predict(one["observation"])).all()


def test_sampled_actions_by_a_generator(world, trained):
    scenario = world()
    policy = trained(scenario, sampled=True)
    seen = np.tile(World(scenario).observe(World(scenario).reset(seed=0)), (50, 1, 1))
    draws = [policy.predict(seen, rng=np.random.default_rng(seed)) for seed in (1, 1, 2)]
    assert (draws[0] == draws[1]).all()
    assert (draws[0] != draws[2]).any()
    assert (policy.predict(seen) != policy.predict(seen)).any()


def test_asked_twice_in_a_slot_a_policy_answers_the_same(world):
    env = iout_v0.parallel_env(world())
    policy = make_baseline("random-walk")
    observations, _ = env.reset(seed=SEED)
    slots = []
    while env.agents:
        first, second = (policy.predict(observations, env=env) for _ in range(2))
        assert all((first[agent] == second[agent]).all() for agent in env.agents)
        slots.append(first["auv_0"].tolist())
        observations, *_ = env.step(first)
    assert len({tuple(each) for each in slots}) > 1
    # The next episode continues with the streams; a seed begins them anew.
    observations, _ = env.reset()
    again = []
    while env.agents:
        actions = policy.predict(observations, env=env)
        again.append(actions["auv_0"].tolist())
        observations, *_ = env.step(actions)
    assert again != slots
    observations, _ = env.reset(seed=SEED)
    assert policy.predict(observations, env=env)["auv_0"].tolist() == slots[0]


def test_environments_with_seeds_of_their_own():
    """Each draws what it draws alone."""
    together = EpisodeStreams([9, 3], 2).random((2, 4))
    for row, seed in zip(together, (9, 3), strict=True):
        assert (row == EpisodeStreams(seed, 1).random((1, 4))[0]).all()
    env = AUVVectorEnv("paper/k3-fdd", 2)
    policy = make_baseline("greedy")
    observation, _ = env.reset(seed=[9, 3])
    actions = policy.predict(observation, env=env)
    for i, seed in enumerate((9, 3)):
        single = AUVEnv("paper/k3-fdd")
        alone, _ = single.reset(seed=seed)
        assert (policy.predict(alone, env=single) == actions[i]).all()


def test_an_environment_that_nobody_has_seeded(world):
    env = iout_v0.parallel_env(world())
    observations, _ = env.reset()
    make_baseline("greedy").predict(observations, env=env)
    twin = copy.deepcopy(env)
    assert set(make_baseline("greedy").predict(observations, env=twin)) == set(env.agents)


class TestRefused:
    """One line each, that says what was expected."""

    @pytest.fixture
    def policy(self, world, trained):
        return trained(world(2))

    @pytest.mark.slow
    @pytest.mark.parametrize(
        ("observation", "expected"),
        [
            (np.zeros(5), "ppo: expected observations of 16 entries each, or 32 of all 2 AUVs"),
            (np.zeros(48), "joined end to end, not shape (48,)"),
            (np.zeros((4, 2, 15)), "not shape (4, 2, 15)"),
            (np.zeros(0), "not shape (0,)"),
            (1.0, "not shape ()"),
            ({"auv_0": np.zeros(32)}, "ppo, auv_0: expected an observation of shape (16,), not"),
            ({"auv_1": np.zeros(5)}, "ppo, auv_1: expected observations of 16 entries"),
            ("north", "ppo: observations must be numbers, not 'north'"),
            (None, "not shape ()"),
            ({"auv_0": {"x": 1}}, "ppo, auv_0: observations must be numbers, not {'x': 1}"),
            ([[0.0] * 16, [0.0]], "ppo: observations must be numbers, not [["),
            (np.full(16, np.nan), "ppo: an observation holds nan"),
        ],
    )
    def test_observation(self, policy, observation, expected):
        with pytest.raises(InputError) as raised:
            policy.predict(observation)
        assert expected in str(raised.value)
        assert str(raised.value).isprintable()

    def test_mask(self, world, trained):
        masked = trained(world(2), use_mask=True)
        with pytest.raises(InputError, match=r"mask: expected shape \(12,\), not \(4,\)"):
            masked.predict(np.zeros(16), [1, 0, 1, 1])
        with pytest.raises(InputError, match=r"was trained with masks .*: give mask="):
            masked.predict(np.zeros(16))
        two = {"auv_0": np.zeros(16), "auv_1": np.zeros(16)}
        with pytest.raises(InputError, match="some agents have a mask, but not all"):
            masked.predict(two, {"auv_0": np.ones(12)})

    def test_state_policies_want_the_environment(self, world):
        policy, env = make_baseline("greedy"), iout_v0.parallel_env(world())
        with pytest.raises(RuntimeError, match="call reset"):
            policy.predict(np.zeros((2, 16)), env=env)
        observations, _ = env.reset(seed=0)
        with pytest.raises(InputError, match=r"^greedy: decides by the state .*env=env"):
            policy.predict(observations)
        with pytest.raises(InputError, match=r"^greedy: decides for all AUVs at once: .* of 1$"):
            policy.predict(observations["auv_0"], env=env)
        with pytest.raises(InputError, match=r"no agent 'auv_2'; did you mean"):
            policy.predict({"auv_2": observations["auv_0"]}, env=env)
        with pytest.raises(InputError, match=r"^env: must be an environment of iout_marl"):
            policy.predict(observations, env=gymnasium.make("CartPole-v1"))
        vector = AUVVectorEnv(world(), 2)
        vector.reset()
        with pytest.raises(InputError, match="by agent are of one environment"):
            policy.predict(observations, env=vector)

    def test_a_bare_network_takes_any_number_of_auvs(self, policy):
        bare = TrainedPolicy(policy.network)
        assert bare.predict(np.zeros(48)).shape == (9,)
        with pytest.raises(InputError, match="or several joined end to end, not shape"):
            bare.predict(np.zeros(17))


@pytest.mark.slow
def test_load_policy_reads_a_run(tmp_path, world):
    scenario = world(2)
    run = tmp_path / "run"
    iout_marl.train(scenario, run, evaluation_episodes=1)
    policy = load_policy(run)
    assert_as_evaluated(by_agents(scenario, policy.predict), scenario, run)
    assert evaluate(scenario, str(run), 2).to_json() == evaluate(scenario, policy, 2).to_json()
    assert iout_marl.record_episode(scenario, run) == iout_marl.record_episode(scenario, policy)
    assert load_policy(str(run), sampled=True).sampled
    with pytest.raises(InputError, match=r"sampled: greedy is no trained policy"):
        load_policy("greedy", sampled=True)
    with pytest.raises(InputError, match=r"was trained on another scenario"):
        evaluate("paper/k3-fdd", run)
    for bad in (None, 3, ["greedy"]):
        with pytest.raises(InputError, match="policy: must be a baseline, the folder of a run"):
            load_policy(bad)
