"""A picture of a Gmsh mesh: the whole, and both ends of the strips."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.patches import Patch

from dealib.errors import ConfigError
from dealib.geometry import msh
from dealib.plots.labels import plain

COLOURS = {
    "film": "#f2c14e",
    "top_electrode": "#4a4e69",
    "bottom_electrode": "#4a4e69",
    "air": "none",
    "mount_block": "#b7c4a1",
    "frame_block": "#b7c4a1",
}


def draw_mesh(mesh: Path) -> Any:
    """Draw a mesh file with named regions; returns the figure.

    Raises:
        ConfigError: If it is damaged.
    """
    polygons = msh.read(mesh).surfaces()
    if "film" not in polygons:
        raise ConfigError(f"{mesh}: no surface is named film")
    film = np.concatenate([faces.reshape(-1, 2) for faces in polygons["film"]])
    (left, low), (right, high) = film.min(axis=0), film.max(axis=0)
    near, ink = 4 * (high - low), plt.rcParams["axes.edgecolor"]
    figure, axes = plt.subplots(1, 3, figsize=(15, 6), layout="constrained")
    for axis, title in zip(axes, ("whole", "inner end", "outer end"), strict=True):
        for region, parts in polygons.items():
            colour = COLOURS.get(region, "#cccccc")
            for faces in parts:
                axis.add_collection(PolyCollection(list(faces), fc=colour, ec=ink, lw=0.25))
        axis.set(xlabel="R (mm)", ylabel="Z (mm)", title=title)
        axis.set_aspect("equal", adjustable="datalim" if title == "whole" else "box")
    axes[0].autoscale_view()
    axes[1].set(xlim=(left - near / 3, left + near), ylim=(-near * 0.67, near * 0.67))
    axes[2].set(xlim=(right - near, right + near / 3), ylim=(-near * 0.67, near * 0.67))
    patches = [Patch(fc=COLOURS.get(r, "#cccccc"), ec=ink, label=plain(r)) for r in polygons]
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), frameon=False)
    return figure
