"""The map of self-sensing: capacitance over displacement by voltage, and its sensitivity."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.plots.labels import plain
from dealib.results.sensing import CapacitanceMap


def draw(found: CapacitanceMap, title: str) -> Any:
    """Draw capacitance and dC/du over displacement, a curve per voltage; dots are solved states."""
    figure, (values, slopes) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    colours = plt.get_cmap("viridis")(np.linspace(0.05, 0.85, len(found.sweeps)))
    u = np.linspace(found.low, found.high, 200)
    for sweep, colour in zip(found.sweeps, colours, strict=True):
        values.plot(u, sweep.at(u), color=colour, label=f"{sweep.voltage:.4g} kV")
        values.plot(sweep.displacement, sweep.capacitance, ".", color=colour, ms=4)
        slopes.plot(u, sweep.sensitivity(u), color=colour)
    values.set(xlabel="Displacement (mm)", ylabel="Capacitance (pF)")
    slopes.set(xlabel="Displacement (mm)", ylabel="Sensitivity dC/du (pF/mm)")
    values.legend()
    figure.suptitle(plain(title))
    return figure
