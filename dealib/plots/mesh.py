"""A picture of a Gmsh mesh: the whole, and both ends of the strips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

COLOURS = {
    "film": "#f2c14e",
    "top_electrode": "#4a4e69",
    "bottom_electrode": "#4a4e69",
    "air": "none",
    "mount_block": "#b7c4a1",
    "frame_block": "#b7c4a1",
}


def draw_mesh(mesh: Path) -> Any:
    """Draw a mesh file with named regions; returns the figure."""
    polygons = _polygons(mesh)
    film = np.concatenate(polygons["film"])
    (left, low), (right, high) = film.min(axis=0), film.max(axis=0)
    near, ink = 4 * (high - low), plt.rcParams["axes.edgecolor"]
    figure, axes = plt.subplots(1, 3, figsize=(15, 6), layout="constrained")
    for axis, title in zip(axes, ("whole", "inner end", "outer end"), strict=True):
        for region, faces in polygons.items():
            colour = COLOURS.get(region, "#cccccc")
            axis.add_collection(PolyCollection(list(faces), fc=colour, ec=ink, lw=0.25))
        axis.set(xlabel="R (mm)", ylabel="Z (mm)", title=title)
        axis.set_aspect("equal", adjustable="datalim" if title == "whole" else "box")
    axes[0].autoscale_view()
    axes[1].set(xlim=(left - near / 3, left + near), ylim=(-near * 0.67, near * 0.67))
    axes[2].set(xlim=(right - near, right + near / 3), ylim=(-near * 0.67, near * 0.67))
    patches = [Patch(fc=COLOURS.get(r, "#cccccc"), ec=ink, label=r) for r in polygons]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), frameon=False)
    return figure


def _polygons(mesh: Path) -> dict[str, np.ndarray]:
    """Corner coordinates of the cells of each region."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(mesh))
        tags, xyz, _ = gmsh.model.mesh.getNodes()
        where = np.zeros(int(tags.max()) + 1, dtype=int)
        where[tags] = np.arange(len(tags))
        points = xyz.reshape(-1, 3)[:, :2]
        found = {}
        for _, group in gmsh.model.getPhysicalGroups(2):
            faces = []
            for surface in gmsh.model.getEntitiesForPhysicalGroup(2, group):
                kinds, _, nodes = gmsh.model.mesh.getElements(2, surface)
                for kind, n in zip(kinds, nodes, strict=True):
                    faces.append(points[where[n.reshape(-1, {2: 3, 3: 4}[int(kind)])]])
            found[gmsh.model.getPhysicalName(2, group)] = np.concatenate(faces)
        return found
    finally:
        gmsh.finalize()
