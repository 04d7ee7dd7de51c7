"""What is claimed of a sea that changes holds in whatever is drawn: every action is played."""

import numpy as np
import pytest
from small_worlds import least_sum_over_time, small_world

from iout_marl import load_scenario
from iout_marl.bounds import bound, verified_age_sum

LOSSES = {
    "uplink.loss": "bpsk",
    "uplink.required_snr_db": 4.0,
    "channel.wind_m_per_s": 5.0,
    "channel.wind": {"kind": "gauss_markov", "sigma_m_per_s": 3.0, "coherence_s": 500.0},
}
SHADOWING = {"channel.fading": {"kind": "shadowing", "sigma_db": 5.0, "coherence_s": 300.0}}
CASES = [("fdd", "modem", 2, 4, 0), ("tdd", "airtime", 2, 5, 1)]
DRAWS = range(3)


def world(case, overrides):
    duplex, rule, nodes, slots, seed = case
    rng = np.random.default_rng([seed, nodes, slots])
    scenario = small_world(rng, duplex, "six", nodes, slots, rule)
    return load_scenario(scenario, overrides)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case[1])
def test_losses_only_remove(case):
    scenario = world(case, LOSSES)
    found = bound(scenario, seconds=1)
    assert found.energy_and_travel is not None
    assert verified_age_sum(scenario, found.certificate) == found.certificate.age_sum
    numbers = scenario.num_nodes * scenario.num_slots
    still = least_sum_over_time(world(case, {})) / numbers
    least = [least_sum_over_time(scenario, seed) / numbers for seed in DRAWS]
    for optimum in least:
        assert found.scheduling <= optimum + 1e-9
        assert found.energy_and_travel <= optimum + 1e-9
    assert max(least) > still  # something got lost


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=lambda case: case[1])
def test_of_shadowing_only_scheduling_is_claimed(case):
    scenario = world(case, LOSSES | SHADOWING)
    found = bound(scenario, seconds=1)
    assert found.energy_and_travel is None
    assert "fading 'shadowing' raises levels as well as it lowers them" in found.validity
    numbers = scenario.num_nodes * scenario.num_slots
    for seed in DRAWS:
        assert found.scheduling <= least_sum_over_time(scenario, seed) / numbers + 1e-9
