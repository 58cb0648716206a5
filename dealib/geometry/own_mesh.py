"""Whether a mesh file is what the geometry of its config says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from dealib.config.schema import Geometry
from dealib.errors import ConfigError
from dealib.geometry import names

_QUAD, _TRIANGLE = 3, 2  # Gmsh's element types
_TOLERANCE = 1e-6  # of the outer radius

Box = npt.NDArray[np.float64]

# optional region -> the key that says whether there is one
_SAID_BY = {
    names.TOP_ELECTRODE: "electrode_thickness",
    names.BOTTOM_ELECTRODE: "electrode_thickness",
    names.AIR: "air_height",
    names.MOUNT_BLOCK: "clamps",
    names.FRAME_BLOCK: "clamps",
}


def check(model: Any, path: str, geometry: Geometry) -> None:
    """Compare the open Gmsh model with a geometry: names, kinds of cells, extents of regions.

    Only extents are compared, and of electrodes and air only how far they reach in Z, so that
    regions may have other shapes.

    Raises:
        ConfigError: If they differ.
    """
    for problem in _problems(model, geometry):
        raise ConfigError(f"mesh.file {path}: {problem}")


def _problems(model: Any, geometry: Geometry) -> Iterator[str]:
    groups = {model.getPhysicalName(d, t): d for d, t in model.getPhysicalGroups()}
    expected = names.expected(geometry)
    missing = [n for n, d in expected.items() if groups.get(n) != d]
    if missing:
        yield (
            f"no physical group named {', '.join(missing)}; the geometry of the config asks for "
            f"them, the file has: {', '.join(sorted(groups)) or 'none'}"
        )
    for region in (n for n, d in groups.items() if d == 2 and n not in expected):
        if region in _SAID_BY:
            yield f"it has {region!r}, but geometry.{_SAID_BY[region]} says that there is none"
        yield f"it has a surface {region!r}; known are {', '.join((names.FILM, *_SAID_BY))}"
    kinds = set(map(int, model.mesh.getElements(2)[0]))
    if kinds not in ({_QUAD}, {_TRIANGLE}):
        yield "all cells must be 4-node quadrilaterals, or all 3-node triangles"
    boxes = _boxes(model)
    yield from _film(boxes[names.FILM], geometry)
    for region, key, axis, end, wanted in _sides(geometry):
        got = boxes[region][end, "RZ".index(axis)]
        if abs(got - wanted) > _TOLERANCE * geometry.outer_radius:
            yield (
                f"{region} ends at {axis} = {got:g} mm, but geometry.{key} of the config says "
                f"{axis} = {wanted:g} mm"
            )


def _boxes(model: Any) -> dict[str, Box]:
    """Smallest and largest (R, Z) of each named surface, mm."""
    found = {}
    for _, tag in model.getPhysicalGroups(2):
        nodes = model.mesh.getNodesForPhysicalGroup(2, tag)[1].reshape(-1, 3)[:, :2]
        found[model.getPhysicalName(2, tag)] = np.array([nodes.min(axis=0), nodes.max(axis=0)])
    return found


def _film(got: Box, g: Geometry) -> Iterator[str]:
    half = g.film_thickness / 2
    wanted = np.array([[g.inner_radius, -half], [g.outer_radius, half]])
    if np.abs(got - wanted).max() > _TOLERANCE * g.outer_radius:
        yield (
            f"the film spans R = {got[0, 0]:g}..{got[1, 0]:g}, "
            f"Z = {got[0, 1]:g}..{got[1, 1]:g} mm, but the geometry of the config says "
            f"R = {wanted[0, 0]:g}..{wanted[1, 0]:g}, Z = {wanted[0, 1]:g}..{wanted[1, 1]:g} mm"
        )


def _sides(g: Geometry) -> Iterator[tuple[str, str, str, int, float]]:
    """Region, key, axis, lower (0) or upper (1) end, and where it must be."""
    if g.electrode_thickness > 0:
        yield names.TOP_ELECTRODE, "electrode_thickness", "Z", 1, g.half_thickness
        yield names.BOTTOM_ELECTRODE, "electrode_thickness", "Z", 0, -g.half_thickness
    if g.clamps is not None:
        for region in (names.MOUNT_BLOCK, names.FRAME_BLOCK):
            yield region, "clamps.height", "Z", 0, -g.clamps.height
            yield region, "clamps.height", "Z", 1, g.clamps.height
        yield names.MOUNT_BLOCK, "clamps.width", "R", 0, g.inner_radius - g.clamps.width
        yield names.FRAME_BLOCK, "clamps.width", "R", 1, g.outer_radius + g.clamps.width
    if g.air_height > 0:
        yield names.AIR, "air_height", "Z", 0, -g.air_height
        yield names.AIR, "air_height", "Z", 1, g.air_height
