"""Small worlds in which AUVs poll, and energy is short but now and then enough for several."""

#: Packets of 2.7 s in slots of 50 s.
MODEM = {
    "grid.spacing_m": 10,
    "auvs.speed_m_per_s": 0.2,
    "charging.power_w": 400,
    "channel": {"kind": "sonar", "spreading_factor": 2.0, "wind_m_per_s": 12.0},
    "harvester": {"kind": "aperture", "area_m2": 0.03, "efficiency": 0.6},
    "uplink": {
        "kind": "modem",
        "bit_rate_bps": 3000.0,
        "packet_bits": 8000.0,
        "bandwidth_hz": 4500.0,
        "electronics_w": 0.8,
        "maximum_source_level_db": 151.0,
        "required_snr_db": 10.0,
    },
}
IN_TIME_DIVISION = {
    "duplex": {"kind": "tdd", "beta_rule": "airtime", "beta_max": 0.7},
}


def polling(most, name="paper/k5-fdd", **changes):
    """The overrides for worlds in which an AUV hears so many nodes a slot."""
    split = IN_TIME_DIVISION if "tdd" in name else {}
    return {
        **MODEM,
        **split,
        "hearing": {"kind": "polling", "max_nodes_per_slot": most},
        **changes,
    }
