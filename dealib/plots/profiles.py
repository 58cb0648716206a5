"""Line profiles along the film: its middle and both faces, from the film's own values."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.geometry.names import FILM
from dealib.plots.labels import plain
from dealib.plots.shape import Shape
from dealib.results.elements import Array
from dealib.results.quantities import SURFACE_CHARGE, Quantity
from dealib.results.sampling import Strip


def lines(shape: Shape, what: Quantity) -> dict[str, tuple[Array, Array]]:
    """Radii on the mesh (mm) and values of a quantity along the film, by line."""
    film = Strip(shape.mesh, FILM)
    if what is SURFACE_CHARGE:
        charge = {f"electrode at the {name} face": film.charge(shape.arrays, side)
                  for name, side in (("top", 1), ("bottom", -1))}  # fmt: skip
        return {name: (R, what.factor * density) for name, (R, density) in charge.items()}
    nodal, s = what.of(shape.arrays), film.positions
    R = film.start + s * film.length
    heights = {"top face": 1.0, "middle": 0.5, "bottom face": 0.0}
    return {name: (R, film.at(nodal, s, t)) for name, t in heights.items()}


def draw_profiles(shape: Shape, quantities: list[Quantity]) -> Any:
    """Quantities along the film at one step: the whole length, and both ends enlarged."""
    figure, axes = plt.subplots(
        len(quantities), 3, figsize=(11, 1.2 + 2.7 * len(quantities)), squeeze=False,
        width_ratios=(2, 1, 1), layout="constrained",
    )  # fmt: skip
    film = Strip(shape.mesh, FILM)
    a, b = film.start, film.start + film.length
    near = min(4 * shape.thickness, film.length / 4)
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
    figure.suptitle(plain(f"{shape.run.title}, {shape.when}"), fontsize="medium")
    return figure
