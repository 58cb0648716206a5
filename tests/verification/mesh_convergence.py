"""Mesh convergence as in the thesis, Figs. 12 and 13: global and local, uniform and graded.

The strips of deap100 carry their pre-load at 0 V; cells along them vary. The end displacement is
the global measure; the local one is the radial Cauchy stress at points 1 to 3. Fig. 11, which shows
where these are, is not in the thesis's text: here they are the inner end, the centre and the outer
end of the film's middle plane, away from the singular corners of the clamped ends.

Errors count from a graded mesh of 240 columns; rates are slopes of log error over log elements.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

import dealib
from dealib.fem.layout import Layout
from dealib.results.fields import fields
from verification.bench import Bench
from verification.table import Row

CONFIG = Path(__file__).parents[2] / "configs" / "deap100.yaml"
FORCE, ROWS = -0.30, 6  # N; cells across film (4) and electrodes (1 each)
COLUMNS, REFERENCE = (8, 16, 30, 60, 90, 120, 180), 240
QUANTITIES = ("displacement", "stress at point 1", "stress at point 2", "stress at point 3")


@dataclass(frozen=True)
class Solved:
    """One mesh: end displacement (mm), stress at points 1 to 3 (MPa), processor time (s)."""

    elements: int
    values: tuple[float, ...]
    seconds: float


@cache
def solve(grading: str, columns: int) -> Solved:
    """Pre-load the strips on one mesh."""
    changes = {"geometry.air_height": "0 mm", "mesh.grading": grading, "mesh.columns": columns}
    config = dealib.load(CONFIG, set=changes).config
    start = time.process_time()
    bench = Bench(config).load(steps=5, mount=FORCE)
    seconds = time.process_time() - start
    layout = Layout.of(bench.problem)
    mesh, state = layout.mesh, layout.gather()
    assert mesh is not None
    assert state is not None
    stress = fields(config, mesh, state)["cauchy_stress"][:, 0, 0]
    film = np.unique(mesh.cells[mesh.in_region("film")])
    g = config.geometry
    radii = (g.inner_radius, (g.inner_radius + g.outer_radius) / 2, g.outer_radius)
    distance = [np.hypot(*(mesh.points[film] - (R, 0)).T) for R in radii]
    assert max(d.min() for d in distance) < 1e-9, "there is no node at a point"
    at_points = (float(stress[film[d.argmin()]]) for d in distance)
    return Solved(ROWS * columns, (bench.displacement, *at_points), seconds)


def errors(grading: str) -> tuple[np.ndarray, np.ndarray]:
    """Elements, and relative errors of the quantities (meshes, 4)."""
    reference = np.array(solve("ends", REFERENCE).values)
    meshes = [solve(grading, n) for n in COLUMNS]
    found = np.array([m.values for m in meshes])
    return np.array([m.elements for m in meshes]), np.abs(found / reference - 1)


def rates(grading: str) -> list[float]:
    """Order of each quantity in the number of elements, fitted from 30 columns on."""
    elements, found = errors(grading)
    used = elements >= ROWS * 30
    return [float(-np.polyfit(np.log(elements[used]), np.log(e[used]), 1)[0]) for e in found.T]


def rows() -> Iterator[Row]:
    """What the shipped mesh, 60 graded columns, leaves as error."""
    case, source = "mesh, deap100 at -0.3 N, 60 graded columns", f"{REFERENCE} graded columns"
    reference, shipped = solve("ends", REFERENCE), solve("ends", 60)
    for name, wanted, value in zip(QUANTITIES, reference.values, shipped.values, strict=True):
        unit = "mm" if name == "displacement" else "MPa"
        yield Row(case, f"{name}, {unit}", wanted, value, 1e-3, source)


def study(picture: Path) -> str:
    """Draw the convergence; returns the numbers as a table in Markdown."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 3, figsize=(15, 8), layout="constrained", sharey="col")
    lines = ["| mesh | elements | u (mm) | S1 | S2 | S3 (MPa) | time (s) |", "|---|" + "--:|" * 6]
    for row, (grading, title) in enumerate((("uniform", "uniform"), ("ends", "graded"))):
        meshes = [solve(grading, n) for n in COLUMNS]
        elements, found = errors(grading)
        values = np.array([m.values for m in meshes])
        left, middle, right = axes[row]
        left.plot(elements, values[:, 0], "o-")
        left.set(ylabel="end displacement (mm)")
        clock = left.twinx()
        clock.plot(elements, [m.seconds for m in meshes], "s:", color="grey")
        clock.set(ylabel="processor time (s), dotted")
        middle.plot(elements, values[:, 1:], "o-", label=[f"point {k}" for k in (1, 2, 3)])
        middle.set(ylabel=r"$\sigma_{rr}$ (MPa)")
        middle.legend(loc="upper right")
        slopes = rates(grading)
        for name, error, slope in zip(QUANTITIES, found.T, slopes, strict=True):
            right.loglog(elements, error, "o-", label=f"{name}, rate {slope:.1f}")
        right.set(ylabel=f"error against {REFERENCE} graded columns")
        right.legend(fontsize=8, loc="lower left")
        for axis in (left, middle, right):
            axis.set(xlabel="elements", title=title)
            axis.grid(alpha=0.3)
        for m in meshes:
            numbers = " | ".join(f"{v:.6g}" for v in m.values)
            lines.append(f"| {title} | {m.elements} | {numbers} | {m.seconds:.2f} |")
        lines.append(f"| {title} | rate | {' | '.join(f'{s:.2f}' for s in slopes)} | |")
    m = solve("ends", REFERENCE)
    numbers = " | ".join(f"{v:.6g}" for v in m.values)
    lines.append(f"| graded | {m.elements} | {numbers} | {m.seconds:.2f} |")
    figure.savefig(picture, dpi=120)
    plt.close(figure)
    return "\n".join(lines)
