"""What moving through water takes."""

from __future__ import annotations

from iout_marl.physics.arrays import Array, ArrayLike, as_arrays
from iout_marl.physics.formula import EFFICIENCY, NOT_NEGATIVE, POSITIVE, formula
from iout_marl.physics.propagation import SEA_WATER_KG_PER_M3


@formula(
    speed_m_per_s=NOT_NEGATIVE,
    drag_area_m2=POSITIVE,
    drag_coefficient=POSITIVE,
    efficiency=EFFICIENCY,
    density_kg_per_m3=POSITIVE,
)
def propulsion_power_w(
    speed_m_per_s: ArrayLike,
    drag_area_m2: ArrayLike,
    drag_coefficient: ArrayLike,
    efficiency: ArrayLike,
    density_kg_per_m3: ArrayLike = SEA_WATER_KG_PER_M3,
) -> Array:
    """Electric power of a vehicle's propulsion, P = ½ ρ C_d A v³ / η, of quadratic drag at speed v.

    Args:
        speed_m_per_s: v in m/s, through the water, not negative.
        drag_area_m2: the area A that C_d refers to, in m², above 0.
        drag_coefficient: C_d, above 0.
        efficiency: η from the battery to the thrust, above 0 and at most 1.
        density_kg_per_m3: ρ in kg/m³, above 0; of sea water unless given.

    Returns:
        power in W, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, speed, area, coefficient, eta, density = as_arrays(
        speed_m_per_s, drag_area_m2, drag_coefficient, efficiency, density_kg_per_m3
    )
    return 0.5 * density * coefficient * area * speed * speed * speed / eta


@formula(
    hotel_w=NOT_NEGATIVE,
    drag_area_m2=POSITIVE,
    drag_coefficient=POSITIVE,
    efficiency=EFFICIENCY,
    density_kg_per_m3=POSITIVE,
)
def economical_speed_m_per_s(
    hotel_w: ArrayLike,
    drag_area_m2: ArrayLike,
    drag_coefficient: ArrayLike,
    efficiency: ArrayLike,
    density_kg_per_m3: ArrayLike = SEA_WATER_KG_PER_M3,
) -> Array:
    """The speed at which a metre takes least energy, (P_hotel η / (ρ C_d A))^(1/3), in still water.

    There (P_hotel + P) / v, with P of `propulsion_power_w`, is least, and P half of P_hotel.

    Args:
        hotel_w: P_hotel in W, what the vehicle draws beside propulsion, not negative.
        drag_area_m2, drag_coefficient, efficiency, density_kg_per_m3: as for
            `propulsion_power_w`.

    Returns:
        speed in m/s, in the broadcast shape of the arguments.

    Raises:
        InputError: an argument lies outside its range.
    """
    _, hotel, area, coefficient, eta, density = as_arrays(
        hotel_w, drag_area_m2, drag_coefficient, efficiency, density_kg_per_m3
    )
    return (hotel * eta / (density * coefficient * area)) ** (1 / 3)
