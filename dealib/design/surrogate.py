"""Gaussian processes through samples, with the error that each sample shows when it is left out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.results.elements import Array

_TUNED = 256  # samples whose likelihood chooses the lengths of a process; it grows with their cube
_ROWS = 4096  # points that are predicted at once


@dataclass(frozen=True)
class Surrogate:
    """A process through samples.

    Attributes:
        process: `sklearn.gaussian_process.GaussianProcessRegressor`.
        explained: Share of the samples' variance that it foretells when each of them is left out.
    """

    process: Any
    explained: float

    def at(self, x: Array) -> Array:
        """Its mean at points (n, variables)."""
        parts = range(0, len(x), _ROWS)
        return np.concatenate([self.process.predict(x[k : k + _ROWS]) for k in parts])

    def spread(self, x: Array) -> Array:
        """Its standard deviation there."""
        parts = range(0, len(x), _ROWS)
        found = [self.process.predict(x[k : k + _ROWS], return_std=True)[1] for k in parts]
        return np.concatenate(found)

    def without(self, x: Array, y: Array, left_out: Any) -> Surrogate:
        """The same through fewer samples, with the lengths that it has.

        Args:
            x: Of all samples.
            y: Their values.
            left_out: Which of them are left out, (n,).
        """
        process = _process(self.process.kernel_, None).fit(x[~left_out], y[~left_out])
        return Surrogate(process, self.explained)


def fit(x: Array, y: Array) -> Surrogate:
    """The process that foretells samples best, of a very smooth one and a rougher one.

    Args:
        x: Points (n, variables) of the size of 1.
        y: Values there.
    """
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    lengths, bounds = np.full(x.shape[1], 3.0), (0.05, 1e3)
    found = []
    for shape in (RBF(lengths, bounds), Matern(lengths, bounds, nu=2.5)):
        kernel = ConstantKernel(10.0, (1e-2, 1e6)) * shape + WhiteKernel(1e-6, (1e-10, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a length at its bound: the variable does not matter
            tuned = _process(kernel, "fmin_l_bfgs_b").fit(x[:_TUNED], y[:_TUNED])
        process = _process(tuned.kernel_, None).fit(x, y)
        found.append(Surrogate(process, _explained(process, y)))
    return max(found, key=lambda one: one.explained)


def _process(kernel: Any, optimizer: str | None) -> Any:
    from sklearn.gaussian_process import GaussianProcessRegressor

    return GaussianProcessRegressor(
        kernel, alpha=1e-10, optimizer=optimizer, normalize_y=True, random_state=0
    )


def _explained(process: Any, y: Array) -> float:
    """By the closed form of what is left out.

    (O. Dubrule, Math. Geol. 15 (1983) 687; C. E. Rasmussen and C. K. I. Williams, Gaussian
    Processes for Machine Learning (2006), Eq. 5.12.)
    """
    from scipy.linalg import cho_solve

    inverse = cho_solve((process.L_, True), np.eye(len(y)))
    missed = np.ravel(process.alpha_) / np.diag(inverse)  # of values of variance 1
    return float(1 - (missed**2).mean())
