"""The strip of configs/benchmark_strip.yaml as a program for NGSolve, to compare speed and results.

    python3 -m venv /tmp/ngsolve && /tmp/ngsolve/bin/pip install ngsolve
    /tmp/ngsolve/bin/python tests/benchmarks/ngsolve_strip.py [--interpreted] [--plain]

It has the same cells, unknowns, energies and steps as the config. It is written as an expert would:
invariants in closed form, the boundary's motion in the first correction, linear extrapolation
(unless `--plain`), LDL^T with one symbolic factorisation, and compiled expressions (unless
`--interpreted`). It prints forces, energies and the processor time of all steps.
"""

from __future__ import annotations

import sys
import time
from typing import Any

import netgen.meshing as netgen  # type: ignore[import-not-found]
import ngsolve as ng  # type: ignore[import-not-found]
import numpy as np

COLUMNS, LAYERS = 60, (("bottom", 0.010, 1), ("film", 0.030, 4), ("top", 0.010, 1))  # mm, rows
INNER, OUTER = 8.35, 12.35  # mm
STRETCH, ACROSS = 1.15, 0.763493968700381  # pre-stretch, and across the film at zero stress
VOLUME = STRETCH**2 * ACROSS
PERMITTIVITY = 3.0 * 8.8541878128e-6  # N/kV^2
SHEAR, BULK = (
    {"film": 0.334, "top": 1.0, "bottom": 1.0},
    {"film": 16.67, "top": 50.0, "bottom": 50.0},
)
STEPS = [
    (0.0, 0.0),
    *((-0.25 * k, 0.0) for k in range(1, 13)),
    *((-3.0, 0.5 * k) for k in range(1, 6)),
]
STARTS = (0, 1, 2, 13, 14)  # steps without two states of the same stage before
ENDS = ("inner", "outer", "low", "high", "inner electrode", "outer electrode")


def strip() -> Any:
    """The mesh: quadrilaterals, graded along the strip."""
    mesh = netgen.Mesh(dim=2)
    s = np.linspace(0, 1, COLUMNS + 1)
    r = INNER + (OUTER - INNER) * (1 + np.tanh(4 * (s - 0.5)) / np.tanh(2.0)) / 2
    z, of = [0.0], []
    for k, (_, height, rows) in enumerate(LAYERS, start=1):
        z += [z[-1] + height * (row + 1) / rows for row in range(rows)]
        of += [k] * rows
    p = [[mesh.Add(netgen.MeshPoint(netgen.Pnt(a, b, 0))) for b in z] for a in r]
    for name, *_ in LAYERS:
        mesh.AddRegion(name, dim=2)
    for i in range(COLUMNS):
        for j, layer in enumerate(of):
            mesh.Add(netgen.Element2D(layer, [p[i][j], p[i + 1][j], p[i + 1][j + 1], p[i][j + 1]]))
        for j, index in ((1, 3), (5, 4)):
            mesh.Add(netgen.Element1D([p[i][j], p[i + 1][j]], index=index))
    for j, layer in enumerate(of):
        for column, index in ((p[0], 1), (p[-1], 2)):
            of_film = layer == 2
            mesh.Add(netgen.Element1D([column[j], column[j + 1]], index=index + 4 * (not of_film)))
    for k, name in enumerate(ENDS):
        mesh.SetBCName(k, name)
    return ng.Mesh(mesh)


def energy(name: str, u: Any, phi: Any, compiled: bool) -> Any:
    """Energy per area of the half section."""
    g = ng.grad(u)
    a, b, c, d, h = 1 + g[0, 0], g[0, 1], g[1, 0], 1 + g[1, 1], 1 + u[0] / ng.x
    J = h * (a * d - b * c)
    along, across, volume = (STRETCH**2, ACROSS**2, VOLUME) if name == "film" else (1.0, 1.0, 1.0)
    trace = along * (a * a + c * c + h * h) + across * (b * b + d * d)
    total = volume * J
    W = SHEAR[name] / 2 * (total ** (-2 / 3) * trace - 3) + BULK[name] / 2 * (total - 1) * (
        total - 1
    )
    W = W / volume
    if name == "film":
        E = ng.grad(phi)
        x, y = d * E[0] - c * E[1], a * E[1] - b * E[0]
        W = W - PERMITTIVITY / 2 * h * h * (x * x + y * y) / J
    density = 2 * ng.pi * ng.x * W
    return density.Compile() if compiled else density


def main() -> None:
    """Solve all steps."""
    mesh = strip()
    ends = "inner|outer|inner electrode|outer electrode"
    displacements = ng.VectorH1(mesh, order=2, dirichlet=ends)
    held = "low|high|inner electrode|outer electrode"
    potentials = ng.H1(mesh, order=2, definedon=mesh.Materials("film"), dirichlet=held)
    space = displacements * potentials
    u, phi = space.TrialFunction()
    form = ng.BilinearForm(space, symmetric=True)
    for name, *_ in LAYERS:
        of_layer = energy(name, u, phi, "--interpreted" not in sys.argv)
        form += ng.Variation(of_layer * ng.dx(name))
    state, unit = ng.GridFunction(space), ng.GridFunction(space)
    mount, high = mesh.Boundaries("inner|inner electrode"), mesh.Boundaries("high")
    unit.components[0].Set(ng.CoefficientFunction((0, 1)), definedon=mount)
    residual, step, moved = (state.vec.CreateVector() for _ in range(3))
    fixed = np.array([not free for free in space.FreeDofs()])
    values, inverse, old, iterations = state.vec.FV().NumPy(), None, None, 0
    begin = time.process_time()
    for number, (displacement, voltage) in enumerate(STEPS):
        now = values.copy()
        state.components[0].Set(ng.CoefficientFunction((0, displacement)), definedon=mount)
        state.components[1].Set(ng.CoefficientFunction(voltage), definedon=high)
        moves = "--plain" in sys.argv or number in STARTS
        moved.FV().NumPy()[:] = np.where(fixed, values - now, 0.0) if moves else 0.0
        values[:] = now if moves else 2 * now - old
        old, size = now, 1.0
        while size > 1e-9:
            form.AssembleLinearization(state.vec)
            form.Apply(state.vec, residual)
            if moves:  # the first correction takes the boundary along
                residual.data += form.mat * moved
            if inverse is None:
                inverse = form.mat.Inverse(space.FreeDofs(), inverse="sparsecholesky")
            else:
                inverse.Update()
            step.data = inverse * residual
            state.vec.data -= step
            size = 1.0 if moves else abs(ng.InnerProduct(residual, step)) ** 0.5
            if moves:
                state.vec.data += moved
            moves, iterations = False, iterations + 1
        form.Apply(state.vec, residual)
        force = ng.InnerProduct(residual, unit.vec)
        potential = form.Energy(state.vec)
        print(f"{displacement:6.2f} mm {voltage:4.1f} kV {force:.12f} N {potential:.12f} mJ")
    seconds = time.process_time() - begin
    print(f"{sum(space.FreeDofs())} unknowns, {iterations} iterations, {seconds:.2f} s")


if __name__ == "__main__":
    ng.SetNumThreads(1)
    main()
