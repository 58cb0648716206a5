"""Friendly names and units of history columns, read from their names."""

from __future__ import annotations

import re

from dealib.results.summary import MARGINS

# SI prefix and unit; '_per_' divides: field_max_MV_per_m
_UNIT = r"(?:[fpnumkMG]?(?:m|s|g|N|V|C|F|J|W|A|Pa|Hz|ohm)[23]?|deg|Nmm)"
_SUFFIX = re.compile(rf"(?P<name>\w+?)_(?P<unit>{_UNIT}(?:_per_{_UNIT})?)")

_NAMES = {
    "time": "Time",
    "displacement": "Displacement",
    "force": "Force",
    "field_max": "Peak field",
    "thickness_stretch_min": "Smallest thickness stretch",
    "stretch_max": "Largest stretch",
    "mount_work": "Work at the mount",
    "terminal_work": "Work at the terminal",
    "chamber_work": "Work at the chamber",
    "turn_work": "Work of the turn",
    "energy_residual": "Energy balance residual",
    "tension_min": "Smallest tension, thickness average",
    "rc_time": "Slowest time constant of the electrodes",
} | {column: f"{name.capitalize()}: use" for column, (name, *_) in MARGINS.items()}

_KINDS = {
    "mm": "Length", "N": "Force", "kV": "Voltage", "µC": "Charge", "pF": "Capacitance",
    "mJ": "Energy", "mW": "Power", "MV/m": "Field", "MPa": "Stress", "s": "Time",
    "kPa": "Pressure", "mm³": "Volume", "deg": "Angle", "Nmm": "Moment",
}  # fmt: skip


def plain(text: object) -> str:
    """A user's text for a picture, without mathtext and never left out of a legend.

    Every text that contains a user's words passes through this function.
    """
    said = str(text).replace("$", r"\$")
    return f" {said}" if said.startswith("_") else said  # Matplotlib's legends skip '_...'


def kind(unit: str) -> str:
    """Axis label of several columns of one unit."""
    return f"{_KINDS[unit]} ({unit})" if unit in _KINDS else f"({unit})" if unit else ""


def split(column: str) -> tuple[str, str]:
    """Friendly name and unit ('' if there is none) of a column.

    `field_max_MV_per_m` gives ('Peak field', 'MV/m'), `voltage_kV.drive` 'Voltage of drive',
    `force_N.plate.X` 'Force of plate.X', and `capacitance_pF.a.b` 'Capacitance of a and b'.
    """
    stem, *ports = column.split(".")
    found = _SUFFIX.fullmatch(stem)
    name, unit = (found["name"], found["unit"]) if found else (stem, "")
    unit = re.sub(r"^u|(?<=/)u", "µ", unit.replace("_per_", "/"))
    unit = re.sub("(?<=m)[23]", lambda power: "²³"[int(power[0]) - 2], unit)
    name = _NAMES.get(name, name[:1].upper() + name[1:].replace("_", " "))
    if name == "Capacitance":  # of a pair; of one port with itself it is of this port
        ports = [" and ".join(dict.fromkeys(ports))] if ports else []
    of = ".".join(ports)
    return plain(f"{name} of {of}" if of else name), unit


def label(column: str) -> str:
    """Axis label of a column, such as 'Peak field (MV/m)'."""
    name, unit = split(column)
    return f"{name} ({unit})" if unit else name
