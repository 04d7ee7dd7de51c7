"""Every built-in part has a twin in the oracle, or a line here that says why not."""

import pytest
from test_oracle import CASES

from iout_marl import load_scenario
from iout_marl.parts import Part
from iout_marl.registry import registries
from iout_marl.scenario.parts import parts_in

#: By role and kind: why it has none.
WITHOUT: dict[tuple[str, str], str] = {
    ("current", "gauss_markov"): "plays beside the oracle in test_currents, by numbers drawn",
}


@pytest.fixture(scope="module")
def played():
    """The roles and kinds in episodes that the oracle has played, too."""
    found = set()
    for case in CASES.values():
        scenario = load_scenario(case.scenario, case.overrides)
        found |= {(s.entry.role, s.entry.kind) for _, s in parts_in(scenario)}
        found |= {(s.entry.role, s.entry.kind) for s in scenario.seen}
    return found


@pytest.mark.slow
@pytest.mark.parametrize(
    ("role", "kind"),
    [
        pytest.param(registry.role, entry.kind, id=f"{registry.role}-{entry.kind}")
        for registry in registries()
        if registry.base is not None and issubclass(registry.base, Part)
        for entry in registry
        if not entry.is_outside and entry.item.is_of_world
    ],
)
def test_a_twin_has_played(played, role, kind):
    assert ((role, kind) in played) != ((role, kind) in WITHOUT)
