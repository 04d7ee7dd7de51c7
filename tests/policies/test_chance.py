"""An episode depends on its seed alone, and what is not left to chance is played once."""

import numpy as np
import pytest
import scipy.stats

from iout_marl import InputError, World, evaluate, load_scenario
from iout_marl.evaluation import METRICS, Estimate, play
from iout_marl.policies import BASELINES, EpisodeStreams, is_deterministic, make_baseline
from iout_marl.trajectory import record_episode
from trainers import Trainer
from trainers.trained import TrainedPolicy

SHORT = {"episode.duration_s": 400, "auvs.count": 2}
BY_EPISODE = {"nodes": {"kind": "random", "count": 4, "redraw": "episode"}}
COUNT, SEED = 5, 11


class Odd:
    """A user's policy: whatever NumPy draws, of one shape or another."""

    name = "odd"

    def act(self, world, state, rng):
        shape = state.cell.shape
        drawn = [
            rng.normal(np.zeros((shape[0], 1)), 9.0, size=shape),
            rng.choice(30, shape, p=np.full(30, 1 / 30)),
            rng.poisson(7.0, shape),
        ]
        sizes = world.action_sizes
        entries = [np.abs(d).astype(int) % s for d, s in zip(drawn, sizes, strict=False)]
        return np.stack(entries, axis=-1)


def trained(scenario, *, sampled=True):
    return TrainedPolicy(Trainer(scenario).network, sampled=sampled)


@pytest.fixture(params=["best/k5-fdd", "best/k5-tdd"])
def scenario(request):
    return load_scenario(request.param, SHORT)


@pytest.mark.parametrize("policy", [*BASELINES, Odd(), trained], ids=[*BASELINES, "odd", "trained"])
@pytest.mark.parametrize("changes", [{}, BY_EPISODE], ids=["fixed", "by-episode"])
class TestEpisodesDependOnTheirSeedAlone:
    def scenario_and_policy(self, scenario, policy, changes):
        scenario = load_scenario(scenario, changes)
        policy = make_baseline(policy) if isinstance(policy, str) else policy
        return scenario, policy(scenario) if policy is trained else policy

    @pytest.mark.slow
    def test_in_a_batch_and_alone(self, scenario, policy, changes):
        scenario, policy = self.scenario_and_policy(scenario, policy, changes)
        together = evaluate(scenario, policy, COUNT, SEED)
        for i in range(together.episodes):
            alone = evaluate(scenario, policy, 1, SEED + i)
            for name in METRICS:
                expected = pytest.approx(alone.samples[name][0], rel=1e-9, abs=1e-9)
                assert together.samples[name][i] == expected, (i, name)

    @pytest.mark.slow
    def test_recorded_in_full(self, scenario, policy, changes):
        scenario, policy = self.scenario_and_policy(scenario, policy, changes)
        together = evaluate(scenario, policy, COUNT, SEED)
        for i in range(together.episodes):
            episode = record_episode(scenario, policy, SEED + i)
            mean_aoi = np.mean([np.mean(ages) for ages in episode.ages])
            assert mean_aoi == pytest.approx(together.samples["mean_aoi"][i])


def test_a_single_number_for_all_episodes_may_be_drawn():
    streams = EpisodeStreams(3, 4)
    assert isinstance(streams.random(), float)
    assert streams.normal(size=7).shape == (7,)
    assert sorted(streams.permutation(6)) == list(range(6))


@pytest.mark.slow
@pytest.mark.parametrize(
    "draw",
    [
        lambda rng, n: rng.random((n, 3)),
        lambda rng, n: rng.random((n, 2), dtype=np.float32),
        lambda rng, n: rng.random(out=np.empty((n, 2)), size=(n, 2)),
        lambda rng, n: rng.random(n),
        lambda rng, n: rng.integers(7, size=[n, 2]),
        lambda rng, n: rng.integers(1, 6, (n, 2), endpoint=True),
        lambda rng, n: rng.integers(2**62, size=(n, 2)),
        lambda rng, n: rng.integers(0, np.array([3, 9]), (n, 2)),
        lambda rng, n: rng.uniform(-1, 1, (n, 2)),
        lambda rng, n: rng.standard_normal((n, 2)),
        lambda rng, n: rng.choice(9, n),
        lambda rng, n: scipy.stats.norm.rvs(size=(n, 2), random_state=rng),
    ],
)
def test_rows_are_those_of_the_episodes(draw):
    together, count = EpisodeStreams(SEED, COUNT), 600
    drawn = [draw(together, COUNT) for _ in range(count)]
    for i in range(COUNT):
        alone = EpisodeStreams(SEED + i, 1)
        assert all(np.array_equal(d[i], draw(alone, 1)[0]) for d in drawn)
    assert (np.ptp(drawn, axis=0) > 0).all()


@pytest.mark.parametrize("size", [2, 7, 100])
def test_integers_are_uniform(size):
    drawn = EpisodeStreams(0, 50).integers(0, size, (50, 2000))
    assert drawn.dtype == np.int64
    counts = np.bincount(drawn.ravel(), minlength=size)
    assert len(counts) == size
    assert scipy.stats.chisquare(counts).pvalue > 1e-3


def test_empty_range_is_refused():
    with pytest.raises(ValueError, match="low >= high"):
        EpisodeStreams(0, 2).integers(3, 3, (2, 1))


def test_single_precision_stays_below_one():
    assert EpisodeStreams(0, 2).random((2, 200_000), dtype=np.float32).max() < 1


class TestWithoutChance:
    @pytest.mark.slow
    @pytest.mark.parametrize("policy", ["tour", "planner"])
    def test_one_episode_is_played(self, policy):
        found = evaluate(load_scenario("paper/k3-fdd", SHORT), policy, 7)
        assert (found.episodes, found.deterministic) == (1, True)
        record = found.to_json()
        assert (record["episodes"], record["deterministic"]) == (1, True)
        assert all(metric["ci95"] is None for metric in record["metrics"].values())

    def test_so_it_is_in_a_layout_drawn_once_for_a_run(self):
        assert evaluate(load_scenario("random/k3-fdd", SHORT), "tour", 7).episodes == 1

    def test_a_trained_policy_plays_once_unless_it_is_sampled(self, tiny):
        for sampled in (False, True):
            found = evaluate(tiny(), trained(tiny(), sampled=sampled), 3)
            assert (found.episodes, found.deterministic) == ((3, False) if sampled else (1, True))
            assert found.to_json().get("sampled", False) == found.sampled == sampled

    @pytest.mark.parametrize("policy", ["random-walk", "round-robin", "greedy", Odd()])
    def test_chance_of_the_policy_counts(self, policy):
        found = evaluate(load_scenario("paper/k3-fdd", SHORT), policy, 3)
        assert (found.episodes, found.deterministic) == (3, False)

    def test_chance_of_the_world_counts(self):
        scenario = load_scenario("paper/k3-fdd", {**SHORT, **BY_EPISODE})
        assert evaluate(scenario, "tour", 3).episodes == 3

    def test_a_function_is_not_taken_at_its_word(self):
        def still(seen):
            return np.zeros((*seen.shape[:2], 3), dtype=int)

        found = evaluate("paper/k3-fdd", still, 3)
        assert (found.episodes, found.deterministic) == (3, False)

    @pytest.mark.parametrize(
        ("said", "expected"),
        [(True, True), (np.True_, True), (False, False), ("yes", False), (lambda: True, False)],
    )
    def test_a_policy_from_outside_answers_for_itself(self, said, expected):
        policy = Odd()
        assert not is_deterministic(policy)
        policy.is_deterministic = said
        assert is_deterministic(policy) == expected


@pytest.mark.parametrize(
    ("samples", "message"),
    [
        ([], "must be a list of numbers"),
        (3.0, "must be a list of numbers"),
        ([[1.0, 2.0]], "must be a list of numbers"),
        ([1.0, np.nan], "must be finite, not nan"),
        ([np.inf], "must be finite, not inf"),
        ([-np.inf, np.inf, 1], "must be finite, not -inf"),
        ([1e308, 1e308, 1e308], "too large to add up"),
        ([1e200, -1e200], "too large to add up"),
    ],
)
def test_no_estimate_is_made_of_what_is_not_finite(samples, message):
    with pytest.raises(ValueError, match=message):
        Estimate.from_samples(samples)


def test_metrics_that_are_not_finite_are_refused(monkeypatch):
    reward = World.reward
    monkeypatch.setattr(World, "reward", lambda *given: reward(*given) * np.float64(1e308))
    with pytest.raises(InputError, match=r"paper/k3-fdd: reward is -inf: the scenario has numbers"):
        evaluate("paper/k3-fdd", "greedy", 2)


def test_playing_asks_the_streams_of_its_seed():
    class Keeping:
        name = "keeping"

        def act(self, world, state, rng):
            seen.append(rng.random((2, 1)))
            return np.zeros((2, 1, 3), dtype=int)

    seen = []
    list(play(World(load_scenario("paper/k3-fdd", {"episode.duration_s": 60}), 2), Keeping(), 4))
    assert (seen[0] == EpisodeStreams(4, 2).random((2, 1))).all()
