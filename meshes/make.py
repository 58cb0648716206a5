"""Writes balloon.msh and cone.msh, with Gmsh's Python interface: `python meshes/make.py`.

Any other program that writes Gmsh's format will do: the names of the physical groups are what
matters. Lengths are in mm, (x, y) = (R, Z).
"""

from __future__ import annotations

from collections.abc import Callable
from math import hypot
from pathlib import Path
from typing import Any

import gmsh

Corners = dict[str, tuple[float, float]]


def shell(
    corners: Corners,
    names: dict[str, str],
    cells: tuple[int, int],
    ends: float = 1.0,
    centre: bool = False,
) -> None:
    """Draw four corners a, b (inner face), c, d (outer face) and mesh the wall between them.

    Args:
        corners: Places of a, b, c and d, in turn.
        names: Names of the sides 'ab', 'bc', 'cd' and 'da', and of the 'wall'.
        cells: Along the wall and across it.
        ends: Size of the cells at the wall's ends, over that in its middle.
        centre: Whether the faces are arcs about the origin, instead of straight.
    """
    geo = gmsh.model.geo
    at = {k: geo.addPoint(R, Z, 0) for k, (R, Z) in corners.items()}
    origin = geo.addPoint(0, 0, 0) if centre else 0
    sides = {}
    for side, count in zip(("ab", "bc", "cd", "da"), (*cells, *cells), strict=True):
        first, last = at[side[0]], at[side[1]]
        curved = centre and side in ("ab", "cd")
        line = geo.addCircleArc(first, origin, last) if curved else geo.addLine(first, last)
        graded = ends if side in ("ab", "cd") else 1.0
        geo.mesh.setTransfiniteCurve(line, count + 1, "Bump", graded)
        sides[side] = line
    surface = geo.addPlaneSurface([geo.addCurveLoop(list(sides.values()))])
    geo.mesh.setTransfiniteSurface(surface)
    geo.mesh.setRecombine(2, surface)
    geo.synchronize()
    for side, line in sides.items():
        gmsh.model.addPhysicalGroup(1, [line], name=names[side])
    gmsh.model.addPhysicalGroup(2, [surface], name=names["wall"])
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(2)


def balloon(radius: float = 10.0, thickness: float = 2.0, scale: int = 1) -> None:
    """The upper half of a spherical shell."""
    a, b = radius, radius + thickness
    corners = {"a": (a, 0.0), "b": (0.0, a), "c": (0.0, b), "d": (b, 0.0)}
    names = {"ab": "inside", "bc": "axis", "cd": "outside", "da": "equator", "wall": "wall"}
    shell(corners, names, (16 * scale, 4 * scale), centre=True)


def cone(thickness: float = 0.05, scale: int = 1) -> None:
    """A film that was moulded as a cone: radius 15 mm at Z = 0, 5 mm at the top, 6 mm high."""
    low, high = (15.0, 0.0), (5.0, 6.0)
    length = hypot(high[0] - low[0], high[1] - low[1])
    # half the thickness, across the generator and outwards
    R, Z = (
        (high[1] - low[1]) / length * thickness / 2,
        (low[0] - high[0]) / length * thickness / 2,
    )
    corners = {
        "a": (low[0] - R, low[1] - Z), "b": (high[0] - R, high[1] - Z),
        "c": (high[0] + R, high[1] + Z), "d": (low[0] + R, low[1] + Z),
    }  # fmt: skip
    names = {"ab": "below", "bc": "top", "cd": "above", "da": "rim", "wall": "film"}
    shell(corners, names, (60 * scale, 2), ends=0.05)


def write(path: Path, draw: Callable[[], Any]) -> Path:
    """Write the mesh that a function draws."""
    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        draw()
        gmsh.write(str(path))
    finally:
        gmsh.finalize()
    return path


if __name__ == "__main__":
    here = Path(__file__).parent
    write(here / "balloon.msh", balloon)
    write(here / "cone.msh", cone)
