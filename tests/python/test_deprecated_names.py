"""Names of the version before still work, with a warning that says what to write."""

import importlib

import pytest

from iout_marl.parts import Request
from iout_marl.world import Events

RENAMED = {
    "iout_marl.Episode": "iout_marl.Trajectory",
    "iout_marl.bounds.USUAL_SECONDS": "iout_marl.bounds.DEFAULT_SECONDS",
    "iout_marl.policies.UNTRAINED": "iout_marl.policies.POLICIES",
    "iout_marl.policies.USUAL": "iout_marl.policies.DEFAULT_BUDGET",
    "trainers.Group": "trainers.ProcessGroup",
}


def found(dotted):
    module, _, name = dotted.rpartition(".")
    return getattr(importlib.import_module(module), name)


@pytest.mark.parametrize(("old", "new"), RENAMED.items(), ids=list(RENAMED))
def test_old_name_leads_to_the_new_one(old, new):
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}; ") as warned:
        assert found(old) is found(new)
    assert warned[0].filename == __file__


@pytest.mark.parametrize("kind", [Events, Request])
def test_fields_of_what_parts_are_given(kind):
    given = kind(*range(len(kind._fields)))
    with pytest.warns(DeprecationWarning, match=f"^{kind.__name__}.payable_j is now ") as warned:
        assert given.payable_j is given.available_j
    assert warned[0].filename == __file__
