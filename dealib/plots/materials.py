"""Curves of a material law: nominal and true stress over stretch in three modes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from dealib.materials.laws import Law
from dealib.materials.response import MODES, locking_stretch, response, stability_limit
from dealib.plots.style import plt, save, theme


def draw_law(law: Law, name: str, largest: float, picture: Path, dark: bool = False) -> None:
    """Draw a law's response up to a stretch: solid up to the stability limit, dotted beyond it.

    A dotted vertical line marks the stretch at which the law locks.
    """
    stretches = np.linspace(1.0, largest, 201)
    with theme(dark) as look:
        figure, axes = plt.subplots(1, 2, figsize=(10, 4.5), layout="constrained")
        for mode, colour in zip(MODES, look.lines, strict=False):
            limit = stability_limit(law, mode)
            grid = np.sort(np.append(stretches, limit)) if limit < largest else stretches
            stresses = response(law, mode, grid)[:2]
            label = mode if np.isinf(limit) else f"{mode}, stable to {limit:.3f}"
            end = locking_stretch(law, mode, largest)
            if end < min(limit, largest):
                label = f"{mode}, locks at {end:.3f}"
                for axis in axes:
                    axis.axvline(end, color=colour, lw=0.8, ls=":")
            for axis, stress in zip(axes, stresses, strict=True):
                axis.plot(grid[grid <= limit], stress[grid <= limit], color=colour, label=label)
                axis.plot(grid[grid >= limit], stress[grid >= limit], ":", color=colour)
                if limit < largest:
                    axis.plot(limit, stress[grid == limit][0], "o", ms=5, color=colour)
        for axis, kind in zip(axes, ("nominal", "true"), strict=True):
            axis.set(xlabel="stretch", ylabel=f"{kind} stress (MPa)", xlim=(1, largest))
            axis.axhline(0, color=look.ink, lw=0.6)
        axes[0].legend()
        figure.suptitle(f"{name}: {law.words}", fontsize=11)
        save(figure, picture)
