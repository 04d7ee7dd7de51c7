"""Metrics of a user's, for one test."""

import pytest
from own_metrics import register_own


@pytest.fixture
def own(forgotten_metrics):
    register_own()
