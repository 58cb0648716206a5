"""Branches past limit points: of the free block in closed form, of a membrane on a bistable bias.

The membrane's folds come from its differential equations: at each displacement the voltage at which
the film balances the bias; where that voltage is largest or smallest the branch folds.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
from scipy.optimize import root_scalar

from dealib.config.bias import Bistable, Spring
from dealib.config.case import Case, resolved
from dealib.program import Simulation
from dealib.program.follow import BranchFollower, BranchState
from dealib.program.pair import Pair, PortVariable
from dealib.program.predictor import Predictor
from verification import free_block as block
from verification.bench import config
from verification.membrane import EPSILON, MU, ODE, RADIUS, Sheet
from verification.membrane_ode import Membrane
from verification.table import Row


def follow_block(
    rubber: block.Rubber, kappa: float, stretch: float, steps: int
) -> Iterator[tuple[float, float, float, BranchState]]:
    """Voltage (kV), charge (uC) and stretch of a free block, up to the charge of a stretch."""
    bench = block.block(rubber, kappa)
    phi = np.sqrt((stretch**-2 - stretch**-8) * rubber.stiffening(stretch))
    end = block.charge_at(phi, stretch)
    vary, along = (PortVariable.of(bench.problem.device, n) for n in ("voltage", "charge"))
    pair = Pair(vary, along, (vary.size(bench.problem), end))
    settings = bench.problem.config.solver
    for found in BranchFollower(bench.newton, settings, Predictor(), pair, end, steps).run():
        yield bench.voltage, bench.charge, block.stretch(bench), found


def _block(rubber: block.Rubber, peak: tuple[float, float]) -> Iterator[Row]:
    """The whole curve, and the peak that is solved for on the way."""
    kappa, stretches, errors = 1e5, [], []
    case = f"branch of the free block, {rubber.name}, kappa/mu = 1e5, to l = 1.8"
    for volts, charge, stretch, found in follow_block(rubber, kappa, 1.8, 10):
        exact = block.closed_form(rubber, kappa, charge, stretch)
        errors.append(max(abs(volts / exact[0] - 1), abs(stretch / exact[1] - 1)))
        if found.kind:
            stretches.append(stretch)
            source = "closed form, incompressible"
            yield Row(case, "peak phi~", peak[0], block.normalised(volts), 2e-6, source)
            yield Row(case, "l at the peak", peak[1], stretch, 1e-5, source)
    source = "homogeneous state, scipy"
    yield Row(case, "limit points", 1, len(stretches), 0, source, "absolute")
    quantity = "largest relative error of V and l on the branch"
    yield Row(case, quantity, 0, max(errors), 1e-9, source, "absolute")


SHEET = Sheet(2.0, 1.2, 1.0, 0.0)


def _bias(thinness: float) -> dict[str, Any]:
    """A bias as strong as a film of that H/a needs."""
    return {
        "bistable": Bistable(rate=f"{-150 * thinness!r} N/mm", well="4 mm", anchor="-4 mm"),
        "spring": Spring(stiffness=f"{50 * thinness!r} N/mm", anchor="-9 mm"),
    }


def membrane() -> Iterator[Row]:
    """Both folds of the device on a bistable bias, as its thickness goes to zero.

    The voltage follows from a small difference of forces, so that even a thin body is 5 % off.
    """
    case = "membrane on a bistable bias, b/a = 2, lp = 1.2, kappa/mu = 50"
    thick, thin = (list(_folds(thinness)) for thinness in (0.01, 0.005))
    for name, far, near in zip(("down", "up"), thick, thin, strict=True):
        displacement, square = _fold(near[0], near[1])
        extrapolated = 2 * near[1] - far[1]
        quantity = f"phi~^2 at which it snaps {name}, extrapolated in H/a"
        yield Row(case, quantity, square, extrapolated, 2e-3, ODE)
        quantity = f"u/a at which it snaps {name}, extrapolated in H/a"
        u = (2 * near[0] - far[0]) / RADIUS
        yield Row(case, quantity, displacement / RADIUS, u, 2e-3, ODE)


def _folds(thinness: float) -> Iterator[tuple[float, float]]:
    """Displacement (mm) and phi~^2 of the device's limit points."""
    film = SHEET.layers(thinness)[0]
    geometry = {
        "inner_radius": RADIUS,
        "outer_radius": RADIUS * SHEET.frame,
        "film_thickness": film.mounted_thickness,
    }
    law = {"law": "neo_hookean", "shear_modulus": MU, "bulk_modulus": film.kappa}
    bias = [{name: element.model_dump()} for name, element in _bias(thinness).items()]
    branch = {"vary": "voltage", "along": "displacement", "until": {"displacement": "-6 mm"}}
    given = config(
        geometry,
        law | {"prestretch": film.mounted},
        mesh={"columns": 60, "film_rows": 2},
        program=[
            {"stage": "push", "mount": {"displacement": "-2 mm"}, "steps": 4},
            {"stage": "hang", "mount": {"bias": bias}, "steps": 2},
            {"stage": "branch", "follow": branch, "steps": 10},
        ],
    )
    for state in Simulation(Case(given, resolved(given), Path()), MPI.COMM_WORLD):
        if state.row["limit_point"]:
            phi = state.row["voltage_kV"] / film.thickness * np.sqrt(EPSILON / MU)
            yield state.row["displacement_mm"], float(phi) ** 2


def _fold(displacement: float, square: float) -> tuple[float, float]:
    """Displacement (mm) and phi~^2 of the membrane's fold near given ones."""
    thinness = 0.01  # cancels
    layers = SHEET.layers(thinness)
    sheet = Membrane(RADIUS, RADIUS * SHEET.frame, layers)

    def balanced(u: float) -> float:
        """phi~^2 at which film and bias balance; the force is nearly a straight line over it."""
        load = sum(e.load(u - e.anchor[0])[0] for e in _bias(thinness).values())

        def miss(square: float) -> float:
            volts = layers[0].thickness * np.sqrt(square * MU / EPSILON)
            return sheet.push(-u, float(volts))[0] + load

        return float(root_scalar(miss, x0=0.95 * square, x1=1.05 * square, xtol=1e-9).root)

    u = displacement + 0.25 * np.cos(np.pi * np.arange(5) / 4)  # Chebyshev's points
    curve = np.polynomial.Polynomial.fit(u, [balanced(x) for x in u], 4)
    flat = curve.deriv().roots()
    flat = flat[np.isreal(flat)].real
    at = float(flat[np.abs(flat - displacement).argmin()])
    return at, float(curve(at))


neo_hookean = partial(_block, block.mooney_rivlin_of(0.0), (0.687365, 2 ** (1 / 3)))
mooney_rivlin = partial(_block, block.mooney_rivlin_of(0.2), (0.731118, 1.32077))
