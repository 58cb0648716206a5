"""A soft dielectric sphere in a uniform electric field, in air.

Small strain, incompressible: the Maxwell traction is (cos theta)^2 times a constant, and

    u/R = (15/19) (eps0 E0^2 / mu) ((er - 1)/(er + 2))^2 at the pole, -1/2 of it at the equator.

The upper half of a sphere at the centre of a cylinder of air, ten times as large; the plane of
symmetry is ground, the cylinder's top is the terminal. The air's fictitious elasticity carries the
mesh around the sphere, and must not be felt.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from dealib.config.schema import Config
from dealib.units import EPSILON_0
from verification.bench import Bench
from verification.table import Row

RADIUS, BOX, MU, KAPPA = 1.0, 12.0, 0.1, 1e4  # mm, mm, MPa, kappa/mu
LOAD = 1e-4  # eps0 E0^2 / mu
SOURCE = "small-strain closed form"


def mesh(gmsh: Any, cells: int) -> None:
    """Quarter of a disc in a square, mapped, with `cells` along each half of the arc."""
    geo, r, core = gmsh.model.geo, RADIUS, 0.5 * RADIUS
    s = r / np.sqrt(2)
    spots = {
        "o": (0, 0), "a": (core, 0), "b": (0.9 * core, 0.9 * core), "c": (0, core),
        "d": (r, 0), "e": (s, s), "f": (0, r), "g": (BOX, 0), "h": (BOX, BOX), "i": (0, BOX),
    }  # fmt: skip
    at = {k: geo.addPoint(x, y, 0) for k, (x, y) in spots.items()}
    lines: dict[str, int] = {}
    for k in ("oa", "oc", "ab", "cb", "gh", "ih"):
        lines[k] = geo.addLine(at[k[0]], at[k[1]])
        geo.mesh.setTransfiniteCurve(lines[k], cells + 1)
    for k in ("de", "fe"):
        lines[k] = geo.addCircleArc(at[k[0]], at["o"], at[k[1]])
        geo.mesh.setTransfiniteCurve(lines[k], cells + 1)
    for k in ("ad", "be", "cf"):
        lines[k] = geo.addLine(at[k[0]], at[k[1]])
        geo.mesh.setTransfiniteCurve(lines[k], cells + 1)
    for k in ("dg", "eh", "fi"):  # cells grow away from the sphere
        lines[k] = geo.addLine(at[k[0]], at[k[1]])
        geo.mesh.setTransfiniteCurve(lines[k], 3 * cells + 1, "Progression", 1 + 1.0 / cells)
    patches = {
        "film": ("oa ab -cb -oc", "ad de -be -ab", "cb be -fe -cf"),
        "air": ("dg gh -eh -de", "fe eh -ih -fi"),
    }
    groups: dict[tuple[int, str], list[int]] = {
        (1, "axis"): [lines[k] for k in ("oc", "cf", "fi")],
        (1, "equator_plane"): [lines[k] for k in ("oa", "ad", "dg")],
        (1, "outer_air"): [lines["gh"]],
        (1, "top_air"): [lines["ih"]],
        (1, "surface"): [lines["de"], lines["fe"]],
    }
    for region, loops in patches.items():
        for text in loops:
            loop = [-lines[k[1:]] if k[0] == "-" else lines[k] for k in text.split()]
            surface = geo.addPlaneSurface([geo.addCurveLoop(loop)])
            geo.mesh.setTransfiniteSurface(surface)
            geo.mesh.setRecombine(2, surface)
            groups.setdefault((2, region), []).append(surface)
    geo.synchronize()
    for (dim, name), entities in groups.items():
        gmsh.model.addPhysicalGroup(dim, entities, name=name)
    gmsh.model.mesh.generate(2)


def write(file: Path, cells: int) -> None:
    """Write the mesh."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        mesh(gmsh, cells)
        gmsh.write(str(file))
    finally:
        gmsh.finalize()


def sphere(relative: float, air_stiffness: float, cells: int = 12) -> tuple[float, float]:
    """u/R at the pole and at the equator.

    Args:
        relative: Relative permittivity of the sphere.
        air_stiffness: Of the fictitious elasticity, MPa.
        cells: Fineness of the mesh.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "sphere.msh"
        write(file, cells)
        bench = Bench(
            Config.model_validate(
                {
                    "name": "sphere",
                    "geometry": {"shape": "mesh", "file": str(file), "space": "axisymmetric"},
                    "materials": {
                        "film": {
                            "law": "neo_hookean",
                            "shear_modulus": f"{MU} MPa",
                            "bulk_modulus": f"{KAPPA * MU} MPa",
                            "relative_permittivity": relative,
                        }
                    },
                    "terminals": {
                        "terminal": {"on": "top_air"},
                        "ground": {"on": "equator_plane", "ground": True},
                    },
                    "holds": [
                        {"on": "equator_plane", "fix": "Z"},
                        {"on": ["outer_air", "top_air"], "fix": ["R", "Z"]},
                    ],
                    "physics": {"air_stiffness": f"{air_stiffness} MPa"},
                    "solver": {"tolerance": 1e-13},
                    "program": [{"stage": "rest"}],
                }
            )
        )
    bench.move(terminal=BOX * float(np.sqrt(LOAD * MU / EPSILON_0)))
    pole, equator = bench.values("u_Z", "surface").max(), bench.values("u_R", "surface").min()
    return float(pole) / RADIUS, float(equator) / RADIUS


def rows() -> Iterator[Row]:
    """Pole and equator, and whether the fictitious stiffness is felt."""
    for relative in (3.0, 10.0):
        exact = 15 / 19 * LOAD * ((relative - 1) / (relative + 2)) ** 2
        case = f"sphere in air, er = {relative:g}, kappa/mu = {KAPPA:g}"
        pole, equator = sphere(relative, 1e-6)
        yield Row(case, "u/R at the pole", exact, pole, 0.01, SOURCE)
        yield Row(case, "u/R at the equator", -exact / 2, equator, 0.01, SOURCE)
    case = "sphere in air, er = 10, air stiffness from 1e-8 to 1e-5 MPa"
    for stiffness in (1e-8, 1e-7, 1e-5):
        computed = sphere(relative, stiffness)[0]
        text = f"u/R at the pole, {stiffness:g} MPa"
        yield Row(case, text, pole, computed, 1e-4, "itself at 1e-6 MPa")
