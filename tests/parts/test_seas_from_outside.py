"""Fading, wind and losses of a user's own: they keep the contracts, or are told what they lack."""

import numpy as np
import pytest
from seas import ROUGH

from iout_marl import InputError, World, load_scenario, parts
from iout_marl.core.chance import Draw
from iout_marl.testing import check_part


class Blinking(parts.Fading):
    """Links are 4 dB louder or fainter, each by a coin in every slot."""

    is_active = True
    most_db = 4.0

    def gain_db(self, state, chance):
        return self.xp.where(chance.fading > 0, self._up, self._down)

    def setup(self, world):
        super().setup(world)
        self._up, self._down = (world.backend.floats(db) for db in (4.0, -4.0))


class Rising(parts.Wind):
    """Wind that rises by 0.1 m/s in each slot, and a gust that is drawn."""

    changes = is_drawn = True

    def draws(self, scenario):
        return {"wind": Draw("normal", (1,))} if self.matters(scenario) else {}

    def most_m_per_s(self, mean_m_per_s):
        return mean_m_per_s + 40

    def setup(self, world):
        super().setup(world)
        self._step, self._none = (world.backend.floats(v) for v in (0.1, 0.0))

    def blowing(self, state, chance):
        slot = self.xp.astype(state.slot, state.age.dtype)[:, None]
        speed = self.xp.maximum(slot * self._step + chance.wind, self._none)
        return parts.Blowing(speed, chance.wind)


class Coded(parts.Loss):
    """A code that corrects all but what is 2 dB too weak."""

    loses = True

    def packet_error_rate(self, snr_db, uplink):
        return np.where(snr_db < uplink.required_snr_db - 2, 1.0, 0.1)


ROLES = [
    (parts.Fading, parts.fadings, "channel.fading"),
    (parts.Wind, parts.winds, "channel.wind"),
    (parts.Loss, parts.losses, "uplink.loss"),
]


@pytest.fixture
def registered(forgotten_parts):
    """Registers a part by its role; returns the overrides that name it."""

    def register(part):
        _, registry, key = next(row for row in ROLES if issubclass(part, row[0]))
        registry.register("mine", version=1)(part)
        return {**ROUGH, key: "mine"}

    return register


@pytest.mark.slow
@pytest.mark.parametrize(
    ("role", "part"), [("fading", Blinking), ("wind", Rising), ("loss", Coded)]
)
def test_they_keep_the_contracts(registered, role, part):
    registered(part)
    check_part(role, "mine")


def changed(base, **attributes):
    return type("Mine", (base,), attributes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("part", "message"),
    [
        (
            changed(Blinking, gain_db=lambda self, s, c: c.fading[..., 0]),
            "gain_db must be of float",
        ),
        (changed(Blinking, gain_db=lambda self, s, c: c.fading / 0), "gain_db must be finite"),
        (changed(Blinking, most_db=-1.0), "most_db must be 0 or more dB, not -1.0"),
        (changed(Blinking, is_active=1), "is_active must be True or False, not 1"),
        (
            changed(Rising, blowing=lambda self, s, c: parts.Blowing(c.wind - 50, c.wind)),
            "speed_m_per_s must not be negative",
        ),
        (changed(Rising, blowing=lambda self, s, c: c.wind), "must return a Blowing"),
        (changed(Rising, changes=None), "changes must be True or False"),
        (
            changed(Coded, packet_error_rate=lambda self, snr, uplink: snr),
            "packet_error_rate must lie between 0 and 1",
        ),
        (
            changed(Coded, packet_error_rate=lambda self, snr, uplink: 0.5),
            "must give a number for each ratio",
        ),
        (changed(Coded, is_certain=True), "must be 0 or 1 where is_certain is True"),
    ],
)
def test_what_they_lack_is_told(registered, part, message):
    with pytest.raises(InputError, match=message):
        World(load_scenario("paper/k3-fdd", registered(part)))


def test_what_they_say_decides(registered):
    still = {"channel.fading": "none", "channel.wind": "steady"}
    world = World(load_scenario("paper/k3-fdd", {**registered(Coded), **still}), 500)
    state, chance = world.reset(), world.draw_chance(0)
    rich = state._replace(energy_j=state.energy_j + 50)
    lost = sent = 0
    for _ in range(10):
        _, events = world.step(rich, np.zeros((500, 1, 3), dtype=np.int64), next(chance))
        sent, lost = sent + int((events.spent_j > 0).sum()), lost + int(events.lost.sum())
    assert lost / sent == pytest.approx(0.1, abs=0.03)
