"""Names of the version before still work, with a warning that says what to write."""

import importlib

import pytest

RENAMED = {"trainers.Group": "trainers.ProcessGroup"}


def found(dotted):
    module, _, name = dotted.rpartition(".")
    return getattr(importlib.import_module(module), name)


@pytest.mark.parametrize(("old", "new"), RENAMED.items(), ids=list(RENAMED))
def test_old_name_leads_to_the_new_one(old, new):
    with pytest.warns(DeprecationWarning, match=f"^{old} is now {new}; ") as warned:
        assert found(old) is found(new)
    assert warned[0].filename == __file__
