"""Distributions of the numbers of a config, with correlations by a Gaussian copula."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from pydantic import Field

from dealib.arrays import Array
from dealib.data.schema import Amount
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import convert

_NEEDED = {
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "uniform": ("min", "max"),
    "triangular": ("min", "mode", "max"),
}


class Spread(Section):
    """Distribution of a number: `{mean, deviation}` is normal, `{min, max}` uniform."""

    mean: Amount | None = Field(
        None, description="mean, such as '40 um'; default the value of the base"
    )
    deviation: Amount | None = Field(
        None, description="standard deviation; '3 %' is a share of the mean"
    )
    min: Amount | None = Field(
        None, description="lower bound; a normal distribution is truncated there"
    )
    max: Amount | None = Field(
        None, description="upper bound; a normal distribution is truncated there"
    )
    mode: Amount | None = Field(None, description="most likely value of a triangular distribution")
    distribution: Literal["normal", "lognormal", "uniform", "triangular"] | None = Field(
        None,
        description="kind of distribution; default normal if there is a mean or a deviation, "
        "triangular if there is a mode, otherwise uniform",
    )

    @property
    def kind(self) -> str:
        """Name of the distribution."""
        normal = self.mean is not None or self.deviation is not None
        usual = "normal" if normal else "triangular" if self.mode is not None else "uniform"
        return self.distribution or usual

    @property
    def scatters(self) -> bool:
        """Whether a distribution is given, instead of bounds alone."""
        return self.distribution is not None or self.kind != "uniform"

    def of(self, unit: str, usual: float) -> Any:
        """The distribution as an object of `scipy.stats`.

        Args:
            unit: Unit of its values.
            usual: Mean if none is given.

        Raises:
            ValueAt: If a key is missing or superfluous, or the values contradict each other.
        """
        from scipy import stats

        kind, v = self.kind, {"mean": usual, "min": -np.inf, "max": np.inf}
        for name in ("mean", "deviation", "min", "mode", "max"):
            amount, needed = getattr(self, name), name in _NEEDED[kind]
            if amount is None and needed and name != "mean":
                raise ValueAt((), f"a {kind} distribution needs {name}")
            if amount is None:
                continue
            if not needed and (kind != "normal" or name == "mode"):
                raise ValueAt((name,), f"is not a key of a {kind} distribution")
            try:
                of_mean = name == "deviation" and amount[1] == "%"
                v[name] = amount[0] / 100 * abs(v["mean"]) if of_mean else convert(amount, unit)
            except ValueError as error:
                raise ValueAt((name,), str(error)) from None
        m, low, high, s, mode = v["mean"], v["min"], v["max"], v.get("deviation"), v.get("mode")
        if not low < high:
            raise ValueAt(("max",), "must be above min")
        if mode is not None:
            if not low <= mode <= high:
                raise ValueAt(("mode",), "must lie between min and max")
            return stats.triang((mode - low) / (high - low), low, high - low)
        if s is None:
            return stats.uniform(low, high - low)
        if s <= 0:
            raise ValueAt(("deviation",), "must be above 0")
        if kind == "lognormal":
            if m <= 0:
                raise ValueAt(("mean",), "must be above 0 in a lognormal distribution")
            wide = np.log1p((s / m) ** 2)
            return stats.lognorm(np.sqrt(wide), scale=m * np.exp(-wide / 2))
        ends = (np.array([low, high]) - m) / s
        if np.diff(stats.norm.cdf(ends)) < 1e-6:
            raise ValueAt((), "has a probability of nearly 0 between min and max")
        return stats.truncnorm(*ends, m, s) if np.isfinite(ends).any() else stats.norm(m, s)


class Correlation(Section):
    """Correlation of two variables: their coefficient in a Gaussian copula."""

    between: tuple[str, str] = Field(description="keys of two variables")
    coefficient: float = Field(
        gt=-1,
        lt=1,
        description="correlation coefficient, between -1 and 1; that of the variables themselves "
        "if both are normal",
    )


@dataclass(frozen=True)
class Joint:
    """The joint distribution of several variables.

    Attributes:
        names: Names of the variables.
        distributions: Distribution of each, an object of `scipy.stats`.
        correlation: Correlation matrix of their normal scores, (variables, variables).
    """

    names: tuple[str, ...]
    distributions: tuple[Any, ...]
    correlation: Array

    @property
    def means(self) -> Array:
        """Mean of each variable."""
        return np.array([d.mean() for d in self.distributions])

    @property
    def deviations(self) -> Array:
        """Standard deviation of each variable."""
        return np.array([d.std() for d in self.distributions])

    def of(self, scores: Array, order: Sequence[int] | None = None) -> Array:
        """Values of the variables, (n, variables).

        Args:
            scores: Independent normal scores, (n, variables). The value of a variable depends on
                its own score and on those before it.
            order: Numbers of the variables in the order of the scores; default 0, 1, ...
        """
        from scipy.special import ndtr

        order = list(range(len(self.names))) if order is None else list(order)
        found = np.empty_like(scores)
        found[:, order] = scores @ np.linalg.cholesky(self.correlation[np.ix_(order, order)]).T
        shares = np.clip(ndtr(found), 1e-15, 1 - 1e-15).T
        return np.stack([d.ppf(u) for d, u in zip(self.distributions, shares, strict=True)], 1)


def scores(count: int, dimension: int, seed: int) -> Array:
    """Independent normal scores, (count, dimension), by a scrambled Sobol sequence.

    Args:
        count: Number of points, a power of two; a larger set begins with the smaller one.
        dimension: Number of variables.
        seed: Seed of the scrambling.
    """
    from scipy.special import ndtri
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, scramble=True, seed=seed).random_base2(count.bit_length() - 1)
    return np.asarray(ndtri(np.clip(points, 1e-12, 1 - 1e-12)))
