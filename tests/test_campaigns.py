"""A few cases of every campaign; `make campaigns` plays all of them."""

import pytest
from campaigns.campaign import campaigns, play


@pytest.mark.campaign
@pytest.mark.parametrize("campaign", campaigns(), ids=lambda campaign: campaign.name)
def test_a_few_cases_leave_no_fault(campaign):
    tally = play(campaign, campaign.short, seed=0)
    assert tally.faults == []
    assert tally.cases >= campaign.short
