"""The axisymmetric result as the body of revolution that it stands for."""

from __future__ import annotations

import subprocess
import sys
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.errors import PlatformError
from dealib.plots.contours import Scale, magnification, scale, scale_note
from dealib.plots.labels import plain
from dealib.plots.shape import Shape
from dealib.plots.style import Theme
from dealib.results.elements import Array
from dealib.results.quantities import Quantity
from dealib.results.sampling import Sampler

_ANGLE, _STEP, _PLAIN_ANGLE = 270.0, 30.0, 60.0  # degrees: of all, less a layer, of what hides
_PLAIN, _RIGID = "#3b3f52", "#8a939d"  # layers without a field; mount and frame
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
    """Draw three quarters of the device at one step, each layer peeled off the one below it.

    Raises:
        PlatformError: If the machine cannot render.
    """
    check_rendering()
    values = shape.values(what)
    colours = scale(shape, values, look, what)
    figure, axis = plt.subplots(figsize=(11, 5.8), layout="constrained")
    axis.imshow(_render(shape, values, colours, look))
    axis.set_axis_off()
    colours.bar(figure, what.title, ax=axis, shrink=0.8, pad=0.01)
    note = scale_note(magnification(shape))
    axis.set_title(plain(f"{shape.run.title}, {shape.when}\n{note}"), fontsize="medium")
    return figure


def _render(shape: Shape, values: Array, colours: Scale, look: Theme) -> Any:
    """A picture (height, width, 3) of the revolved layers between mount and frame."""
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkLogger

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # it warns of a missing display
    plotter = pv.Plotter(off_screen=True, window_size=(1900, 1000))
    plotter.set_background(look.paper)
    factor = magnification(shape)
    moved, start = shape.moved(factor), 0
    light = {"ambient": 0.35, "specular": 0.1}
    seen = False
    for k, name in enumerate(shape.layers):
        part = Sampler.of(shape.mesh, (name,), n=shape.strips.n)
        own = slice(start, start + len(part.points))
        start = own.stop
        plain = bool(np.isnan(values[own]).any())
        angle = _PLAIN_ANGLE if plain and seen else _ANGLE - _STEP * k
        seen = seen or not plain
        body = _revolve(moved[own], part.triangles, values[own], angle)
        if plain:
            plotter.add_mesh(body, color=_PLAIN, **light)
            continue
        plotter.add_mesh(
            body, scalars="values", clim=(colours.norm.vmin, colours.norm.vmax),
            cmap=colours.cmap, show_scalar_bar=False, **light,
        )  # fmt: skip
    R, middle = shape.middle
    half, width = factor * shape.thickness, 0.15 * R[0]
    for left, right, z in (
        (1e-6 * R[0], R[0], middle[0, 1]),
        (R[-1], R[-1] + width, middle[-1, 1]),
    ):
        corners = np.array(
            [[left, z - half], [right, z - half], [right, z + half], [left, z + half]]
        )
        rigid = _revolve(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(4), _ANGLE)
        plotter.add_mesh(rigid, color=_RIGID, ambient=0.25, specular=0.1)
    plotter.camera_position = [(1.2, -1.6, 1.35), (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera()
    plotter.camera.zoom(1.75)
    plotter.enable_anti_aliasing("ssaa")
    picture = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    used = (picture != picture[0, 0]).any(axis=2)
    rows, columns = (np.flatnonzero(used.any(axis=k)) for k in (1, 0))
    return picture[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _revolve(points: Array, triangles: Any, values: Array, angle: float) -> Any:
    """A surface (r, z) turned about the axis, open for a quarter to show the section."""
    import pyvista as pv

    xyz = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    section = pv.PolyData.from_regular_faces(xyz, triangles)
    section.point_data["values"] = values
    return section.clean(tolerance=1e-9).extrude_rotate(
        resolution=round(angle), angle=angle, capping=True, rotation_axis=(0, 0, 1)
    )
