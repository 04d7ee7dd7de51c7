"""Advantages and reward scales, against sums by hand and slow references."""

import numpy as np
import pytest
import torch

from trainers.accel import Runtime
from trainers.returns import RewardScale, advantages

#: No episode ends in twelve slots.
NEVER = torch.zeros(12, dtype=torch.bool)


def slow_advantages(reward, value, next_value, truncated, discount, gae_lambda):
    """Â_t = Σ_l (γλ)^l δ_{t+l}, the sum ending with the episode."""
    slots = len(reward)
    delta = [float(reward[t] + discount * next_value[t] - value[t]) for t in range(slots)]
    result = []
    for t in range(slots):
        total = 0.0
        for u in range(t, slots):
            total += (discount * gae_lambda) ** (u - t) * delta[u]
            if truncated[u]:
                break
        result.append(total)
    return result


def test_by_hand():
    found = advantages(
        reward=torch.tensor([1.0, 2.0, 3.0]),
        value=torch.tensor([1.0, 1.0, 1.0]),
        next_value=torch.tensor([1.0, 1.0, 4.0]),
        truncated=NEVER[:3],
        discount=0.5,
        gae_lambda=0.5,
    )
    # δ = 0.5, 1.5, 4; each later one counts for a quarter.
    assert found.tolist() == [1.125, 2.5, 4.0]


def test_truncation_bootstraps_and_ends_the_sum():
    found = advantages(
        reward=torch.tensor([1.0, 2.0, 3.0]),
        value=torch.tensor([1.0, 1.0, 1.0]),
        next_value=torch.tensor([1.0, 10.0, 4.0]),
        truncated=torch.tensor([False, True, False]),
        discount=0.5,
        gae_lambda=0.5,
    )
    # δ₁ = 2 + 0.5·10 − 1 = 6 has the value of the last state; δ₂ = 4 stays out of Â₁.
    assert found.tolist() == [0.5 + 0.25 * 6, 6.0, 4.0]


@pytest.mark.parametrize("discount", [0.0, 0.92, 1.0])
@pytest.mark.parametrize("gae_lambda", [0.0, 0.95, 1.0])
@pytest.mark.parametrize("slots", [1, 2, 30])
def test_equals_the_slow_reference(discount, gae_lambda, slots):
    rng = np.random.default_rng(slots)
    reward, value, next_value = torch.from_numpy(rng.normal(size=(3, slots, 2, 3)))
    truncated = torch.from_numpy(rng.random(slots) < 0.2)
    found = advantages(reward, value, next_value, truncated, discount, gae_lambda)
    for env, auv in np.ndindex(2, 3):
        one = (slice(None), env, auv)
        expected = slow_advantages(
            reward[one], value[one], next_value[one], truncated, discount, gae_lambda
        )
        assert found[one].tolist() == pytest.approx(expected, abs=1e-12)


def test_lambda_of_one_is_the_discounted_return_less_the_value():
    reward, value = torch.tensor([1.0, 2.0, 4.0]), torch.tensor([0.3, 0.2, 0.1])
    next_value = torch.tensor([0.2, 0.1, 8.0])
    found = advantages(reward, value, next_value, NEVER[:3], 0.5, 1.0)
    assert found[0].item() == pytest.approx(1 + 1 + 1 + 0.125 * 8 - 0.3)


def rewards(slots=12, seed=0):
    return torch.from_numpy(np.random.default_rng(seed).normal(-5, 3, (slots, 1, 4, 2)))


def reward_scale(kind, discount):
    return RewardScale(kind, discount, 1, Runtime())


def test_rewards_may_stay_as_they_are():
    scale = reward_scale("none", 0.9)
    scale.update(rewards(), NEVER)
    assert scale.divisor == 1


def test_first_rollout_sets_the_divisor_for_good():
    scale = reward_scale("first_rollout", 0.9)
    scale.update(rewards(), NEVER)
    first = scale.divisor
    assert first.item() == pytest.approx(rewards().numpy().std())
    scale.update(100 * rewards(seed=1), NEVER)
    assert scale.divisor == first


def test_running_divisor_is_the_spread_of_all_discounted_returns():
    scale, seen = reward_scale("running", 0.9), []
    running = np.zeros((1, 4, 2))
    for seed in range(5):
        batch, truncated = rewards(7, seed), NEVER[:7].clone()
        truncated[seed] = True
        scale.update(batch, truncated)
        for reward, ended in zip(batch.numpy(), truncated, strict=True):
            running = 0.9 * running + reward
            seen.append(running)
            running = np.zeros((1, 4, 2)) if ended else running
    assert scale.divisor.item() == pytest.approx(np.std(seen))


@pytest.mark.parametrize("kind", ["first_rollout", "running"])
def test_equal_rewards_do_not_divide_by_zero(kind):
    scale = reward_scale(kind, 0.0)
    scale.update(torch.full((5, 1, 2, 1), -3.0), NEVER[:5])
    assert 0 < scale.divisor < 1e-3


@pytest.mark.parametrize("kind", ["none", "first_rollout", "running"])
def test_scale_goes_on_from_its_state(kind):
    whole, first = reward_scale(kind, 0.9), reward_scale(kind, 0.9)
    for scale in (whole, first):
        scale.update(rewards(), NEVER)
    second = reward_scale(kind, 0.9)
    second.load_state_dict([first.state_dict()])
    for scale in (whole, second):
        scale.update(rewards(seed=1), torch.arange(12) == 11)
    assert second.state_dict()["moments"] == whole.state_dict()["moments"]
    assert second.divisor == whole.divisor
