"""The axisymmetric result as the body of revolution that it stands for."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from dealib.errors import PlatformError
from dealib.plots.contours import magnification, scale
from dealib.plots.quantities import Quantity
from dealib.plots.shape import STRIPS, Sampler, Shape
from dealib.plots.style import DARK, LIGHT

_ANGLE, _SECTORS = 270.0, 180
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


def draw_revolved(shape: Shape, what: Quantity, target: Path, dark: bool = False) -> None:
    """Draw three quarters of the device at one step, its thickness magnified.

    Args:
        shape: The step.
        what: Colours.
        target: PNG file.
        dark: On a dark background.

    Raises:
        PlatformError: If the machine cannot render.
    """
    check_rendering()
    import pyvista as pv

    look = DARK if dark else LIGHT
    values = shape.strips(what.of(shape.arrays))
    norm, cmap, _ = scale(shape, values, look)
    factor = magnification(shape)
    plotter = pv.Plotter(off_screen=True, window_size=(1500, 1000))
    plotter.set_background(look.paper)
    moved, start = shape.moved(factor), 0
    for name in STRIPS:
        if name not in shape.mesh.names:
            continue
        part = Sampler.of(shape.mesh, (name,), n=shape.strips.n)
        stop = start + len(part.points)
        body = _revolve(moved[start:stop], part.triangles, values[start:stop])
        plotter.add_mesh(
            body, scalars="values", clim=(norm.vmin, norm.vmax), cmap=cmap, show_scalar_bar=False,
            smooth_shading=True, split_sharp_edges=True, specular=0.2,
        )  # fmt: skip
        start = stop
    g, down = shape.geometry, float(shape.row["displacement_mm"])
    half = 2 * factor * g.half_thickness
    for left, right, z in (
        (1e-6, g.inner_radius, down),
        (g.outer_radius, g.outer_radius + 0.15 * g.inner_radius, 0.0),
    ):
        corners = np.array(
            [[left, z - half], [right, z - half], [right, z + half], [left, z + half]]
        )
        rigid = _revolve(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.zeros(4))
        plotter.add_mesh(rigid, color="#8a939d", specular=0.1)
    plotter.add_scalar_bar(
        what.title.replace("$", "").replace("_{", " ").replace("}", ""),
        mapper=_mapper(plotter, norm, cmap), color=look.ink, vertical=True, position_x=0.88,
        position_y=0.2, height=0.6, width=0.05, fmt="%.3g", n_labels=5, title_font_size=24,
        label_font_size=22,
    )  # fmt: skip
    note = f"{shape.run.info['name']}, {shape.when}\nthickness magnified {factor:g} times"
    plotter.add_text(note.replace("−", "-"), position="upper_left", font_size=13, color=look.ink)
    plotter.camera_position = [(1.9, -2.1, 1.5), (0, 0, down / 2 / g.outer_radius), (0, 0, 1)]
    plotter.reset_camera()
    plotter.camera.zoom(1.35)
    plotter.enable_anti_aliasing("ssaa")
    temporary = target.with_name(f".{target.stem}.tmp.png")
    try:
        plotter.screenshot(str(temporary))
        os.replace(temporary, target)
    except OSError as error:
        raise PlatformError(f"cannot write {target}: {error.strerror or error}") from None
    finally:
        plotter.close()


def _revolve(points: Any, triangles: Any, values: Any) -> Any:
    """A surface (r, z) turned about the axis, open for a quarter to show the section."""
    import pyvista as pv

    xyz = np.column_stack([points[:, 0], np.zeros(len(points)), points[:, 1]])
    section = pv.PolyData.from_regular_faces(xyz, triangles)
    section.point_data["values"] = values
    return section.clean(tolerance=1e-9).extrude_rotate(
        resolution=_SECTORS, angle=_ANGLE, capping=True, rotation_axis=(0, 0, 1)
    )


def _mapper(plotter: Any, norm: Any, cmap: str) -> Any:
    """The mapper of the first coloured body."""
    return next(iter(plotter.actors.values())).mapper
