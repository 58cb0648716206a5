"""Line profiles along the middle and both faces of a film, from values inside the film."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.arrays import Array
from dealib.errors import ConfigError, by_caller
from dealib.plots.labels import plain
from dealib.plots.shape import LayerShape, drawn
from dealib.results.quantities import SURFACE_CHARGE, FieldQuantity
from dealib.results.sampling import LayerStrip


def film(shape: LayerShape) -> str:
    """The dielectric layer with the largest field on average, else the first one.

    Raises:
        ConfigError: If the device is no laminate in a plane.
    """
    if shape.laminate is None:
        raise ConfigError(
            f"{shape.run.directory}: profiles run along the layers of a laminate in a plane, "
            f"and this device is none; use {by_caller('--field', 'field')} to draw it whole"
        )
    E, mesh = np.linalg.norm(shape.arrays["E"], axis=1), shape.mesh
    names = [n for n in shape.layers if n in drawn(shape.run, SURFACE_CHARGE)]
    return max(names, key=lambda n: round(float(E[mesh.cells[mesh.in_region(n)]].mean()), 9))


def lines(shape: LayerShape, what: FieldQuantity) -> dict[str, tuple[Array, Array]]:
    """Positions on the mesh (mm) and values of a quantity along the film, by line."""
    strip = shape.section.layer(film(shape))
    if what is SURFACE_CHARGE:
        charge = {f"electrode at the {name} face": strip.charge(shape.arrays, side)
                  for name, side in (("top", 1), ("bottom", -1))}  # fmt: skip
        return {name: (x, what.factor * density) for name, (x, density) in charge.items()}
    nodal, s = what.of(shape.arrays), strip.positions
    x = strip.start + s * strip.length
    heights = {"top face": 1.0, "middle": 0.5, "bottom face": 0.0}
    return {name: (x, strip.at(nodal, s, t)) for name, t in heights.items()}


def _panels(shape: LayerShape, strip: LayerStrip) -> dict[str, tuple[float, float]]:
    """Titles and ranges: the whole length, and each end of the base where the film has it."""
    assert shape.laminate is not None
    base, a, b = shape.laminate.base, strip.start, strip.start + strip.length
    near = min(4 * shape.thickness, strip.length / 4)
    found = {f"along {film(shape)}": (a, b)}
    for name, at, inside, there in zip(
        base.ends, ((a, a + near), (b - near, b)), base.limits, (a, b), strict=False
    ):
        if name and abs(inside - there) < 1e-6 * strip.length:
            found[f"{name} end"] = at
    return found


def draw_profiles(shape: LayerShape, quantities: list[FieldQuantity]) -> Any:
    """Quantities along the film at one step: the whole length, and its ends enlarged."""
    panels = _panels(shape, shape.section.layer(film(shape)))
    figure, axes = plt.subplots(
        len(quantities), len(panels), figsize=(11, 1.2 + 2.7 * len(quantities)), squeeze=False,
        width_ratios=(2, 1, 1)[: len(panels)], layout="constrained",
    )  # fmt: skip
    for row, what in zip(axes, quantities, strict=True):
        found = lines(shape, what)
        everything = np.concatenate([v for _, v in found.values()])
        low, high = np.percentile(everything, [1, 99])
        pad = 0.15 * ((high - low) or abs(high) or 1)
        for axis, (left, right) in zip(row, panels.values(), strict=True):
            for k, (label, (x, values)) in enumerate(found.items()):
                style = {"marker": ".", "ms": 4} if axis is not row[0] else {}
                axis.plot(x, values, color=f"C{k}", ls=("-", "--", "-.")[k], label=label, **style)
            margin = 0.02 * (right - left)
            axis.set_xlim(left - margin, right + margin)
            axis.locator_params(axis="x", nbins=4 if axis is not row[0] else 8)
        row[0].set_ylim(low - pad, high + pad)
        row[0].set_ylabel(what.title)
        row[0].legend(loc="best")
    for axis, title in zip(axes[0], panels, strict=True):
        axis.set_title(plain(title), loc="left")
    for axis in axes[-1]:
        axis.set_xlabel(f"{shape.kinematics.axes[1 - shape.section.across]} on the mesh (mm)")
    figure.suptitle(plain(f"{shape.run.title}, {shape.when}"), fontsize="medium")
    return figure
