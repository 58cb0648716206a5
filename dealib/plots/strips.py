"""Fields and shapes of the strips: straightened, and true to scale at both ends."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.tri import Triangulation

from dealib.plots.labels import plain
from dealib.results.elements import Array
from dealib.results.mesh import Ints, ResultMesh
from dealib.study.outcome import Outcome
from dealib.study.sample import component, regions
from dealib.study.schema import Contour, Shapes

STRIPS = ("bottom_electrode", "film", "top_electrode")
# each second-order cell as first-order triangles between its nodes (VTK's order)
_SPLIT = {
    9: [(0, 4, 8), (0, 8, 7), (4, 1, 5), (4, 5, 8), (8, 5, 2), (8, 2, 6), (7, 8, 6), (7, 6, 3)],
    6: [(0, 3, 5), (3, 1, 4), (5, 4, 2), (3, 4, 5)],
    4: [(0, 1, 2), (0, 2, 3)],
    3: [(0, 1, 2)],
}


def triangles(mesh: ResultMesh, names: tuple[str, ...] = STRIPS) -> Ints:
    """First-order triangles of the cells of some regions, (triangles, 3)."""
    cells = np.concatenate([mesh.cells[mesh.in_region(r)] for r in names if r in mesh.names])
    return np.concatenate([cells[:, list(t)] for t in _SPLIT[cells.shape[1]]])


def draw_contour(part: Any, outcome: Outcome, panel: Contour) -> None:
    """Draw a field: the straightened strips above, both deformed ends below.

    Args:
        part: A matplotlib figure or subfigure.
        outcome: The case.
        panel: What to show.

    Raises:
        ValueError: If the field or the stage does not exist.
    """
    arrays = outcome.arrays(panel.stage)
    assert outcome.run is not None
    mesh = outcome.run.mesh
    cells = triangles(mesh)
    values = component(arrays, panel.field) * panel.factor
    used = values[np.unique(cells)]
    low, high = panel.limits or (float(q) for q in np.percentile(used, (1, 99)))
    both = low < 0 < high and min(-low, high) > 0.05 * max(-low, high)
    if both and panel.limits is None:
        low, high = -max(-low, high), max(-low, high)
    style = {
        "cmap": "RdBu_r" if both else ("viridis_r" if high <= 0 else "viridis"),
        "vmin": low,
        "vmax": high,
        "shading": "gouraud",
        "rasterized": True,
    }
    axes = part.subplot_mosaic([["all", "all"], ["inner", "outer"]], height_ratios=[1, 1.7])
    strips = np.unique(cells)
    straight = mesh.points * (1, 1e3)  # Z in µm
    shown = axes["all"].tripcolor(
        Triangulation(straight[:, 0], straight[:, 1], cells), values, **style
    )
    (left, low_z), (right, high_z) = straight[strips].min(axis=0), straight[strips].max(axis=0)
    axes["all"].set(
        xlabel="R on the mesh (mm)",
        ylabel="Z on the mesh (µm)",
        xlim=(left, right),
        ylim=(low_z, high_z),
    )
    now = mesh.points + arrays["u"][:, :2]
    film = outcome.strip("film")
    ends = {"inner": (film.low[0], 1), "outer": (film.low[0] + film.size[0], -1)}
    for name, (end, way) in ends.items():
        axis, near = axes[name], (mesh.points[:, 0] - end) * way <= 1.3 * panel.zoom
        axis.tripcolor(Triangulation(now[:, 0], now[:, 1], cells), values, **style)
        nodes = np.intersect1d(np.flatnonzero(near), strips)
        _zoom(axis, now[nodes], end, way, panel.zoom)
        axis.set(title=f"{name} end, true to scale", xlabel="r (mm)", ylabel="z (mm)")
    for axis in axes.values():
        axis.grid(False)
    extend = {(0, 0): "neither", (1, 0): "min", (0, 1): "max", (1, 1): "both"}
    cut = int(used.min() < low - 1e-9 * (high - low)), int(used.max() > high + 1e-9 * (high - low))
    bar = part.colorbar(shown, ax=list(axes.values()), extend=extend[cut], label=plain(panel.label))
    bar.solids.set_rasterized(True)


def _zoom(axis: Any, points: Array, end: float, way: int, length: float) -> None:
    """Show the given length at an end, with equal scales."""
    x = sorted((end - 0.12 * way * length, end + way * length))
    inside = points[(points[:, 0] >= x[0]) & (points[:, 0] <= x[1])]
    low, high = inside[:, 1].min(), inside[:, 1].max()
    middle = (low + high) / 2
    half = max((high - low) / 2 * 1.15, 0.22 * length)
    axis.set(xlim=x, ylim=(middle - half, middle + half))
    axis.set_aspect("equal")
    axis.locator_params(nbins=4)


def draw_shapes(part: Any, outcome: Outcome, panel: Shapes, colours: tuple[str, ...]) -> None:
    """Draw the strips at several times, true to scale.

    Raises:
        ValueError: If no fields are stored.
    """
    axis = part.subplots()
    assert outcome.run is not None
    present = [r for r in STRIPS if r in regions(outcome.run.mesh)]
    for i, time in enumerate(panel.times):
        row, arrays = outcome.nearest(time)
        edges = []
        for region, across in ((present[0], 0.0), (present[-1], 1.0)):
            strip = outcome.strip(region)
            s = strip.positions
            u = [strip.at(component(arrays, n), s, across) for n in ("u_R", "u_Z")]
            z = strip.low[1] + across * strip.size[1]
            edges.append((strip.low[0] + s * strip.size[0] + u[0], z + u[1]))
        (r0, z0), (r1, z1) = edges
        label = f"{row['time_s']:g} s: {row['displacement_mm']:.2f} mm"
        if row["voltage_kV"]:
            label += f", {row['voltage_kV']:.3g} kV"
        colour = colours[i % len(colours)]
        axis.fill(
            np.r_[r0, r1[::-1]], np.r_[z0, z1[::-1]], fc=colour, ec=colour, lw=0.6, label=label
        )
    axis.set(xlabel="r (mm)", ylabel="z (mm)")
    axis.set_aspect("equal")
    axis.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
