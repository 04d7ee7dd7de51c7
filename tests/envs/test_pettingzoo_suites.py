"""PettingZoo's own suites, unmodified, on the parallel form and on the AEC form."""

from functools import partial

import pytest
from env_cases import CASES, SLOTS, case_scenario
from pettingzoo.test import (
    api_test,
    max_cycles_test,
    parallel_api_test,
    parallel_seed_test,
    render_test,
    seed_test,
)
from pettingzoo.test.state_test import state_test

from iout_marl import iout_v0

#: More than an episode, so that suites see its end.
CYCLES = SLOTS + 5

AEC_FORMS = pytest.mark.parametrize("form", [iout_v0.env, iout_v0.raw_env])


@pytest.fixture(params=CASES)
def world(request):
    return case_scenario(request.param)


@pytest.mark.slow
def test_parallel_api(world):
    parallel_api_test(iout_v0.parallel_env(world), CYCLES)


@pytest.mark.slow
def test_parallel_seed(world):
    parallel_seed_test(partial(iout_v0.parallel_env, world), CYCLES)


# api_test advises Box and Discrete only; an action of several entries is neither, nor is
# an observation with its mask beside it, for which api_test knows a list of environments.
@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Action space for each agent probably should be")
@pytest.mark.filterwarnings("ignore:Observation space for each agent probably should be")
@pytest.mark.filterwarnings("ignore:Observation is not a NumPy array")
@AEC_FORMS
def test_aec_api(world, form):
    api_test(form(world), CYCLES)


@pytest.mark.slow
@AEC_FORMS
def test_aec_seed(world, form):
    seed_test(partial(form, world), CYCLES)


@pytest.mark.slow
def test_state(world):
    state_test(iout_v0.env(world), iout_v0.parallel_env(world), CYCLES)


def test_max_cycles():
    max_cycles_test(iout_v0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("form", "case"),
    [(iout_v0.env, "fdd-1-fixed-none"), (iout_v0.raw_env, "tdd-3-episode-observation")],
)
def test_render(form, case):
    render_test(partial(form, case_scenario(case)))
