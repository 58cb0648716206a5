"""Gaussian processes through samples, with their leave-one-out error."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.arrays import Array

_TUNED = 256  # samples that choose the correlation lengths; the cost grows as their cube
_ROWS = 4096  # points that are predicted at a time


@dataclass(frozen=True)
class Surrogate:
    """A Gaussian process through samples.

    Attributes:
        process: `sklearn.gaussian_process.GaussianProcessRegressor`.
        explained: Share of the samples' variance that is predicted when each is left out.
    """

    process: Any
    explained: float

    def at(self, x: Array, spread: bool = False) -> Array:
        """Mean, or standard deviation if `spread`, at points (..., variables)."""
        flat = x.reshape(-1, x.shape[-1])
        parts = (flat[k : k + _ROWS] for k in range(0, len(flat), _ROWS))
        found = [self.process.predict(part, return_std=spread) for part in parts]
        values = [one[1] for one in found] if spread else found
        return np.concatenate(values).reshape(x.shape[:-1])

    def through(self, x: Array, y: Array) -> Surrogate:
        """A process with the same correlation lengths through other samples."""
        return Surrogate(_process(self.process.kernel_, None).fit(x, y), self.explained)


def fit(x: Array, y: Array) -> Surrogate:
    """Fit processes with an RBF and a Matern kernel, and return the one that predicts better.

    The leave-one-out error has a closed form (O. Dubrule, Math. Geol. 15 (1983) 687; C. E.
    Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning (2006), Eq. 5.12).

    Args:
        x: Points (n, variables), scaled to the order of 1.
        y: Values (n,).
    """
    from scipy.linalg import cho_solve
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, WhiteKernel

    lengths, bounds, found = np.full(x.shape[1], 3.0), (0.05, 1e3), []
    for shape in (RBF(lengths, bounds), Matern(lengths, bounds, nu=2.5)):
        kernel = ConstantKernel(10.0, (1e-2, 1e6)) * shape + WhiteKernel(1e-6, (1e-10, 1.0))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a length at its bound: a variable without influence
            tuned = _process(kernel, "fmin_l_bfgs_b").fit(x[:_TUNED], y[:_TUNED])
        process = _process(tuned.kernel_, None).fit(x, y)
        inverse = cho_solve((process.L_, True), np.eye(len(y)))
        missed = np.ravel(process.alpha_) / np.diag(inverse)  # errors of values of variance 1
        found.append(Surrogate(process, float(1 - (missed**2).mean())))
    return max(found, key=lambda one: one.explained)


def _process(kernel: Any, optimizer: str | None) -> Any:
    from sklearn.gaussian_process import GaussianProcessRegressor

    return GaussianProcessRegressor(kernel, optimizer=optimizer, normalize_y=True)
