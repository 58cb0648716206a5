"""Off-screen rendering of three-dimensional pictures by pyvista."""

from __future__ import annotations

import functools
import subprocess
import sys
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from dealib.arrays import Array
from dealib.errors import PlatformError
from dealib.plots.contours import Scale

Bodies = list[tuple[Any, str]]  # VTK's data and a colour; empty if it is coloured by values

PIXELS = (1900, 1000)
_ABOVE = (1.2, -1.6, 1.35)  # direction from which the camera looks
_PROBE = (
    "import pyvista as pv; p = pv.Plotter(off_screen=True, window_size=(40, 40));"
    "p.add_mesh(pv.Sphere()); p.screenshot(None, return_img=True); p.close()"
)


@functools.cache
def _works(probe: str) -> bool:
    """Whether a script that renders succeeds in another process; tried only once."""
    command = [sys.executable, "-c", probe]
    try:
        done = subprocess.run(command, capture_output=True, timeout=120, check=False)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def check_rendering() -> None:
    """Check that 3-D pictures can be rendered.

    A small picture is rendered in another process, since VTK aborts without EGL or OSMesa.

    Raises:
        PlatformError: If it cannot be rendered.
    """
    if not _works(_PROBE):
        raise PlatformError(
            "3-D pictures need off-screen OpenGL (Debian: apt install libegl1 libegl-mesa0 "
            "libgl1); all other pictures work without it"
        )


def picture(
    seen: Bodies,
    colours: Scale | None,
    paper: str,
    within: Sequence[float] | None = None,
    edges: str = "",
) -> Any:
    """A picture (height, width, 3) of bodies, cropped to them.

    Args:
        seen: The bodies.
        colours: Colour scale of their values.
        paper: Colour of the background.
        within: Bounds that the camera shows, mm. The picture is then not cropped, as the frames of
            an animation need it.
        edges: Colour of the cells' edges; empty for none.
    """
    import pyvista as pv
    from vtkmodules.vtkCommonCore import vtkLogger

    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_ERROR)  # it warns of a missing display
    plotter = pv.Plotter(off_screen=True, window_size=PIXELS)
    plotter.set_background(paper)
    light: dict[str, Any] = {"ambient": 0.35, "specular": 0.1}
    if edges:
        light |= {"show_edges": True, "edge_color": edges}
    for body, colour in seen:
        if colour or colours is None:
            plotter.add_mesh(body, color=colour, **light)
            continue
        plotter.add_mesh(
            body, scalars="values", clim=(colours.norm.vmin, colours.norm.vmax),
            cmap=colours.cmap, show_scalar_bar=False, **light,
        )  # fmt: skip
    plotter.camera_position = [_ABOVE, (0, 0, 0), (0, 0, 1)]
    plotter.reset_camera(bounds=within)
    plotter.camera.zoom(_zoom(plotter.camera, within or plotter.bounds))
    plotter.enable_anti_aliasing("ssaa")
    found = np.asarray(plotter.screenshot(None, return_img=True))
    plotter.close()
    if within is not None:
        return found
    used = (found != found[0, 0]).any(axis=2)
    rows, columns = (np.flatnonzero(used.any(axis=k)) for k in (1, 0))
    return found[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]


def _zoom(camera: Any, bounds: Sequence[float]) -> float:
    """Factor of zoom at which a box fills the camera's picture."""
    corners = np.array(list(product(*np.reshape(bounds, (3, 2))))) - camera.position
    right = np.cross(camera.direction, camera.up)
    right /= np.linalg.norm(right)
    far = corners @ camera.direction
    across, up = corners @ right / far, corners @ np.cross(right, camera.direction) / far
    width, height = PIXELS
    filled = max(np.abs(up).max(), np.abs(across).max() * height / width)
    return float(0.96 * np.tan(np.radians(camera.view_angle / 2)) / filled)


def draw_faces(faces: list[tuple[Array, str]], ink: str, paper: str) -> Any:
    """A picture of faces (faces, corners, 3) by colour, with their edges.

    Args:
        faces: Faces and their colours.
        ink: Colour of the edges.
        paper: Colour of the background.
    """
    import pyvista as pv

    found = []
    for corners, colour in faces:
        rows = np.arange(len(corners) * corners.shape[1]).reshape(len(corners), -1)
        found.append((pv.PolyData.from_regular_faces(corners.reshape(-1, 3), rows), colour))
    return picture(found, None, paper, edges=ink)
