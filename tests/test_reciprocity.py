"""All ports of a device are derivatives of one potential: reciprocity, closed cycles, p dV.

At given values of the ports it is Pi = elastic - electric energy - p times volume, with
dPi = F du - sum Q dV - volume dp. Work is integrated by Gauss's rule over states that are solved at
its points: the history's own sums, by the trapezoidal rule, are of second order in the steps.

There is no air here. Its mesh follows the solid one-way, so that a device in air is reciprocal to
the discretisation only: in 2 mm of air to 3 % on this mesh, to 0.4 % on 96 x 16 cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import history
from laminates import config, layer, simulation

from dealib.fem.differential import port_stiffness

Array = npt.NDArray[np.float64]
Row = dict[str, Any]

# mm, kV, kV, MPa, and their duals: N, uC, uC, mm^3; work in mJ
VALUES = {"displacement_mm": 1, "voltage_kV.drive": 1, "voltage_kV.sense": 1, "pressure_kPa": 1e-3}
DUALS = {"force_N": 1, "charge_uC.drive": -1, "charge_uC.sense": -1, "volume_mm3": -1}
AT = np.array([-0.6, 6.0, 3.0, 0.8e-3])
STEPS = np.array([0.01, 0.05, 0.05, 0.01e-3])


def led(points: Sequence[Array], **changes: Any) -> tuple[list[Row], Any]:
    """An annulus with a mount, two terminals and a chamber, led through values of all its ports.

    Returns:
        The states at the points, and the simulation at the last one.
    """
    program = [
        {
            "stage": f"to{k}",
            "mount": {"displacement": f"{u!r} mm"},
            "terminals": {"drive": {"voltage": f"{V!r} kV"}, "sense": {"voltage": f"{W!r} kV"}},
            "chamber": {"pressure": f"{p!r} MPa"},
        }
        for k, (u, V, W, p) in enumerate(np.array(points).tolist())
    ]
    run = simulation(
        config(
            "annulus",
            layer(thickness="0.2 mm"),
            mesh={"columns": 12, "film_rows": 2},
            terminals={
                "drive": {"on": "film.top", "within": ["6 mm", "7.8 mm"]},
                "sense": {"on": "film.top", "within": ["8 mm", "10 mm"]},
                "ground": {"on": "film.bottom", "ground": True},
            },
            chambers={"below": {"on": "film.bottom"}},
            sensing={"differential": True},
            program=program,
            **changes,
        )
    )
    rows = {state.row["stage"]: state.row for state in run}  # the last of each stage
    return [rows[f"to{k}"] for k in range(len(points))], run


def duals(row: Row) -> Array:
    """Derivatives of the potential by the ports' values."""
    return np.array([sign * row[name] for name, sign in DUALS.items()])


def potential(row: Row) -> float:
    """It, mJ."""
    stored = row["elastic_energy_mJ"] - row["electric_energy_mJ"]
    return float(stored - 1e-3 * row["pressure_kPa"] * row["volume_mm3"])


def test_the_matrix_of_second_derivatives_is_symmetric():
    """From differences of duals of solved states; the tangent and the history give the same."""
    weights = {1: 45 / 60, 2: -9 / 60, 3: 1 / 60}  # of central differences of the sixth order
    moves = [(k, sign * n) for k in range(4) for n in weights for sign in (1, -1)]
    rows, run = led([*(AT + n * STEPS * np.eye(4)[k] for k, n in moves), AT])
    found = np.zeros((4, 4))
    for (k, n), row in zip(moves, rows, strict=False):
        found[:, k] += np.sign(n) * weights[abs(n)] * duals(row) / STEPS[k]
    sizes = np.sqrt(np.abs(np.outer(np.diag(found), np.diag(found))))
    assert (np.abs(found) > 1e-3 * sizes).all()  # all ports are coupled
    transposed = found.T.copy()
    assert transposed == pytest.approx(found, rel=1e-6)
    tangent = port_stiffness(run.engine.newton)
    assert tangent == pytest.approx(found, rel=1e-6)
    row = rows[-1]
    assert row["mount_stiffness_N_per_mm"] == pytest.approx(found[0, 0], rel=1e-6)
    for k, name in ((1, "drive"), (2, "sense")):
        C = row[f"differential_capacitance_pF.{name}"]
        slope = -1e3 * found[k, k]
        assert slope == pytest.approx(C, rel=1e-6)
        # stiffer where it cannot move
        assert row[f"capacitance_pF.{name}.{name}"] < C
    frozen = row["capacitance_pF.drive.sense"], row["capacitance_pF.sense.drive"]
    assert frozen[0] == pytest.approx(frozen[1], rel=1e-12)


def test_a_closed_cycle_over_all_ports_does_no_work():
    """And on each of its edges the work is what the potential gains."""
    corners = [
        np.array(c)
        for c in (
            (0.0, 0.0, 0.0, 0.0), (-0.8, 1.0, 0.0, 0.5e-3), (-0.4, 6.0, 2.0, 1e-3),
            (0.2, 4.0, 5.0, 0.2e-3), (0.0, 0.0, 0.0, 0.0),
        )
    ]  # fmt: skip
    places, weights = np.polynomial.legendre.leggauss(10)
    shares = (1 + places) / 2
    points = []
    for a, b in pairwise(corners):
        points += [a + s * (b - a) for s in shares] + [b]
    rows, _ = led(points)
    edges = [rows[k : k + 11] for k in range(0, len(rows), 11)]
    work, gained, last = [], [], 0.0
    for (a, b), states in zip(pairwise(corners), edges, strict=True):
        powers = np.array([duals(row) @ (b - a) for row in states[:10]])
        work.append(weights @ powers / 2)
        gained.append(potential(states[-1]) - last)
        last = potential(states[-1])
    size = max(row["elastic_energy_mJ"] + row["electric_energy_mJ"] for row in rows)
    assert np.abs(gained).min() > 1e-3 * size
    assert work == pytest.approx(gained, abs=1e-8 * size)
    assert abs(sum(work)) < 1e-8 * size


@pytest.mark.parametrize("device", ["diaphragm_pump", "balloon"])
def test_the_work_of_a_pressure_is_the_integral_of_p_by_volume(device):
    """It is what the film stores; the history's sum tends to it with the second power of steps."""
    top = {"diaphragm_pump": 2.4, "balloon": 12.0}[device]  # ml
    places, weights = np.polynomial.legendre.leggauss(16)
    knots = ", ".join(f"{top * (1 + x) / 2} ml" for x in places.tolist())
    go = "[{{stage: go, chamber: {{volume: [{0}, {1} ml]}}, steps: {2}}}]"
    fine = history(f"devices/{device}", program=go.format(knots, top, 17))
    at = fine.iloc[-len(places) - 1 : -1]
    assert at["volume_mm3"].to_numpy() == pytest.approx(500 * top * (1 + places))
    work = 1e-3 * 500 * top * weights @ at["pressure_kPa"]
    stored = np.diff(fine["elastic_energy_mJ"].iloc[[0, -1]])[0]
    assert work == pytest.approx(stored, rel=1e-8)
    errors = []
    for steps in (8, 16, 32):
        h = history(f"devices/{device}", program=go.format("0 ml", top, steps))
        row = h.iloc[-1]
        errors.append(row["chamber_work_mJ"] - work)
        assert row["energy_residual_mJ"] == pytest.approx(-errors[-1], rel=1e-4)
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.2)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.1)
