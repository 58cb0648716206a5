"""Least squares over soft intervals, and what the windows say about the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np
from devices import Parameters, Solvers
from quantities import quantities
from scipy.optimize import least_squares
from windows import HARD, WINDOWS, Window

from dealib.errors import DealibError

PULL = 0.02  # towards the middles of the windows
MARGIN = 0.002  # of a window's width, inside the hard bounds
FITTED = [w for w in WINDOWS if w.fitted]
BOUNDS = {
    "film_thickness": (0.010, 0.070),
    "prestretch": (1.0, 1.5),
    "permittivity": (2.0, 5.0),
    "inner_75": (1, 9),
    "outer_75": (5, 12),
    "inner_100": (1, 12),
    "outer_100": (7, 16),
    "inner_200": (2, 25),
    "outer_200": (15, 30),
    "preload_12": (0.05, 0.4),
    "preload_23": (0.1, 0.6),
    "preload_36": (0.005, 0.3),
    "displacement_35": (0.3, 3.0),
}


@dataclass(frozen=True)
class Fit:
    """A fit and what it computes.

    Attributes:
        parameters: The identified parameters.
        values: Every quantity of the windows.
        jacobian: Of the quantities of the fitted windows over their scales.
        windows: The windows that took part.
    """

    parameters: Parameters
    values: dict[str, float]
    jacobian: np.ndarray
    windows: list[Window]

    def misfit(self) -> float:
        """Sum of squared weighted misfits, in widths of the windows."""
        off = [(w.misfit(self.values[w.quantity]), w.weights) for w in self.windows]
        return sum((weights[miss > 0] * miss) ** 2 for miss, weights in off)

    def held(self) -> list[Window]:
        """The fitted windows that hold."""
        return [w for w in self.windows if w.misfit(self.values[w.quantity]) == 0]

    @property
    def uncertainties(self) -> np.ndarray:
        """Standard deviations, if half a window's width is one of each quantity."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def covariance(self) -> np.ndarray:
        """Of the parameters, by the linearised model."""
        J = 2 * self.jacobian
        return np.linalg.inv(J.T @ J)

    def opposed(self) -> list[tuple[Window, Window, float]]:
        """For each violated window, the violated one that pulls hardest against it.

        At the optimum the pulls r_i grad r_i of all windows balance; they are compared in the
        metric of the covariance, and given as a cosine.
        """
        bad = [i for i, w in enumerate(self.windows) if w.misfit(self.values[w.quantity])]
        L = np.linalg.cholesky(self.covariance)
        sign = [np.sign(self.windows[i].misfit(self.values[self.windows[i].quantity])) for i in bad]
        pulls = np.array([s * self.jacobian[i] @ L for s, i in zip(sign, bad, strict=True)])
        if len(bad) < 2:
            return []
        pulls /= np.linalg.norm(pulls, axis=1, keepdims=True) + 1e-300
        cosines = pulls @ pulls.T
        found = []
        for k, i in enumerate(bad):
            other = int(np.argmin(cosines[k]))
            found.append((self.windows[i], self.windows[bad[other]], float(cosines[k, other])))
        return found


def fit(
    solvers: Solvers,
    start: Parameters,
    slopes: Solvers | None = None,
    windows: Sequence[Window] = FITTED,
    fixed: Sequence[str] = (),
    evaluations: int = 25,
) -> Fit:
    """Identify the parameters with one model.

    Args:
        solvers: The model, by coupling.
        start: Where to start.
        slopes: A cheaper model for the derivatives; default the same.
        windows: Those that take part.
        fixed: Parameters that keep their values.
        evaluations: Limit of evaluations.
    """
    free = [n for n in Parameters.names() if n not in fixed]
    x_scale = {n: 0.1 * v for n, v in asdict(Parameters()).items()}
    scale = np.array([x_scale[n] for n in free])
    known: dict[bytes, np.ndarray] = {}

    def of(x: np.ndarray) -> Parameters:
        return replace(start, **dict(zip(free, map(float, x), strict=True)))

    def offsets(x: np.ndarray, model: Solvers) -> np.ndarray:
        q = quantities(of(x), model)
        return np.array([w.offset(q[w.quantity]) for w in windows])

    half = np.array([(w.high - w.low) / 2 / w.scale for w in windows])
    below, above = np.array([w.weights for w in windows]).T

    def outside(found: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Weights of the misses, and the misses; hard bounds are met with a margin."""
        weight = np.where(found < 0, below, above)
        reach = half - MARGIN * (weight == HARD)
        return weight * (np.abs(found) > reach), np.sign(found) * (np.abs(found) - reach)

    def residuals(x: np.ndarray) -> np.ndarray:
        try:
            found = offsets(x, solvers)
        except (ArithmeticError, np.linalg.LinAlgError, DealibError):
            found = np.full(len(windows), 9.0)  # no equilibrium there
        known[x.tobytes()] = found
        weight, miss = outside(found)
        return np.concatenate([weight * miss, PULL * found])

    def slope(x: np.ndarray) -> np.ndarray:
        model = slopes or solvers
        base = offsets(x, model)
        steps = 1e-3 * scale
        moved = [offsets(x + np.eye(len(x))[k] * steps[k], model) for k in range(len(x))]
        return (np.array(moved).T - base[:, None]) / steps

    def jacobian(x: np.ndarray) -> np.ndarray:
        J = slope(x)
        weight, _ = outside(known[x.tobytes()])
        return np.vstack([J * weight[:, None], PULL * J])

    found = least_squares(
        residuals,
        [getattr(start, n) for n in free],
        jacobian,
        bounds=np.array([BOUNDS[n] for n in free]).T,
        x_scale=scale,
        max_nfev=evaluations,
        xtol=1e-5,
        ftol=1e-5,
    )
    best = of(found.x)
    return Fit(best, quantities(best, solvers), found.jac[len(windows) :] / PULL, list(windows))
