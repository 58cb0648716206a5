"""Line profiles along the film: its middle and both faces, from the film's own values."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.geometry import names
from dealib.plots.labels import plain
from dealib.plots.quantities import NOISE, SURFACE_CHARGE, Quantity
from dealib.plots.shape import Shape
from dealib.results.elements import Array


def surface_charge(shape: Shape, face: str) -> tuple[Array, Array]:
    """Charge density on the electrode at a face of the film (thesis, Fig. 29).

    Args:
        shape: The step.
        face: `names.FILM_TOP` or `names.FILM_BOTTOM`.

    Returns:
        Radii in the mesh configuration (mm) and D.n per deformed area (uC/mm^2 = C/m^2), n
        pointing out of the electrode: Gauss's law at a conductor.
    """
    nodes, R = shape.face(face)
    x = shape.mesh.points[nodes] + shape.state[nodes, :2]
    along = np.gradient(x, R, axis=0, edge_order=2)
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)  # points up, out of the film's top
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    into_film = -1.0 if face == names.FILM_TOP else 1.0
    D = shape.arrays["D"][nodes, :2]
    return R, into_film * np.einsum("ni,ni->n", np.where(np.abs(D) < NOISE, 0.0, D), normal)


def lines(shape: Shape, what: Quantity) -> dict[str, tuple[Array, Array]]:
    """Radii (mm) and values of a quantity along the film, by line."""
    faces = {"top face": names.FILM_TOP, "bottom face": names.FILM_BOTTOM}
    if what is SURFACE_CHARGE:
        found = {f"electrode at the {k}": surface_charge(shape, f) for k, f in faces.items()}
        return {k: (R, what.factor * v) for k, (R, v) in found.items()}
    nodal = what.of(shape.arrays)
    by_face = {k: shape.face(f) for k, f in faces.items()}
    R = by_face["top face"][1]
    return {
        "top face": (R, nodal[by_face["top face"][0]]),
        "middle": (R, shape.along_middle(nodal)),
        "bottom face": (by_face["bottom face"][1], nodal[by_face["bottom face"][0]]),
    }


def draw_profiles(shape: Shape, quantities: list[Quantity]) -> Any:
    """Quantities along the film at one step: the whole length, and both ends enlarged."""
    figure, axes = plt.subplots(
        len(quantities), 3, figsize=(11, 1.2 + 2.7 * len(quantities)), squeeze=False,
        width_ratios=(2, 1, 1), layout="constrained",
    )  # fmt: skip
    g = shape.geometry
    a, b = g.inner_radius, g.outer_radius
    near = min(6 * g.film_thickness, (b - a) / 4)
    for row, what in zip(axes, quantities, strict=True):
        found = lines(shape, what)
        everything = np.concatenate([v for _, v in found.values()])
        low, high = np.percentile(everything, [1, 99])
        pad = 0.15 * ((high - low) or abs(high) or 1)
        for axis, (left, right) in zip(row, ((a, b), (a, a + near), (b - near, b)), strict=True):
            for k, (label, (R, values)) in enumerate(found.items()):
                style = {"marker": ".", "ms": 4} if axis is not row[0] else {}
                axis.plot(R, values, color=f"C{k}", ls=("-", "--", "-.")[k], label=label, **style)
            margin = 0.02 * (right - left)
            axis.set_xlim(left - margin, right + margin)
            axis.locator_params(axis="x", nbins=4 if axis is not row[0] else 8)
        row[0].set_ylim(low - pad, high + pad)
        row[0].set_ylabel(what.title)
        row[0].legend(loc="best")
    for axis, title in zip(axes[0], ("along the film", "inner end", "outer end"), strict=True):
        axis.set_title(title, loc="left")
    for axis in axes[-1]:
        axis.set_xlabel("Radius at rest R (mm)")
    figure.suptitle(plain(f"{shape.run.info['name']}, {shape.when}"), fontsize="medium")
    return figure
