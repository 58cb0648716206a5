"""The strip benchmark as a quarter in space and as a membrane, and a square film as both.

What counts is how cells lengthen from clamps and edges of electrodes, where the film's thickness
changes within a layer as wide as the film is thick. One cell through each layer leaves 0.06 % of
the force, two leave 0.05 %: the corners at clamps are singular. The benchmark's own mesh leaves
0.04 %. A membrane has no such layer: its error is linear in the thickness.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from laminates import config, layer, rows, simulation

import dealib
from verification.strips import states
from verification.table import Row

CONFIGS = Path(__file__).parents[2] / "configs"
QUANTITIES = (
    "force at -3 mm, 0 kV, N",
    "force at -3 mm, 2.5 kV, N",
    "capacitance at -3 mm, 2.5 kV, pF",
)
MESHES = {  # grading and cells through a layer; columns along the film, cells in the quarter's arc
    ("ends", 1): ((8, 4), (12, 4), (16, 4), (24, 4), (32, 8)),
    ("ends", 2): ((8, 4), (12, 4), (24, 4), (32, 8)),
    ("uniform", 1): ((12, 4), (24, 4), (40, 8), (60, 12)),
}
FILM = {
    **{"law": "neo_hookean", "shear_modulus": "0.334 MPa", "bulk_modulus": "16.67 MPa"},
    "relative_permittivity": 3.0,
}


@dataclass(frozen=True)
class Solved:
    """One mesh: the quantities, unknowns, and seconds of the whole solve without start-up."""

    values: tuple[float, ...]
    unknowns: int
    seconds: float


@cache
def strips(
    columns: int, sectors: int = 0, grading: str = "ends", through: int = 1, model: str = "solid"
) -> Solved:
    """The strip benchmark, with some cells through each of its layers.

    It has `sectors` cells in a quarter of three dimensions; 0 for its meridian.
    """
    layers = [("bottom", "electrode", 10), ("film", "film", 30), ("top", "electrode", 10)]
    space = {"space": "3d", "symmetry": ["X", "Y"]} if sectors else {}
    base = {"kind": "annulus", "inner_radius": "8.35 mm", "outer_radius": "12.35 mm"}
    given = config(
        "annulus",
        *(layer(name, f"{um} um", material=of) for name, of, um in layers),
        geometry={"base": base, **space},
        mesh={"columns": columns, "sectors": sectors or 2, "grading": grading}
        | {"film_rows": through, "electrode_rows": through},
        materials={
            "film": FILM | {"prestretch": 1.15},
            "electrode": {"law": "neo_hookean", "shear_modulus": "1 MPa", "bulk_modulus": "50 MPa"},
        },
        physics={"model": model},
        terminals={"hot": {"on": "top"}, "ground": {"on": "bottom", "ground": True}},
        program=[
            {"stage": "prestrain", "steps": 1},
            {"stage": "push", "mount": {"displacement": "-3 mm"}, "steps": 4},
            {"stage": "actuate", "terminal": {"voltage": "2.5 kV"}, "steps": 1},
        ],
    )
    shipped = dealib.load(CONFIGS / "benchmark_strip.yaml").config
    assert given.materials["film"] == shipped.materials["film"]  # the same device
    start = time.perf_counter()
    run = simulation(given)
    pushed, driven = [state.row for state in run][-2:]
    values = (pushed["force_N"], driven["force_N"], driven["capacitance_pF"])
    return Solved(values, run.unknowns, time.perf_counter() - start)


@cache
def square(model: str, columns: int, thickness: float = 10.0) -> float:
    """How far the edge of a square electrode moves (mm), at 60 V/um of the mounted film.

    Args:
        model: solid or membrane.
        columns: Cells along the film of 20 mm; its electrode has 8 mm.
        thickness: Mounted, um.
    """
    middle = thickness / 2000 if model == "solid" else 0.0
    area = {"X": ["-4 mm", "4 mm"], "Y": ["-4 mm", "4 mm"]}
    given = config(
        "strip",
        layer(thickness=f"{thickness} um"),
        geometry={
            "base": {"kind": "rectangle", "length": "20 mm", "width": "20 mm"},
            "space": "3d",
            "symmetry": ["X", "Y"],
        },
        mesh={"columns": columns, "sectors": columns // 2},
        materials={"film": FILM | {"prestretch": 2}},
        physics={"model": model},
        mounts={},
        holds=[{"on": ["left", "right", "front", "back"], "fix": ["X", "Y", "Z"]}],
        terminals={
            "hot": {"on": "film.top", "within": area},
            "ground": {"on": "film.bottom", "within": area, "ground": True},
        },
        probes={"edge": {"displacement": "X", "at": ["4 mm", "0 mm", f"{middle} mm"]}},
        program=[
            {"stage": "prestrain"},
            {"stage": "actuate", "terminal": {"voltage": f"{0.06 * thickness} kV"}},
        ],
    )
    return float(rows(given)[-1]["edge_mm"])


def quarter() -> Iterator[Row]:
    """The strips in space, with few unknowns, and as a membrane."""
    shipped = states("benchmark_strip", **{"materials.film.relative_permittivity": 3.0})
    solid, membrane = strips(12, 4), strips(12, model="membrane")
    for kind, found, force, capacitance in (
        ("a quarter in space", solid, 6e-4, 1e-4),
        ("a membrane", membrane, 6.5e-3, 5e-4),
    ):
        case = f"benchmark_strip as {kind}, {found.unknowns} unknowns"
        allowed = (force, force, capacitance)
        for name, value, most in zip(QUANTITIES, found.values, allowed, strict=True):
            yield Row(case, name, shipped[name], value, most, "configs/benchmark_strip.yaml")


def film() -> Iterator[Row]:
    """A square film, whose electrode pushes its passive part aside."""
    solid = square("solid", 24)
    case, source = "square film of 10 um as a membrane", "dealib, solid of 24 x 24 cells"
    yield Row(
        case, "motion of the electrode's edge, mm", solid, square("membrane", 24), 3e-3, source
    )


def study(picture: Path) -> str:
    """Draw the errors of the strips in space over unknowns; returns the numbers in Markdown."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    reference = np.array(strips(240, through=8).values)
    figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained", sharey=True)
    lines = ["| grading | cells | unknowns | F 0 kV, % | F 2.5 kV, % | C 2.5 kV, % | time, s |"]
    lines.append("|---|--:|--:|--:|--:|--:|--:|")
    for (grading, through), meshes in MESHES.items():
        label = f"{grading}, {through} through a layer"
        solved = [strips(*mesh, grading, through) for mesh in meshes]
        errors = np.array([100 * np.abs(np.array(s.values) / reference - 1) for s in solved])
        for axis, name, error in zip(axes, QUANTITIES, errors.T, strict=True):
            axis.loglog([s.unknowns for s in solved], error, "o-", label=label)
            axis.set(xlabel="unknowns", title=name.removesuffix(", N").removesuffix(", pF"))
            axis.grid(alpha=0.3)
        for mesh, one, error in zip(meshes, solved, errors, strict=True):
            numbers = " | ".join(f"{e:.4f}" for e in error)
            cells = f"{mesh[0]} x {mesh[1]} x {through}"
            lines.append(
                f"| {grading} | {cells} | {one.unknowns} | {numbers} | {one.seconds:.1f} |"
            )
    axes[0].set(ylabel="error, %")
    axes[0].legend()
    figure.savefig(picture, dpi=100)
    plt.close(figure)
    return "\n".join(lines)
