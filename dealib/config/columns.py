"""The columns of `history.csv` that are numbers, and their units; not every run has all of them."""

from __future__ import annotations

COLUMNS = {
    "step": "",
    "time_s": "s",
    "displacement_mm": "mm",
    "force_N": "N",
    "voltage_kV": "kV",
    "charge_uC": "uC",
    "capacitance_pF": "pF",
    "elastic_energy_mJ": "mJ",
    "electric_energy_mJ": "mJ",
    "field_max_MV_per_m": "MV/m",
    "thickness_stretch_min": "",
    "newton_iterations": "",
    "stretch_max": "",
    "tension_min_MPa": "MPa",
    "breakdown_use": "",
    "wrinkling_use": "",
    "pull_in_use": "",
    "stability_use": "",
    "stretch_use": "",
    "locking_use": "",
    "differential_capacitance_pF": "pF",
    "blocked_capacitance_pF": "pF",
    "mount_stiffness_N_per_mm": "N/mm",
    "electrode_resistance_kohm": "kohm",
    "rc_time_us": "us",
    "mount_work_mJ": "mJ",
    "terminal_work_mJ": "mJ",
    "energy_residual_mJ": "mJ",
}
