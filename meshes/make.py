"""Writes the meshes of devices that no laminate describes: `python meshes/make.py`.

With Gmsh's Python interface. Any other program that writes Gmsh's format will do: the names of the
physical groups are what matters. Lengths are in mm, (x, y) = (R, Z) of the balloon and the cone.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from math import cos, hypot, pi, sin
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


def across(axis: int, at: float) -> list[int]:
    """Surfaces in a plane across an axis."""
    low, high = [-1e3] * 3, [1e3] * 3
    low[axis], high[axis] = at - 1e-6, at + 1e-6
    return [tag for _, tag in gmsh.model.getEntitiesInBoundingBox(*low, *high, 2)]


def layer(low: list[int], thickness: float) -> tuple[list[int], list[int]]:
    """Draw a layer of one hexahedron's thickness on surfaces: those above them, and volumes."""
    for surface in low:
        gmsh.model.geo.mesh.setRecombine(2, surface)
    pairs = [(2, surface) for surface in low]
    found = gmsh.model.geo.extrude(pairs, 0, 0, thickness, [1], recombine=True)
    # of each surface that is drawn up comes first the one above, then the volume
    above = [tag for (_, tag), (dim, _) in pairwise(found) if dim == 3]
    return above, [tag for dim, tag in found if dim == 3]


def finish(volumes: list[int], faces: dict[str, list[int]]) -> None:
    """Name the faces and the film, and mesh them in second order."""
    for name, tags in faces.items():
        gmsh.model.addPhysicalGroup(2, tags, name=name)
    gmsh.model.addPhysicalGroup(3, volumes, name="film")
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)


def two_layers(low: list[int], held: int) -> None:
    """Draw two layers of 0.5 mm on surfaces at Z = -0.5 mm, name their faces, and mesh them.

    Args:
        low: The surfaces.
        held: Where the first of them is held: 0 below, 1 between the layers.
    """
    middle, below = layer(low, 0.5)
    top, above = layer(middle, 0.5)
    gmsh.model.geo.synchronize()
    faces = {"held": (low, middle)[held][:1], "middle": middle, "top": top}
    finish(below + above, faces | {"x0": across(0, 0), "y0": across(1, 0)})


def gripper(size: float = 4.0) -> None:
    """A quarter of a gripper with four arms of 50 mm, of two layers of 0.5 mm each.

    Second-order hexahedra on quadrilaterals, one through each layer.

    Args:
        size: Of the quadrilaterals.
    """
    geo = gmsh.model.geo
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # quadrilaterals alone
    places = ((0, 0), (10, 0), (10, 10), (0, 10), (50, 0), (0, 50), (50, 5), (5, 50))
    o, a, c, b, tip, top, near_tip, near_top = (geo.addPoint(*xy, -0.5, size) for xy in places)
    oa, ac, bc, ob = (geo.addLine(*ends) for ends in ((o, a), (a, c), (b, c), (o, b)))
    along_x, along_y = geo.addLine(a, tip), geo.addLine(b, top)
    edge_x = geo.addBezier([c, c, near_tip, tip, tip])
    edge_y = geo.addBezier([top, top, top, near_top, c, c])
    loops = ([oa, ac, -bc, -ob], [along_x, -edge_x, -ac], [bc, -edge_y, -along_y])
    low = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    two_layers(low, 0)


def gripper_six(size: float = 8.0, pin: float = 0.5) -> None:
    """A quarter of a gripper with six arms of 50 mm, of two layers of 0.5 mm each.

    Second-order hexahedra on quadrilaterals, one through each layer. It is held at its centre, on a
    small square of the middle plane.

    Args:
        size: Of the quadrilaterals.
        pin: Side of the square, in this quarter.
    """
    geo = gmsh.model.geo
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # quadrilaterals alone

    def point(x: float, y: float) -> int:
        return geo.addPoint(x, y, -0.5, size)

    def arm(*corners: tuple[float, float]) -> list[int]:
        """Places along the parabola from the first to the third, with tangents to the second."""
        (a, b, c), shares = corners, [k / 16 for k in range(1, 16)]
        places = (
            [(1 - t) ** 2 * a[k] + 2 * t * (1 - t) * b[k] + t**2 * c[k] for k in (0, 1)]
            for t in shares
        )
        return [point(*xy) for xy in places]

    valley, tip, inner, top = (18.45, 0.0), (43.3, 25.0), (9.22, 15.97), (0.0, 50.0)
    ends = [point(*xy) for xy in (valley, tip, inner, top)]
    sides = ((valley, (45.58, 20.54), tip), (tip, (40.58, 29.21), inner), (inner, (5, 49.74), top))
    curves = [geo.addSpline([ends[k], *arm(*side), ends[k + 1]]) for k, side in enumerate(sides)]
    corners = [geo.addPoint(x, y, -0.5, pin) for x, y in ((0, 0), (pin, 0), (pin, pin), (0, pin))]
    square = [geo.addLine(*pair) for pair in pairwise([*corners, corners[0]])]
    along_x, along_y = geo.addLine(corners[1], ends[0]), geo.addLine(ends[3], corners[3])
    loops = (square, [along_x, *curves, along_y, -square[2], -square[1]])
    two_layers([geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops], 1)


def blister(size: float = 12.0) -> None:
    """A quarter of a square film of 150 mm, 0.612 mm thick, with a round electrode of 90 mm on top.

    Second-order hexahedra on quadrilaterals, one through the film.

    Args:
        size: Of the quadrilaterals.
    """
    geo = gmsh.model.geo
    gmsh.option.setNumber("Mesh.RecombinationAlgorithm", 3)  # quadrilaterals alone
    places = ((0, 0), (45, 0), (75, 0), (75, 75), (0, 75), (0, 45))
    o, *outer = (geo.addPoint(*xy, 0, size) for xy in places)
    rim = geo.addCircleArc(outer[0], o, outer[-1])
    lines = [geo.addLine(*ends) for ends in pairwise([o, *outer, o])]
    loops = ([lines[0], rim, lines[5]], [*lines[1:5], -rim])
    low = [geo.addPlaneSurface([geo.addCurveLoop(loop)]) for loop in loops]
    above, volumes = layer(low, 0.612)
    geo.synchronize()
    finish(volumes, {
        "bottom": low, "electrode": above[:1],
        "x0": across(0, 0), "y0": across(1, 0), "held": across(0, 75) + across(1, 75),
    })  # fmt: skip


def roll_up(angle: float, rise: float = 0.0) -> None:
    """Move a box's nodes (radius, part of the angle, height) to a cylinder or a helix.

    Args:
        angle: For a second coordinate of 1.
        rise: The same.
    """
    tags, places, _ = gmsh.model.mesh.getNodes()
    for tag, (r, part, z) in zip(tags, places.reshape(-1, 3), strict=True):
        t = angle * part
        gmsh.model.mesh.setNode(tag, [r * cos(t), r * sin(t), z + rise * part], [])


def cylinder(around: int = 8, along: int = 16) -> None:
    """A quarter of a cylinder 100 mm long between the radii 19.75 and 20.25 mm.

    Second-order hexahedra, a box whose nodes are moved to where they belong. At Y = 0 the innermost
    tenth of the wall is a cell of its own, on which the cylinder can be hinged.

    Args:
        around: Cells in the quarter.
        along: Cells over its length.
    """
    geo = gmsh.model.geo
    ends = [geo.addPoint(r, 0, 0) for r in (19.75, 19.8, 20.25)]
    lines = [geo.addLine(*pair) for pair in pairwise(ends)]
    for line in lines:
        geo.mesh.setTransfiniteCurve(line, 2)
    walls = geo.extrude([(1, k) for k in lines], 0, 0, 100, [along], recombine=True)
    inner, outer = walls[1][1], walls[5][1]
    found = geo.extrude([(2, inner), (2, outer)], 0, 1, 0, [around], recombine=True)
    geo.synchronize()
    faces = {
        "hinge": [inner], "x0": [found[0][1], found[6][1]], "base": across(2, 0),
        "inside": across(0, 19.75), "outside": across(0, 20.25),
    }  # fmt: skip
    finish([found[1][1], found[7][1]], faces)
    roll_up(pi / 2)


def helix(turns: int = 3, sectors: int = 24, across: int = 4) -> None:
    """A strip 5 mm high between the radii 4.9 and 5.1 mm, wound up with a pitch of 10 mm.

    Second-order hexahedra, one through the wall: a box whose nodes are moved to where they belong.

    Args:
        turns: How often it goes around.
        sectors: Cells in a turn.
        across: Cells over its height.
    """
    geo = gmsh.model.geo
    line = geo.addLine(*(geo.addPoint(r, 0, 0) for r in (4.9, 5.1)))
    geo.mesh.setTransfiniteCurve(line, 2)
    base = geo.extrude([(1, line)], 0, 0, 5, [across], recombine=True)[1][1]
    _, volume, _, outside, _, inside = geo.extrude(
        [(2, base)], 0, turns, 0, [turns * sectors], recombine=True
    )
    geo.synchronize()
    finish([volume[1]], {"base": [base], "outside": [outside[1]], "inside": [inside[1]]})
    roll_up(2 * pi, 10)


def fold(cells: tuple[int, int, int, int] = (2, 12, 5, 3)) -> None:
    """Half of a film of 50 um on a frame of 0.2 mm, 30 mm long and 20 mm wide, with a window.

    Second-order hexahedra, one through each of them. The window reaches over 20 mm x 12 mm.

    Args:
        cells: Along an end of the frame and along the window, across half the window and its side.
    """
    geo = gmsh.model.geo
    x, y = (0.0, 5.0, 25.0, 30.0), (0.0, 6.0, 10.0)
    counts = {0: (cells[0], cells[1], cells[0]), 1: cells[2:]}
    at = {(i, j): geo.addPoint(a, b, 0) for i, a in enumerate(x) for j, b in enumerate(y)}
    lines: dict[tuple[tuple[int, int], tuple[int, int]], int] = {}
    for i, j in at:
        for axis, end in ((0, (i + 1, j)), (1, (i, j + 1))):
            if end in at:
                lines[(i, j), end] = line = geo.addLine(at[i, j], at[end])
                geo.mesh.setTransfiniteCurve(line, counts[axis][(i, j)[axis]] + 1)
    patches = {}
    for i, j in ((i, j) for i in range(3) for j in range(2)):
        a, b, c, d = (i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1)
        loop = geo.addCurveLoop([lines[a, b], lines[b, c], -lines[d, c], -lines[a, d]])
        patches[i, j] = geo.addPlaneSurface([loop])
        geo.mesh.setTransfiniteSurface(patches[i, j])
        geo.mesh.setRecombine(2, patches[i, j])
    groups: dict[tuple[int, str], list[int]] = {}
    for part, height in (("film", 0.05), ("frame", -0.2)):
        for patch, surface in patches.items():
            if (part, patch) == ("frame", (1, 0)):
                continue  # the window
            top, volume, *_ = geo.extrude([(2, surface)], 0, 0, height, [1], recombine=True)
            groups.setdefault((3, part), []).append(volume[1])
            names = {(1, 0): "above"} if part == "film" else {0: "base", 2: "tip"}
            name = names.get(patch if part == "film" else patch[0])
            if name is not None:
                groups.setdefault((2, name), []).append(top[1])
    groups[2, "below"] = [patches[1, 0]]
    geo.synchronize()
    inside = gmsh.model.getEntitiesInBoundingBox(-1, -1e-6, -1, 31, 1e-6, 1, 2)
    groups[2, "middle"] = [tag for _, tag in inside]
    for (dim, name), tags in groups.items():
        gmsh.model.addPhysicalGroup(dim, tags, name=name)
    gmsh.model.mesh.generate(3)
    gmsh.model.mesh.setOrder(2)


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
    write(here / "blister.msh", blister)
    write(here / "cone.msh", cone)
    write(here / "cylinder.msh", cylinder)
    write(here / "gripper.msh", gripper)
    write(here / "gripper_six.msh", gripper_six)
    write(here / "helix.msh", helix)
    write(here / "fold.msh", fold)
