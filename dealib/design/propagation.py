"""Quantiles, Sobol indices and probabilities of quantities, from samples.

A Gaussian process through the samples (`surrogate`) is integrated over the distributions. Sobol
indices are those of variables that may be correlated: first = Var E[y | x] / Var y, total =
E Var[y | others] / Var y (S. Kucherenko, S. Tarantola and P. Annoni, Comput. Phys. Commun. 183
(2012) 937), the first one with the estimator of A. Janon et al., ESAIM: P&S 18 (2014) 342. Errors
have 95 % confidence. They combine a jackknife, which leaves out each eighth of the samples, with
the change of the integrals when the number of their points is halved.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from dealib.arrays import Array
from dealib.design.distributions import Joint, scores
from dealib.design.surrogate import Surrogate, fit
from dealib.errors import NotConverged

_POINTS, _FEWER = 2**14, 2**12  # points of an integral, and of one for the jackknife
_GROUPS = 8  # of samples, for the jackknife
_SURE = 1.96  # half width of a 95 % interval in standard deviations
TRUSTED = 0.9  # explained share of the variance above which the process replaces the samples
Told = dict[str, tuple[float, float]]  # a number and the half width of its 95 % interval


class OutputStatistics(NamedTuple):
    """Statistics of a quantity.

    Attributes:
        explained: Share of the variance that the process predicts, see `Surrogate`.
        numbers: Mean, standard deviation and quantiles.
        first: First-order Sobol indices, by variable.
        total: Total Sobol indices, by variable.
    """

    explained: float
    numbers: Told
    first: Told
    total: Told


class Probability(NamedTuple):
    """Probability of an event with its 95 % interval."""

    probability: float
    probability_low: float
    probability_high: float

    @classmethod
    def of(cls, among: int, count: int, least: int, most: int) -> Probability:
        """Estimate a probability by Wilson's interval.

        Args:
            among: Number of points.
            count: Number of points at which the event happens.
            least: Lower bound of that number, where it is uncertain itself.
            most: Upper bound of that number.
        """
        from scipy.stats import binomtest

        low, high = (binomtest(k, among).proportion_ci(method="wilson") for k in (least, most))
        return cls(count / among, float(low.low), float(high.high))


class Samples:
    """Sample points of distributions, and the quantities of a model there.

    Attributes:
        joint: The distributions.
        x: Points (n, variables).
        values: Values by quantity, (n,); NaN where there is no result.
        solved: Whether a point has a result, (n,).

    Args:
        joint: The distributions.
        model: Function from points to values by quantity.
        count: Number of points, a power of two.
        seed: Seed of their scrambling.
        levels: Quantile levels, from 0 to 1.

    Raises:
        NotConverged: If too few points have a result.
    """

    def __init__(
        self,
        joint: Joint,
        model: Callable[[Array], Mapping[str, Array]],
        count: int,
        seed: int = 0,
        levels: tuple[float, ...] = (0.05, 0.5, 0.95),
    ) -> None:
        self.joint, self._seed, self._levels = joint, seed, levels
        self.x = joint.of(scores(count, len(joint.names), seed))
        self.values = model(self.x)
        self.solved: Any = np.isfinite(list(self.values.values())).all(axis=0)
        self._processes: dict[str, Surrogate] = {}
        if (n := self.solved.sum()) < max(_GROUPS, 2 * len(joint.names) + 2):
            raise NotConverged(f"only {n} of {count} samples have a result, which are too few")

    @property
    def unsolved(self) -> Probability:
        """Probability that a sample has no result."""
        count = int((~self.solved).sum())
        return Probability.of(len(self.x), count, count, count)

    def known(self, name: str) -> OutputStatistics:
        """Statistics of a quantity."""
        x, y, smooth = self._known(name)
        trusted, group = smooth.explained >= TRUSTED, np.arange(len(y)) % _GROUPS

        def numbers(process: Surrogate, kept: Any, count: int = _POINTS) -> Array:
            of = process.at(self._inside[:count]) if trusted else y[kept]
            indices = _indices(process.at(self._pairs[:, :count]))
            spread = of.std(ddof=0 if trusted else 1)
            return np.array([of.mean(), spread, *np.quantile(of, self._levels), *indices])

        best, half = (numbers(smooth, group < _GROUPS, n) for n in (_POINTS, _POINTS // 2))
        parts = (group != k for k in range(_GROUPS))
        again = [numbers(smooth.through(x[p], y[p]), p, _FEWER) for p in parts]
        error = np.hypot(_SURE * np.sqrt((_GROUPS - 1) * np.var(again, axis=0)), best - half)
        names = ["mean", "deviation", *(f"q{100 * q:g}" for q in self._levels)]
        found = iter(zip(best.tolist(), error.tolist(), strict=True))
        of = (dict(zip(n, found, strict=False)) for n in (names, *[self.joint.names] * 2))
        return OutputStatistics(smooth.explained, *of)

    def beyond(self, name: str, bound: float, sign: int) -> Probability:
        """Probability that a quantity exceeds a bound, or has no result.

        Args:
            name: Name of the quantity.
            bound: The bound.
            sign: 1: above the bound; -1: below it.
        """
        _, y, smooth = self._known(name)
        of, spread = y, np.zeros(len(y))
        if smooth.explained >= TRUSTED:
            of, spread = smooth.at(self._inside), smooth.at(self._inside, spread=True)
        over = (sign * (of - bound) + k * _SURE * spread > 0 for k in (0, -1, 1))
        found = Probability.of(len(of), *(int(o.sum()) for o in over))
        if self.solved.all():
            return found
        return Probability(*(a + (1 - a) * b for a, b in zip(self.unsolved, found, strict=True)))

    def _plain(self, x: Array) -> Array:
        """Points, shifted and scaled to a mean of 0 and a deviation of 1."""
        return np.asarray((x - self.joint.means) / self.joint.deviations)

    def _known(self, name: str) -> tuple[Array, Array, Surrogate]:
        """Samples with a result, their values, and the process through them."""
        x, y = self._plain(self.x[self.solved]), self.values[name][self.solved]
        if name not in self._processes:
            self._processes[name] = fit(x, y)
        return x, y, self._processes[name]

    @cached_property
    def _inside(self) -> Array:
        """Points of the distributions, except those whose nearest sample has no result."""
        from scipy.spatial import cKDTree

        every = self._plain(self.joint.of(scores(_POINTS, self.x.shape[1], self._seed + 1)))
        return every[self.solved[cKDTree(self._plain(self.x)).query(every)[1]]]

    @cached_property
    def _pairs(self) -> Array:
        """Four sets of points for each variable, (4 * variables, n, variables).

        The first two share this variable only, the last two share all variables but this one.
        """
        count, found = self.x.shape[1], list[Array]()
        a, b = np.split(scores(_POINTS, 2 * count, self._seed + 2), 2, axis=1)
        for k in range(count):
            rest = [j for j in range(count) if j != k]
            same, own = np.hstack([a[:, :1], b[:, 1:]]), np.hstack([a[:, :-1], b[:, -1:]])
            found += [self._plain(self.joint.of(z, [k, *rest])) for z in (a, same)]
            found += [self._plain(self.joint.of(z, [*rest, k])) for z in (a, own)]
        return np.array(found)


def _indices(values: Array) -> Array:
    """First-order indices of all variables, then total ones, from values at `_pairs`."""
    a, b, c, d = (values[k::4] for k in range(4))
    mean = (a + b).mean(axis=1) / 2
    with np.errstate(all="ignore"):
        first = ((a * b).mean(axis=1) - mean**2) / ((a**2 + b**2).mean(axis=1) / 2 - mean**2)
        total = ((c - d) ** 2).mean(axis=1) / np.concatenate([c, d], axis=1).var(axis=1) / 2
    return np.nan_to_num(np.concatenate([first, total]))  # 0 for a constant quantity
