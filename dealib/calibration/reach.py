"""Data that lie outside what a run reaches: how many points, and what may be wrong with them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from dealib.calibration.task import History, Series
from dealib.data.compare import Comparison, compare
from dealib.data.measured import Array, split_unit
from dealib.errors import ConfigError

LEAST = 0.5  # share of the points that must lie inside


def inside(comparison: Comparison) -> float:
    """Share of the points that the run reaches."""
    return 1 - float(np.mean(comparison.beyond))


def check_reach(series: Series, history: History) -> None:
    """Refuse data of which most points lie outside the run.

    Raises:
        ConfigError: If so, with a hint at a change of the data that would put them inside.
    """
    measured = series.measured
    x, reached = measured.columns[measured.x], history[measured.x]
    if series.stage is not None:
        reached = reached[history["stage"] == series.stage]
    share = inside(compare(history, measured, series.stage, extrapolate=True)[0])
    if share >= LEAST:
        return
    name, unit = split_unit(measured.x)
    hint = ""
    for change, factor, offset in _changes(name, unit, x, reached):
        fitting = factor * x + offset
        moved = replace(measured, columns=measured.columns | {measured.x: fitting})
        curves = compare(history, moved, series.stage, extrapolate=True)
        if inside(curves[0]) >= 0.9 and np.ptp(fitting) > 0.2 * np.ptp(reached):
            against = [split_unit(c.y_name)[0] for c in curves if mirrored(c)]
            hint = f"; {change} {_percent(inside(curves[0]))} would lie inside"
            hint += "".join(f", and {q} then has the opposite sign too" for q in against)
            break
    raise ConfigError(
        f"{measured.path}: {_percent(share)} of the points lie inside the run: {name} spans "
        f"{x.min():.6g} .. {x.max():.6g} {unit}, the run's "
        f"{reached.min():.6g} .. {reached.max():.6g} {unit}{hint}"
    )


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def mirrored(comparison: Comparison) -> bool:
    """Whether the measured values look like the computed ones with the opposite sign."""
    measured, computed = comparison.measured, comparison.computed
    size = np.linalg.norm(measured) * np.linalg.norm(computed)
    return bool(measured @ computed < -0.7 * size)


def _changes(name: str, unit: str, x: Array, reached: Array) -> Iterator[tuple[str, float, float]]:
    """What is often wrong with an abscissa, and the factor and offset that undo it."""
    yield f"with the opposite sign of {name}", -1.0, 0.0
    offset = float(reached[0] - x[0])
    yield f"with {offset:+.4g} {unit} added to {name}", 1.0, offset
    for power in sorted({*range(-9, 10)} - {0}, key=abs):
        for sign, words in ((1, ""), (-1, " and the opposite sign")):
            yield f"with {name} times 1e{power:+d}{words}", sign * 10.0**power, 0.0
