"""Comparison of a run's curve with a measured one, branch by branch."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.interpolate import PchipInterpolator

from dealib.arrays import Array
from dealib.data.branches import branches
from dealib.data.measured import Measured
from dealib.data.names import split_unit
from dealib.errors import ConfigError

_DRAWN = 200  # points of a curve between the points of a branch; fewer where branches are many
_DRAWN_ALL = 20_000


@dataclass(frozen=True, repr=False)
class Comparison:
    """A measured curve and the computed one at the same abscissae.

    Attributes:
        x_name: Column of the abscissa.
        y_name: Column of the curve.
        x: Abscissae, (points,).
        measured: Measured values, (points,).
        computed: Computed values, (points,); outside the run's range NaN or extrapolated.
        beyond: Whether a point is outside the run's range, (points,).
        branch: Number of the branch of each point, from 0, (points,).
        curves: Abscissae and values of the run along each branch, (2, any).
    """

    x_name: str
    y_name: str
    x: Array
    measured: Array
    computed: Array
    beyond: npt.NDArray[np.bool_]
    branch: npt.NDArray[np.int64]
    curves: tuple[Array, ...] = ()

    def __repr__(self) -> str:
        said = f"{len(self.x)} points, RMSE {self.rmse:.4g}, R2 {self.r2:.4f}"
        return f"<Comparison of {self.y_name} over {self.x_name}: {said}>"

    @property
    def inside(self) -> npt.NDArray[np.bool_]:
        """Points with a computed value."""
        return np.isfinite(self.computed)

    @property
    def rmse(self) -> float:
        """Root mean square of the difference, over the points inside."""
        difference = (self.computed - self.measured)[self.inside]
        return float(np.sqrt(np.mean(difference**2)))

    @property
    def r2(self) -> float:
        """Coefficient of determination, 1 - SS_res / SS_tot, over the points inside; else NaN."""
        measured = self.measured[self.inside]
        total = float(np.sum((measured - measured.mean()) ** 2))
        return 1 - self.rmse**2 * len(measured) / total if total > 0 else float("nan")

    def of_branch(self, number: int) -> Comparison:
        """The points of one branch."""
        on = self.branch == number
        return replace(
            self,
            x=self.x[on],
            measured=self.measured[on],
            computed=self.computed[on],
            beyond=self.beyond[on],
            branch=self.branch[on],
            curves=self.curves[number : number + 1],
        )


def compare(
    history: Mapping[str, npt.ArrayLike],
    measured: Measured,
    stage: str | None = None,
    extrapolate: bool = False,
) -> list[Comparison]:
    """Compare each measured curve with that of a run.

    Both abscissae are split into branches where they turn. The first rising branch of the data is
    compared with the first rising branch of the run, and so on. If the run has no further branch of
    that direction, its last one is taken. Between its steps the run is interpolated by monotone
    cubics (PCHIP).

    Args:
        history: Columns of a history, with `stage`.
        measured: The data.
        stage: Use only the run's rows of this stage, and the row before them.
        extrapolate: Extrapolate the run's curve linearly.

    Raises:
        ConfigError: If the stage does not exist, or no point is inside the run's curve.
    """
    rows = _rows([str(s) for s in np.asarray(history["stage"])], stage)
    run_x = np.asarray(history[measured.x], dtype=float)[rows]
    x = measured.columns[measured.x]
    pieces = branches(x, hold=False, turn=measured.turn)
    partners = _partners(x, pieces, run_x, branches(run_x))
    number = np.repeat(np.arange(len(pieces)), [p.stop - p.start for p in pieces])
    drawn = int(np.clip(_DRAWN_ALL / len(pieces), 2, _DRAWN))
    found = []
    for name in measured.curves:
        run_y = np.asarray(history[name], dtype=float)[rows]
        computed, beyond, curves = np.full(len(x), np.nan), np.zeros(len(x), dtype=bool), []
        for piece, partner in zip(pieces, partners, strict=True):
            curve = _ascending(run_x[partner], run_y[partner])
            computed[piece] = _interpolate(*curve, x[piece], extrapolate)
            beyond[piece] = np.logical_or(*_beyond(curve[0], x[piece]))
            reach = x[max(piece.start - 1, 0) : piece.stop]
            between = np.linspace(reach.min(), reach.max(), drawn)
            curves.append(np.stack([between, _interpolate(*curve, between, extrapolate)]))
        values = measured.columns[name]
        there = np.isfinite(values)
        parts = x[there], values[there], computed[there], beyond[there], number[there]
        found.append(Comparison(measured.x, name, *parts, tuple(curves)))
        if not found[-1].inside.any():
            raise ConfigError(
                f"{measured.path}: {measured.x} spans {x.min():.6g} .. {x.max():.6g}, the run "
                f"{run_x.min():.6g} .. {run_x.max():.6g}: no point to compare"
                f"{remedy(measured.x, x, run_x)}"
            )
    return found


def remedy(name: str, x: Array, run_x: Array) -> str:
    """A hint at a preparation that would bring the data into the range of the run.

    Args:
        name: Column of the abscissa.
        x: Measured abscissae.
        run_x: Those of the run.

    Returns:
        A hint such as '; with prepare: {force: {sign: -1}} 100% would lie inside', or nothing.
    """
    key, _, share = brought_inside(x, run_x)
    prepare = f"{{{split_unit(name)[0]}: {{{key}}}}}"
    return f"; with prepare: {prepare} {share:.0%} would lie inside" if key else ""


def brought_inside(x: Array, run_x: Array) -> tuple[str, Array, float]:
    """The preparation that `remedy` names ('' for none), the prepared x, and the share inside."""
    moved = {
        "sign: -1": -x,
        "zero: start": x - x[0],
        **{f"factor: 1e{k}": x * 10.0**k for k in (-3, 3, -6, 6, -1, 1, -2, 2)},
    }
    low, high = run_x.min() - _slack(run_x), run_x.max() + _slack(run_x)
    for key, values in moved.items():
        share = float(np.mean((values >= low) & (values <= high)))
        wide = float(np.ptp(values)) > 0.05 * float(np.ptp(run_x))
        if share >= 0.9 and wide:
            return key, values, share
    return "", x, 0.0


def _rows(stages: Sequence[str], stage: str | None) -> list[int]:
    if stage is None:
        return list(range(len(stages)))
    rows = [i for i, name in enumerate(stages) if name == stage]
    if not rows:
        known = ", ".join(dict.fromkeys(stages))
        raise ConfigError(f"the run has no stage {stage!r}; it has {known}")
    return [rows[0] - 1, *rows] if rows[0] > 0 else rows


def _partners(x: Array, pieces: list[slice], run_x: Array, run: list[slice]) -> list[slice]:
    """For each branch of the data the branch of the run with which it is compared."""
    # neighbouring branches share their turning point
    run = [slice(max(p.start - 1, 0), p.stop) for p in run]
    found = []
    seen = {1.0: 0, -1.0: 0}
    for piece in pieces:
        way = _direction(x[slice(max(piece.start - 1, 0), piece.stop)])
        same = [p for p in run if _direction(run_x[p]) == way] or run
        found.append(same[min(seen[way], len(same) - 1)])
        seen[way] += 1
    return found


def _direction(x: Array) -> float:
    return 1.0 if x[-1] >= x[0] else -1.0


def _ascending(x: Array, y: Array) -> tuple[Array, Array]:
    """The points of a branch at which it advances, in ascending order of x.

    If x is constant at first, as a voltage while the mount is loaded, the branch begins with the
    last point before x changes.
    """
    way = _direction(x)
    moved = np.flatnonzero(np.abs(x - x[0]) > _slack(x))
    if moved.size:
        x, y = x[moved[0] - 1 :], y[moved[0] - 1 :]
    reached = np.maximum.accumulate(way * x)
    fresh = np.concatenate([[True], reached[1:] > reached[:-1]])
    x, y = x[fresh], y[fresh]
    return (x, y) if way > 0 else (x[::-1], y[::-1])


def _interpolate(run_x: Array, run_y: Array, x: Array, extrapolate: bool) -> Array:
    # monotone cubics: straight lines between few steps would add an error of their own
    smooth = PchipInterpolator(run_x, run_y, extrapolate=False) if len(run_x) > 2 else None
    within = np.clip(x, run_x[0], run_x[-1])
    y = np.asarray(np.interp(x, run_x, run_y) if smooth is None else smooth(within))
    below, above = _beyond(run_x, x)
    if extrapolate and len(run_x) > 1:
        first = (run_y[1] - run_y[0]) / (run_x[1] - run_x[0])
        last = (run_y[-1] - run_y[-2]) / (run_x[-1] - run_x[-2])
        y[below] += first * (x[below] - run_x[0])
        y[above] += last * (x[above] - run_x[-1])
    elif not extrapolate:
        y[below | above] = np.nan
    return y


def _beyond(run_x: Array, x: Array) -> tuple[npt.NDArray[np.bool_], npt.NDArray[np.bool_]]:
    """Whether points lie before the first one of a run's curve, and behind its last one."""
    slack = _slack(run_x)
    return x < run_x[0] - slack, x > run_x[-1] + slack


def _slack(run_x: Array) -> float:
    """Tolerance for rounding of the run's abscissa."""
    return 1e-9 * max(float(np.ptp(run_x)), 1e-300)
