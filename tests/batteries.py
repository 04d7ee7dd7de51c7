"""A battery that tests give to AUVs: enough for some slots of charging and many of moving."""

BATTERY = {
    "kind": "battery",
    "capacity_j": 6e5,
    "initial_share": 0.6,
    "drag_area_m2": 3.0,
    "drag_coefficient": 0.006,
    "propulsion_efficiency": 0.7,
    "hotel_w": 200.0,
}
DOCKS = {"docks": [[5, 5, 2], [4, 4, 1], [2, 2, 1], [3, 2, 1]], "dock_power_w": 12000.0}
