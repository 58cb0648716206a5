"""The axisymmetric result as the body of revolution that it stands for."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.errors import PlatformError
from dealib.geometry import names
from dealib.plots.contours import magnification, scale, scale_note
from dealib.plots.labels import plain
from dealib.plots.quantities import Quantity
from dealib.plots.shape import STRIPS, Sampler, Shape
from dealib.plots.style import Theme
from dealib.results.elements import Array

_ANGLE, _PEELED = 270.0, 190.0  # degrees; the top electrode covers less of the film
_PROBE = (
    "import pyvista as pv; p = pv.Plotter(off_screen=True, window_size=(40, 40));"
    "p.add_mesh(pv.Sphere()); p.screenshot(None, return_img=True); p.close()"
)


def check_rendering() -> None:
    """Render a small picture in another process: without EGL or OSMesa, VTK ends its process.

    Raises:
        PlatformError: If it does.
    """
    try:
        done = subprocess.run(
            [sys.executable, "-c", _PROBE], capture_output=True, timeout=120, check=False
        )
        works = done.returncode == 0
    except subprocess.TimeoutExpired:
        works = False
    if not works:
        raise PlatformError(
            "3-D pictures need off-screen OpenGL (Debian: apt install libegl1 libegl-mesa0 "
            "libgl1); all other pictures work without it"
        )


def draw_revolved(shape: Shape, what: Quantity, look: Theme) -> Any:
    """Draw three quarters of the device at one step, the top electrode peeled off the film.

    Raises:
        PlatformError: If the machine cannot render.
    """
    check_rendering()
    values = shape.strips(what.of(shape.arrays))
    norm, cmap, extend = scale(shape, values, look, what)
    figure, axis = plt.subplots(figsize=(11, 7), layout="constrained")
    axis.imshow(_render(shape, values, norm, cmap, look))
    axis.set_axis_off()
    colours = plt.cm.ScalarMappable(norm, cmap)
    figure.colorbar(colours, ax=axis, extend=extend, label=what.title, shrink=0.8, pad=0.01)
    note = scale_note(magnification(shape))
    axis.set_title(plain(f"{shape.run.info['name']}, {shape.when}\n{note}"))
    return figure


def _render(shape: Shape, values: Array, norm: Any, cmap: str, look: Theme) -> Any:
    """A picture (height, width, 3) of the revolved strips between mount and frame."""
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkLogger

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # it warns of a missing display
    plotter = pv.Plotter(off_screen=True, window_size=(1800, 1100))
    plotter.set_background(look.paper)
    factor = magnification(shape)
    moved, start = shape.moved(factor), 0
    for name in STRIPS:
        part = Sampler.of(shape.mesh, (name,), n=shape.strips.n)
        if len(part.cells) == 0:  # a film without electrode bodies
            continue
        own = slice(start, start + len(part.points))
        angle = _PEELED if name == names.TOP_ELECTRODE else _ANGLE
        plotter.add_mesh(
            _revolve(moved[own], part.triangles, values[own], angle),
            scalars="values",
            clim=(norm.vmin, norm.vmax),
            cmap=cmap,
            show_scalar_bar=False,
            ambient=0.35,
            specular=0.1,
        )
        start = own.stop
    g, down = shape.geometry, float(shape.row["displacement_mm"])
    half = 2 * factor * g.half_thickness
    for left, right, z in (
        (1e-6 * g.inner_radius, g.inner_radius, down),
        (g.outer_radius, g.outer_radius + 0.15 * g.inner_radius, 0.0),
    ):
        corners = np.array(
            [[left, z - half], [right, z - half], [right, z + half], [left, z + half]]
        )
        rigid = _revolve(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(4), _ANGLE)
        plotter.add_mesh(rigid, color="#8a939d", ambient=0.25, specular=0.1)
    plotter.camera_position = [(1.2, -1.6, 1.35), (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera()
    plotter.camera.zoom(1.75)
    plotter.enable_anti_aliasing("ssaa")
    picture = plotter.screenshot(None, return_img=True)
    plotter.close()
    return picture


def _revolve(points: Array, triangles: Any, values: Array, angle: float) -> Any:
    """A surface (r, z) turned about the axis, open for a quarter to show the section."""
    import pyvista as pv

    xyz = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    section = pv.PolyData.from_regular_faces(xyz, triangles)
    section.point_data["values"] = values
    return section.clean(tolerance=1e-9).extrude_rotate(
        resolution=round(angle), angle=angle, capping=True, rotation_axis=(0, 0, 1)
    )
