"""`dealib sense`: capacitance over displacement and voltage, and displacement from it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dealib.errors import ConfigError
from dealib.results.sensing import CapacitanceMap
from dealib.tasks import measuring
from dealib.tasks.pictures import as_runs, default


def sense(
    directories: Sequence[Path], at: str | None, out: Path | None, dark: bool, overwrite: bool
) -> str:
    """Draw the map of the capacitance and tabulate the error of displacements found from it.

    Args:
        directories: Runs with sweeps of the displacement at constant voltages.
        at: 'PF,KV': a capacitance (pF) and a voltage (kV) to turn into a displacement.
        out: Picture; default in `plots` of the first run.
        dark: On a dark background.
        overwrite: Replace the picture.

    Returns:
        The text to print.

    Raises:
        ConfigError: If the runs give no map or differ in their device, or `at` is not on the map.
    """
    from dealib.plots import style
    from dealib.plots.sensing import draw

    if out is not None:
        style.check_target(out, style.FORMATS, overwrite)
    runs = as_runs(list(directories))
    found = measuring.sense(runs)
    if at is not None:
        return f"{_displacement(found, at):.6g} mm"
    target = out or default(runs, "sensing", dark)
    with style.theme(dark):
        style.save(draw(found, str(runs[0].info["name"])), target)
    return "\n".join([*_table(found), *_notes(found), str(target)])


def _displacement(found: CapacitanceMap, at: str) -> float:
    try:
        capacitance, voltage = (float(part) for part in at.split(","))
    except ValueError:
        raise ConfigError(f"--at {at}: expected pF,kV such as 250.3,1.5") from None
    try:
        return found.displacement(capacitance, voltage)
    except ValueError as error:
        raise ConfigError(f"--at {at}: {error}") from None


def _table(found: CapacitanceMap) -> list[str]:
    lines = [f"{found.low:.4g} .. {found.high:.4g} mm", ""]
    lines.append(f"{'kV':>8} {'pF':>20} {'pF/mm':>20} {'error, um':>16}")
    ends = np.array([found.low, found.high])
    for sweep, (_, error) in zip(found.sweeps, found.errors(), strict=True):
        C, slope = sweep.at(ends), sweep.sensitivity(ends)
        lines.append(
            f"{sweep.voltage:8.4g} {C[0]:9.5g} .. {C[1]:7.5g} {slope[0]:9.4g} .. {slope[1]:7.4g} "
            f"{1e3 * error:16.3g}"
        )
    return lines


def _notes(found: CapacitanceMap) -> list[str]:
    """Notes about voltages that are not on the map, and about an ambiguous capacitance."""
    notes, V = [], found.left_out
    if V:
        all_of_them = ", ".join(f"{v:.4g}" for v in V)
        what = f"{len(V)} voltages from {V[0]:.4g} to {V[-1]:.4g}" if len(V) > 6 else all_of_them
        notes.append(f"not on the map, with too few displacements: {what} kV")
    if found.turns:
        notes.append(
            "not unique: the capacitance has an extremum; --at gives the lowest displacement"
        )
    return notes
