"""Checks a mesh file against the annular strips of its config."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.device.grid import AIR_BOTTOM, AIR_END, AIR_START, AIR_TOP
from dealib.device.laminate import FRAME_BLOCK, MOUNT_BLOCK
from dealib.device.records import AIR
from dealib.device.shapes import AnnularStrips
from dealib.errors import ConfigError

_QUAD, _TRIANGLE = 3, 2  # Gmsh's element types
_TOLERANCE = 1e-6  # of the outer radius
_FILM, _TOP, _BOTTOM = "film", "top_electrode", "bottom_electrode"
_FACES = ("inner", "outer", "film_top", "film_bottom")

# optional region -> the key of `geometry` that asks for it
_SAID_BY = {
    _TOP: "electrode_thickness",
    _BOTTOM: "electrode_thickness",
    AIR: "air_height",
    MOUNT_BLOCK: "clamps",
    FRAME_BLOCK: "clamps",
}


def _expected(geometry: AnnularStrips) -> dict[str, int]:
    """Names that a mesh of this geometry must have, with their dimension."""
    regions, curves = [_FILM], [*_FACES]
    if geometry.electrode_thickness > 0:
        regions += [_TOP, _BOTTOM]
    if geometry.clamps is not None:
        regions += [MOUNT_BLOCK, FRAME_BLOCK]
    if geometry.air_height > 0:
        regions += [AIR]
        curves += [AIR_START, AIR_END, AIR_TOP, AIR_BOTTOM]
    return dict.fromkeys(regions, 2) | dict.fromkeys(curves, 1)


def check(model: Any, path: str, geometry: AnnularStrips) -> None:
    """Compare the open Gmsh model with a geometry: names, kinds of cells, extents of regions.

    Of the film both extents are compared, of electrodes and air that in Z only: the shapes of
    regions are free.

    Raises:
        ConfigError: If they differ.
    """
    for problem in _problems(model, geometry):
        raise ConfigError(f"{path}: {problem}")


def _problems(model: Any, geometry: AnnularStrips) -> Iterator[str]:
    groups = {model.getPhysicalName(d, t): d for d, t in model.getPhysicalGroups()}
    expected = _expected(geometry)
    missing = [n for n, d in expected.items() if groups.get(n) != d]
    if missing:
        yield (
            f"no physical group named {', '.join(missing)}; the geometry of the config asks for "
            f"them, the file has: {', '.join(sorted(groups)) or 'none'}"
        )
    for region in (n for n, d in groups.items() if d == 2 and n not in expected):
        if region in _SAID_BY:
            yield f"it has {region!r}, but geometry.{_SAID_BY[region]} says that there is none"
        yield f"it has a surface {region!r}; known are {', '.join((_FILM, *_SAID_BY))}"
    kinds = set(map(int, model.mesh.getElements(2)[0]))
    if kinds not in ({_QUAD}, {_TRIANGLE}):
        yield "all cells must be 4-node quadrilaterals, or all 3-node triangles"
    boxes = _boxes(model)
    yield from _film(boxes[_FILM], geometry)
    for region, key, axis, end, wanted in _sides(geometry):
        got = boxes[region][end, "RZ".index(axis)]
        if abs(got - wanted) > _TOLERANCE * geometry.outer_radius:
            yield (
                f"{region} ends at {axis} = {got:g} mm, but geometry.{key} of the config says "
                f"{axis} = {wanted:g} mm"
            )


def _boxes(model: Any) -> dict[str, Array]:
    """Smallest and largest (R, Z) of each named surface, mm."""
    found = {}
    for _, tag in model.getPhysicalGroups(2):
        nodes = model.mesh.getNodesForPhysicalGroup(2, tag)[1].reshape(-1, 3)[:, :2]
        found[model.getPhysicalName(2, tag)] = np.array([nodes.min(axis=0), nodes.max(axis=0)])
    return found


def _film(got: Array, g: AnnularStrips) -> Iterator[str]:
    half = g.film_thickness / 2
    wanted = np.array([[g.inner_radius, -half], [g.outer_radius, half]])
    if np.abs(got - wanted).max() > _TOLERANCE * g.outer_radius:
        yield (
            f"the film spans R = {got[0, 0]:g}..{got[1, 0]:g}, "
            f"Z = {got[0, 1]:g}..{got[1, 1]:g} mm, but the geometry of the config says "
            f"R = {wanted[0, 0]:g}..{wanted[1, 0]:g}, Z = {wanted[0, 1]:g}..{wanted[1, 1]:g} mm"
        )


def _sides(g: AnnularStrips) -> Iterator[tuple[str, str, str, int, float]]:
    """Region, key, axis, lower (0) or upper (1) end, and where it must be."""
    if g.electrode_thickness > 0:
        reach = g.film_thickness / 2 + g.electrode_thickness
        yield _TOP, "electrode_thickness", "Z", 1, reach
        yield _BOTTOM, "electrode_thickness", "Z", 0, -reach
    if g.clamps is not None:
        for region in (MOUNT_BLOCK, FRAME_BLOCK):
            yield region, "clamps.height", "Z", 0, -g.clamps.height
            yield region, "clamps.height", "Z", 1, g.clamps.height
        yield MOUNT_BLOCK, "clamps.width", "R", 0, g.inner_radius - g.clamps.width
        yield FRAME_BLOCK, "clamps.width", "R", 1, g.outer_radius + g.clamps.width
    if g.air_height > 0:
        yield AIR, "air_height", "Z", 0, -g.air_height
        yield AIR, "air_height", "Z", 1, g.air_height
