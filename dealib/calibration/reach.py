"""Data outside the range of a run: how many points, and a hint at what may be wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from dealib.calibration.task import History, Series
from dealib.data.compare import Comparison, brought_inside, compare, remedy
from dealib.data.names import split_unit
from dealib.errors import ConfigError

LEAST = 0.5  # share of the points that must lie inside


def inside(comparison: Comparison) -> float:
    """Share of the points within the range of the run."""
    return 1 - float(np.mean(comparison.beyond))


def check_reach(series: Series, history: History) -> None:
    """Refuse data of which most points lie outside the run.

    Raises:
        ConfigError: If so; the message suggests a preparation that would bring them inside.
    """
    measured = series.measured
    x, reached = measured.columns[measured.x], history[measured.x]
    if series.stage is not None:
        reached = reached[history["stage"] == series.stage]
    share = inside(compare(history, measured, series.stage, extrapolate=True)[0])
    if share >= LEAST:
        return
    name, unit = split_unit(measured.x)
    key, fitting, _ = brought_inside(x, reached)
    hint = remedy(measured.x, x, reached)
    if key:
        moved = replace(measured, columns=measured.columns | {measured.x: fitting})
        curves = compare(history, moved, series.stage, extrapolate=True)
        against = [split_unit(c.y_name)[0] for c in curves if mirrored(c)]
        hint += "".join(f", and {q} then has the opposite sign too" for q in against)
    raise ConfigError(
        f"{measured.path}: {share:.0%} of the points lie inside the run: {name} spans "
        f"{x.min():.6g} .. {x.max():.6g} {unit}, the run's "
        f"{reached.min():.6g} .. {reached.max():.6g} {unit}{hint}"
    )


def mirrored(comparison: Comparison) -> bool:
    """Whether the measured values look like the computed ones with the opposite sign."""
    measured, computed = comparison.measured, comparison.computed
    size = np.linalg.norm(measured) * np.linalg.norm(computed)
    return bool(measured @ computed < -0.7 * size)
