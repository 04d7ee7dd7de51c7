"""Seas and losses that do not fit a scenario, or whose files say nothing: one line each."""

import pytest
from seas import ROUGH, SHADOWING

from iout_marl import InputError, load_scenario

FILES = {
    "wind that ends early": (
        "channel.wind",
        "time_s,wind_m_per_s\n0,5\n500,6\n",
        r"wind\.csv: time_s: reaches from 0 to 500 s, but the episode from 0 to 1000 s",
    ),
    "wind that begins late": ("channel.wind", "time_s,wind_m_per_s\n9,5\n5000,6\n", "from 9 to"),
    "wind backwards": ("channel.wind", "time_s,wind_m_per_s\n0,5\n0,6\n", "time_s: must rise"),
    "wind of one line": ("channel.wind", "time_s,wind_m_per_s\n0,5\n", "two or more"),
    "a hurricane": ("channel.wind", "time_s,wind_m_per_s\n0,5\n2000,500\n", "and 120, not 500"),
    "wind below nothing": ("channel.wind", "time_s,wind_m_per_s\n0,-1\n2000,5\n", "not -1"),
    "no wind": ("channel.wind", "time_s,speed\n0,5\n", "has no wind_m_per_s: it has time_s, speed"),
    "wind that is no number": (
        "channel.wind",
        "time_s,wind_m_per_s\n0,5\n2000,nan\n",
        r"wind\.csv: line 3: wind_m_per_s: must be a finite number, not nan",
    ),
    "shares above 1": ("uplink.loss", "snr_db,packet_error_rate\n0,1\n9,1.5\n", "and 1, not 1.5"),
    "shares in percent": ("uplink.loss", "snr_db,packet_error_rate\n0,-2\n9,0\n", "not -2"),
    "ratios backwards": (
        "uplink.loss",
        "snr_db,packet_error_rate\n9,0\n0,1\n",
        "snr_db: must rise",
    ),
    "one ratio": ("uplink.loss", "snr_db,packet_error_rate\n9,0\n", "two or more"),
    "no shares": ("uplink.loss", "snr_db,per\n0,1\n9,0\n", "has no packet_error_rate"),
}


@pytest.mark.parametrize("case", FILES)
def test_files_are_refused(tmp_path, case):
    key, text, message = FILES[case]
    file = tmp_path / f"{key.rpartition('.')[2]}.csv"
    file.write_text(text)
    kind = {"channel.wind": "series", "uplink.loss": "table"}[key]
    with pytest.raises(InputError, match=message):
        load_scenario("paper/k3-fdd", {**ROUGH, key: {"kind": kind, "file": str(file)}})


def test_shares_need_not_fall(tmp_path):
    (tmp_path / "loss.csv").write_text("snr_db,packet_error_rate\n0,0.5\n3,0.6\n9,0\n")
    loss = {"kind": "table", "file": str(tmp_path / "loss.csv")}
    load_scenario("paper/k3-fdd", {**ROUGH, "uplink.loss": loss})


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        ({"duplex": {"kind": "tdd"}, "uplink": None}, "takes duplex.beta_rule: airtime"),
        ({"channel": {"kind": "equation", "fading": SHADOWING}}, "it belongs to kind 'sonar'"),
        ({"channel.fading": {**SHADOWING, "sigma_db": 0}}, "sigma_db: must be greater than 0"),
        ({"channel.fading": {**SHADOWING, "sigma_db": 30}}, "30 dB is implausible"),
        ({"channel.fading": "rician"}, "unknown kind 'rician'"),
        ({"uplink.margin_db": -1}, "margin_db: must be greater than or equal to 0"),
        ({"uplink.loss": "treshold"}, "did you mean 'threshold'"),
    ],
)
def test_what_does_not_go_together_is_told(overrides, message):
    shannon = {"kind": "shannon", "packet_bits": 2048.0, "bandwidth_hz": 4500.0}
    if "uplink" in overrides:
        overrides = {**overrides, "uplink": shannon}
    with pytest.raises(InputError, match=message):
        load_scenario("paper/k3-fdd", {**ROUGH, **overrides})
