"""A picture of a Gmsh mesh: the whole, and each end of a laminate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.patches import Patch

from dealib.arrays import Array
from dealib.device import msh
from dealib.device.laminate import JOIN, Laminate
from dealib.errors import ConfigError
from dealib.plots.labels import plain

if TYPE_CHECKING:
    from dealib.config.schema import Config

_FILM, _CONDUCTOR, _BLOCK, _AIR = "#f2c14e", "#4a4e69", "#b7c4a1", "none"
_FACES = {
    4: ((0, 1, 2), (0, 1, 3), (1, 2, 3), (0, 2, 3)),
    8: ((0, 1, 2, 3), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)),
}  # of tetrahedra and hexahedra

Parts = Mapping[str, list[Array]]


def draw_mesh(path: Path, config: Config | None = None) -> Any:
    """Draw a mesh file with named regions; returns the figure.

    Args:
        path: The file.
        config: Config of the device; it determines the colours of the regions.

    Raises:
        ConfigError: If the file is damaged, or has no named regions.
    """
    mesh = msh.read(path)
    dim, parts = next(((d, c) for d in (3, 2, 1) if (c := mesh.cells(d))), (0, {}))
    if not parts:
        raise ConfigError(f"{path}: none of its cells has a name; name regions as physical groups")
    colours = {name: _role(name, config) for name in parts}
    if dim == 3:
        return _solid(parts, colours)
    if config is None:
        return _plane(parts, colours, ("R", "Z"), None)
    axes, laminate = config.device.kinematics.axes, config.device.laminate
    return _plane(parts, colours, axes[:2], laminate if dim == len(axes) == 2 else None)


def _role(name: str, config: Config | None) -> str:
    """Colour of a part of the mesh, by the regions in it."""
    found: list[str] = []
    if config is None:
        return _BLOCK
    for region in config.device.regions:
        if region.name in name.split(JOIN):
            if region.material is None:
                found.append(_AIR if region.air else _BLOCK)
            else:
                found.append(_CONDUCTOR if config.conducts(region.material) else _FILM)
    return _FILM if _FILM in found else found[0] if found else _BLOCK


def _plane(
    parts: Parts, colours: dict[str, str], names: tuple[str, ...], laminate: Laminate | None
) -> Any:
    ends = {} if laminate is None else _ends(laminate, names)
    figure, axes = plt.subplots(
        1, 1 + len(ends), figsize=(9 + 3 * len(ends), 5), layout="constrained", squeeze=False
    )
    ink = plt.rcParams["axes.edgecolor"]
    for axis in axes[0]:
        for name, x in ((part, cells[..., :2]) for part in parts for cells in parts[part]):
            many: Any = PolyCollection(list(x), fc=colours[name], ec=ink, lw=0.25)
            if x.shape[1] == 2:
                many = LineCollection(list(x), colors=colours[name], lw=4)
                axis.plot(*x.reshape(-1, 2).T, "|", color=ink)
            axis.add_collection(many)
        axis.set(xlabel=f"{names[0]} (mm)", ylabel=f"{names[1]} (mm)", title="whole")
        axis.set_aspect("equal", adjustable="datalim")
    axes[0, 0].autoscale_view()
    for axis, (title, limits) in zip(axes[0, 1:], ends.items(), strict=True):
        axis.set_aspect("equal", adjustable="box")
        axis.set(xlim=limits[0], ylim=limits[1], title=plain(title))
    _legend(figure, parts, colours)
    return figure


def _ends(laminate: Laminate, names: tuple[str, ...]) -> dict[str, list[tuple[float, float]]]:
    """Titles and limits of pictures of the ends."""
    base, near = laminate.base, 4 * laminate.thickness
    along, found = names.index(base.along), {}
    for end, at, inwards in zip(base.ends, base.limits, (1, -1), strict=False):
        if end is not None:
            limits = [(0.0, 0.0)] * 2
            first, last = sorted((at - inwards * near / 3, at + inwards * near))
            limits[along] = (first, last)
            limits[1 - along] = (laminate.middle() - near * 0.67, laminate.middle() + near * 0.67)
            found[f"{end} end"] = limits
    return found


def _solid(parts: Parts, colours: dict[str, str]) -> Any:
    """The faces of all but air, seen from above."""
    from dealib.plots.render import check_rendering, draw_faces

    check_rendering()
    figure, axis = plt.subplots(figsize=(9, 6), layout="constrained")
    solids = {name: x for name, x in parts.items() if colours[name] != _AIR}
    faces = [(_outer(x), colours[name]) for name, cells in solids.items() for x in cells]
    axis.imshow(draw_faces(faces, plt.rcParams["axes.edgecolor"], plt.rcParams["axes.facecolor"]))
    axis.set_axis_off()
    _legend(figure, solids, colours)
    return figure


def _outer(cells: Array) -> Array:
    """Faces (faces, corners, 3) of cells (cells, corners, 3) that belong to one of them only."""
    pattern = np.array(_FACES[cells.shape[1]])
    faces = cells[:, pattern].reshape(-1, pattern.shape[1], 3)
    middles = np.round(faces.mean(axis=1), 7)
    _, first, count = np.unique(middles, axis=0, return_index=True, return_counts=True)
    return np.asarray(faces[first[count == 1]])


def _legend(figure: Any, parts: Parts, colours: dict[str, str]) -> None:
    ink = plt.rcParams["axes.edgecolor"]
    named = {name: ", ".join(n for n in name.split(JOIN) if "." not in n) or name for name in parts}
    patches = [Patch(fc=colours[k], ec=ink, label=plain(name)) for k, name in named.items()]
    figure.legend(handles=patches, loc="outside lower center", ncols=min(len(patches), 6))
