"""Three strips with air on which two independent codes agree to six digits.

Those codes took eps0 = 8.854e-12 F/m; dealib has CODATA's value, 2.1e-5 above it, so the film's
relative permittivity is scaled here. The air is one-way and meets only the electrodes' faces, where
all is at one potential: without clamps it can change nothing, and the references with air, which
differ by 5e-5 N from those without even at 0 V, must come from another mesh of the strips. They are
held to 1e-4; that air changes nothing is held to 1e-9. Without air the strips are a benchmark in
configs/validation.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import dealib
from dealib.units import EPSILON_0
from verification.table import Row

CONFIGS = Path(__file__).parents[2] / "configs"


def history(name: str, **changes: object) -> list[dict[str, float]]:
    """Rows of the history of a shipped config, with the permittivity of the two codes."""
    scaled = {"materials.film.relative_permittivity": 3 * 8.854e-6 / EPSILON_0}
    case = dealib.load(CONFIGS / f"{name}.yaml", set=scaled | changes)
    return [state.row for state in dealib.Simulation(case)]


def states(name: str, **changes: object) -> dict[str, float]:
    """Force and capacitance at -3 mm, at 0 and 2.5 kV, and the capacitance at rest, by name."""
    rows = history(name, **changes)
    pushed = next(r for r in reversed(rows) if r["voltage_kV"] == 0)
    found = {"capacitance at rest, pF": rows[0]["capacitance_pF"]}
    for row, volts in ((pushed, "0 kV"), (rows[-1], "2.5 kV")):
        found[f"force at -3 mm, {volts}, N"] = row["force_N"]
        found[f"capacitance at -3 mm, {volts}, pF"] = row["capacitance_pF"]
    return found


def in_air() -> Iterator[Row]:
    """The strips with air."""
    name, known = "benchmark_strip_air", (-1.07528, 355.478, -0.81336, 359.117)
    found, without = states(name), states("benchmark_strip")
    for quantity, reference in zip(list(found)[1:], known, strict=True):
        yield Row(name, quantity, reference, found[quantity], 1e-4, "two independent codes")
    for quantity, computed in list(found.items())[1:]:
        yield Row(name, quantity, without[quantity], computed, 1e-9, "dealib without air")


def air_stiffness() -> Iterator[Row]:
    """The air's fictitious stiffness is not felt over three decades, with fringes in the blocks."""
    name = "benchmark_strip_air"
    clamps = {f"geometry.clamps.{k}": f"{v} mm" for k, v in (("width", 2), ("height", 1.5))}
    reference = states(name, **clamps)
    for stiffness in ("1e-8 MPa", "1e-5 MPa"):
        found = states(name, **clamps, **{"physics.air_stiffness": stiffness})
        case = f"{name} with clamps, air_stiffness {stiffness}"
        for quantity, computed in list(found.items())[1:]:
            yield Row(case, quantity, reference[quantity], computed, 1e-6, "dealib at 1e-6 MPa")
