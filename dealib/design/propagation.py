"""From samples to what is known of a quantity: intervals, Sobol indices, probabilities.

The samples' Gaussian process (`surrogate`) is integrated over the distributions. Sobol indices are
those of variables that may be correlated: first = Var E[y | x] / Var y, total = E Var[y | others] /
Var y (S. Kucherenko, S. Tarantola and P. Annoni, Comput. Phys. Commun. 183 (2012) 937, Eqs. 2.6 to
2.12), with the estimator of A. Janon et al., ESAIM: P&S 18 (2014) 342, Eq. 6, for the first. Errors
are 95 % ones of a jackknife: the same again without each eighth of the samples.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from dealib.design.distributions import Joint, scores
from dealib.design.surrogate import fit
from dealib.errors import NotConverged
from dealib.results.elements import Array

_POINTS = 2**14  # of the distributions that a process is evaluated at
_FEWER = 2**12  # of them, for errors
_GROUPS = 8
_SURE = 1.96  # deviations of a 95 % interval
TRUSTED = 0.9  # share of the variance below which intervals are those of the samples


@dataclass(frozen=True)
class Known:
    """What is known of a quantity, each number with the half width of its 95 % interval.

    Attributes:
        explained: See `Surrogate`.
        numbers: Mean, deviation and quantiles.
        first: Sobol indices by variable.
        total: Likewise.
    """

    explained: float
    numbers: dict[str, tuple[float, float]]
    first: dict[str, tuple[float, float]]
    total: dict[str, tuple[float, float]]


@dataclass(frozen=True)
class Probability:
    """Of an event, with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, among: int, count: float, low: float = -1, high: float = -1) -> Probability:
        """From how many of some points it happens at, and at how many at least and at most."""
        from scipy.stats import binomtest

        ends = [count if k < 0 else k for k in (low, high)]
        sure = [binomtest(int(k), among).proportion_ci(method="wilson") for k in ends]
        return cls(count / among, float(sure[0].low), float(sure[1].high))

    def or_(self, other: Probability) -> Probability:
        """Of this event, or of the other one, which this one knows nothing of."""
        pairs = ((self.value, other.value), (self.low, other.low), (self.high, other.high))
        return Probability(*(a + (1 - a) * b for a, b in pairs))


@dataclass(frozen=True)
class Samples:
    """Points of the distributions, and what was found there.

    Attributes:
        joint: The distributions.
        x: Points (n, variables).
        values: By quantity, (n,); NaN where a case has no result.
        seed: Of the points.
        levels: Of the quantiles, from 0 to 1.
    """

    joint: Joint
    x: Array
    values: Mapping[str, Array]
    seed: int = 0
    levels: tuple[float, ...] = (0.05, 0.5, 0.95)
    _cached: dict[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls,
        joint: Joint,
        model: Callable[[Array], Mapping[str, Array]],
        count: int,
        seed: int = 0,
        levels: Sequence[float] = (0.05, 0.5, 0.95),
    ) -> Samples:
        """Evaluate a model at points of the distributions.

        Args:
            joint: The distributions.
            model: Takes points (n, variables), gives quantities (n,).
            count: Number of points, a power of two.
            seed: Of their scrambling.
            levels: Of quantiles.
        """
        x = joint.of(scores(count, len(joint.names), seed))
        return cls(joint, x, model(x), seed, tuple(levels))

    @property
    def solved(self) -> Any:
        """Which points have a result."""
        return np.isfinite(list(self.values.values())).all(axis=0)

    @property
    def unsolved(self) -> Probability:
        """That there is no result."""
        return Probability.of(len(self.x), int((~self.solved).sum()))

    def known(self, name: str) -> Known:
        """What is known of a quantity.

        Raises:
            NotConverged: If too few samples have a result.
        """
        x, y, smooth = self._through(name)
        points, pairs = self._inside, self._pairs
        trusted = smooth.explained >= TRUSTED
        group = np.arange(len(y)) % _GROUPS

        def numbers(process: Any, kept: Any, count: int) -> Array:
            of = process.at(points[:count]) if trusted else y[kept]
            spread = of.std(ddof=0 if trusted else 1)
            some = pairs[:, :count]
            indices = _indices(process.at(some.reshape(-1, x.shape[1])).reshape(some.shape[:2]))
            return np.array([of.mean(), spread, *np.quantile(of, self.levels), *indices])

        best = numbers(smooth, group < _GROUPS, _POINTS)
        fewer = (smooth.without(x, y, group == k) for k in range(_GROUPS))
        again = [numbers(process, group != k, _FEWER) for k, process in enumerate(fewer)]
        error = _SURE * np.sqrt((_GROUPS - 1) * np.var(again, axis=0))
        names = ["mean", "deviation", *(f"q{100 * q:g}" for q in self.levels)]
        found = list(zip(best.tolist(), error.tolist(), strict=True))
        a, b = len(names), len(names) + len(self.joint.names)
        parts = ((names, found[:a]), (self.joint.names, found[a:b]), (self.joint.names, found[b:]))
        return Known(smooth.explained, *(dict(zip(*p, strict=True)) for p in parts))

    def above(self, name: str, bound: float = 0.0, sign: int = 1) -> Probability:
        """That a quantity is above a bound, or with the sign -1 below it, or has no result."""
        _, y, smooth = self._through(name)
        if smooth.explained >= TRUSTED:
            of, spread = smooth.at(self._inside), _SURE * smooth.spread(self._inside)
        else:
            of, spread = y, np.zeros(len(y))
        over = sign * (of - bound)
        counts = (int((over + k * spread > 0).sum()) for k in (0, -1, 1))
        return self._or_unsolved(Probability.of(len(of), *counts))

    def _or_unsolved(self, found: Probability) -> Probability:
        return self.unsolved.or_(found) if not self.solved.all() else found

    # --- points of the size of 1 -----------------------------------------------------------------

    def _plain(self, x: Array) -> Array:
        mean, deviation = self.joint.moments
        return (x - mean) / deviation

    def _once(self, what: str, make: Callable[[], Any]) -> Any:
        if what not in self._cached:
            self._cached[what] = make()
        return self._cached[what]

    def _through(self, name: str) -> tuple[Array, Array, Any]:
        """Solved samples, their values, and the process through them."""
        solved = self.solved
        if solved.sum() < max(_GROUPS, 2 * len(self.joint.names) + 2):
            raise NotConverged(f"only {solved.sum()} of {len(solved)} cases are solved: too few")
        x, y = self._plain(self.x[solved]), self.values[name][solved]
        return x, y, self._once(f"process {name}", lambda: fit(x, y))

    @property
    def _inside(self) -> Array:
        """Points of the distributions, without those whose nearest sample has no result."""

        def make() -> Array:
            from scipy.spatial import cKDTree

            every = self._plain(
                self.joint.of(scores(_POINTS, len(self.joint.names), self.seed + 1))
            )
            return np.asarray(every[self.solved[cKDTree(self._plain(self.x)).query(every)[1]]])

        return np.asarray(self._once("inside", make))

    @property
    def _pairs(self) -> Array:
        """Points in pairs that share one variable, or all the others, (4 a variable, n, ...)."""

        def make() -> Array:
            count = len(self.joint.names)
            z = scores(_POINTS, 2 * count, self.seed + 2)
            a, b = z[:, :count], z[:, count:]
            found = []
            for k in range(count):
                rest = [j for j in range(count) if j != k]
                same, own = np.hstack([a[:, :1], b[:, 1:]]), np.hstack([a[:, :-1], b[:, -1:]])
                found += [self.joint.of(s, [k, *rest]) for s in (a, same)]
                found += [self.joint.of(s, [*rest, k]) for s in (a, own)]
            return self._plain(np.array(found))

        return np.asarray(self._once("pairs", make))


def _indices(values: Array) -> Array:
    """First-order indices of all variables, then total ones, from values at the pairs."""
    a, b, c, d = (values[k::4] for k in range(4))
    mean = (a + b).mean(axis=1) / 2
    with np.errstate(all="ignore"):
        first = ((a * b).mean(axis=1) - mean**2) / ((a**2 + b**2).mean(axis=1) / 2 - mean**2)
        total = ((c - d) ** 2).mean(axis=1) / np.concatenate([c, d], axis=1).var(axis=1) / 2
    return np.nan_to_num(np.concatenate([first, total]))  # of a constant: none
