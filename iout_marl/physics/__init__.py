"""Underwater acoustics, energy transfer and uplink: arrays in, arrays out.

Decibels, watts, joules and seconds; nothing here knows of scenarios or environments.
Every function takes Python numbers or arrays of one library of the array API standard,
broadcasts them, and names the paper's equation or the source that it follows. Lists and tuples
will do as well. What is no number, or lies outside an argument's domain, is an `InputError` (a
ValueError) that names argument, domain and value. A function's `unchecked` leaves that out, for
`torch.compile` say; it takes Python numbers and arrays of one library.
"""

from iout_marl.physics.absorption import (
    francois_garrison_absorption_db_per_km,
    thorp_absorption_db_per_km,
)
from iout_marl.physics.harvesting import (
    aperture_power_w,
    available_power_w,
    harvested_energy_j,
    harvested_power_w,
    incident_power_w,
    induced_voltage_v,
)
from iout_marl.physics.noise import ambient_noise_band_level_db, ambient_noise_spectral_level_db
from iout_marl.physics.propagation import (
    REFERENCE_LEVEL_DB,
    SEA_WATER_KG_PER_M3,
    SOUND_SPEED_M_PER_S,
    electrical_power_w,
    intensity_w_per_m2,
    received_level_db,
    round_trip_s,
    source_level_db,
    table_attenuation_db,
    transmission_loss_db,
)
from iout_marl.physics.propulsion import economical_speed_m_per_s, propulsion_power_w
from iout_marl.physics.sound_speed import mackenzie_sound_speed_m_per_s
from iout_marl.physics.splitting import (
    attenuation_at_balance_db,
    attenuation_distance_m,
    beta_star,
    g,
    g_slope,
    h,
    kappa,
    kappa_2,
    kappa_3,
    smallest_beta,
)
from iout_marl.physics.uplink import (
    airtime_s,
    approximate_required_energy_j,
    modem_energy_j,
    required_energy_j,
    required_snr,
    sonar_transmit_power_w,
    transmit_power_w,
)

__all__ = [
    "REFERENCE_LEVEL_DB",
    "SEA_WATER_KG_PER_M3",
    "SOUND_SPEED_M_PER_S",
    "airtime_s",
    "ambient_noise_band_level_db",
    "ambient_noise_spectral_level_db",
    "aperture_power_w",
    "approximate_required_energy_j",
    "attenuation_at_balance_db",
    "attenuation_distance_m",
    "available_power_w",
    "beta_star",
    "economical_speed_m_per_s",
    "electrical_power_w",
    "francois_garrison_absorption_db_per_km",
    "g",
    "g_slope",
    "h",
    "harvested_energy_j",
    "harvested_power_w",
    "incident_power_w",
    "induced_voltage_v",
    "intensity_w_per_m2",
    "kappa",
    "kappa_2",
    "kappa_3",
    "mackenzie_sound_speed_m_per_s",
    "modem_energy_j",
    "propulsion_power_w",
    "received_level_db",
    "required_energy_j",
    "required_snr",
    "round_trip_s",
    "smallest_beta",
    "sonar_transmit_power_w",
    "source_level_db",
    "table_attenuation_db",
    "thorp_absorption_db_per_km",
    "transmission_loss_db",
    "transmit_power_w",
]
