"""Distributions of numbers of a config, and their correlations as a Gaussian copula."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from pydantic import Field, model_validator

from dealib.data.schema import Amount
from dealib.errors import ValueAt
from dealib.results.elements import Array
from dealib.section import Section
from dealib.units import convert

_GIVEN = {
    "normal": ("mean", "deviation"),
    "lognormal": ("mean", "deviation"),
    "uniform": ("min", "max"),
    "triangular": ("min", "mode", "max"),
}


class Spread(Section):
    """How a number scatters: `{mean, deviation}` is normal, `{min, max}` uniform."""

    mean: Amount | None = Field(None, description="such as '40 um'")
    deviation: Amount | None = Field(None, description="standard deviation; '3 %' is of the mean")
    min: Amount | None = Field(None, description="least value; of a normal one, where it is cut")
    max: Amount | None = Field(None, description="largest value; likewise")
    mode: Amount | None = Field(None, description="most likely value of a triangular one")
    distribution: Literal["normal", "lognormal", "uniform", "triangular"] | None = Field(
        None, description="default normal with a mean, triangular with a mode, else uniform"
    )

    @property
    def kind(self) -> str:
        """Name of the distribution."""
        if self.distribution is not None:
            return self.distribution
        return "normal" if self.mean else "triangular" if self.mode else "uniform"

    @model_validator(mode="after")
    def _complete(self) -> Spread:
        known, cut = _GIVEN[self.kind], ("min", "max") if self.kind == "normal" else ()
        for name in known:
            if getattr(self, name) is None:
                raise ValueError(f"a {self.kind} distribution needs {' and '.join(known)}")
        for name in ("mean", "deviation", "min", "max", "mode"):
            if getattr(self, name) is not None and name not in (*known, *cut):
                raise ValueAt((name,), f"is no key of a {self.kind} distribution")
        return self

    def of(self, unit: str) -> Any:
        """The distribution of `scipy.stats` in a unit.

        Raises:
            ValueAt: If a number cannot be had in the unit, or there is no such distribution.
        """
        from scipy import stats

        v: dict[str, float] = {}
        for name in ("mean", "deviation", "min", "mode", "max"):
            amount = getattr(self, name)
            if amount is None:
                continue
            try:
                relative = name == "deviation" and amount[1] == "%"
                v[name] = amount[0] / 100 * abs(v["mean"]) if relative else convert(amount, unit)
            except ValueError as error:
                raise ValueAt((name,), str(error)) from None
        if not v.get("deviation", 1.0) > 0:
            raise ValueAt(("deviation",), "must be above 0")
        low, high = v.get("min", -np.inf), v.get("max", np.inf)
        if not low < high:
            raise ValueAt(("max",), "must be above min")
        if self.kind == "uniform":
            return stats.uniform(low, high - low)
        if self.kind == "triangular":
            if not low <= v["mode"] <= high:
                raise ValueAt(("mode",), "must lie between min and max")
            return stats.triang((v["mode"] - low) / (high - low), low, high - low)
        m, s = v["mean"], v["deviation"]
        if self.kind == "normal":
            a, b = (low - m) / s, (high - m) / s
            if np.diff(stats.norm.cdf([a, b])) < 1e-6:
                raise ValueAt(("mean",), "hardly anything of it lies between min and max")
            return stats.truncnorm(a, b, m, s) if np.isfinite([a, b]).any() else stats.norm(m, s)
        if m <= 0:
            raise ValueAt(("mean",), "must be above 0 where the distribution is lognormal")
        wide = np.log1p((s / m) ** 2)
        return stats.lognorm(np.sqrt(wide), scale=m * np.exp(-wide / 2))


class Correlation(Section):
    """Of two variables: their coefficient in a Gaussian copula, which is that of normal ones."""

    between: tuple[str, str] = Field(description="keys of two variables")
    coefficient: float = Field(gt=-1, lt=1, description="from -1 to 1")


@dataclass(frozen=True)
class Joint:
    """Several variables.

    Attributes:
        names: Of them.
        distributions: Of each, frozen ones of `scipy.stats`.
        correlation: Matrix of the normal scores; None if they are independent.
    """

    names: tuple[str, ...]
    distributions: tuple[Any, ...]
    correlation: Array | None = None

    @property
    def matrix(self) -> Array:
        """The correlations of the normal scores."""
        return np.eye(len(self.names)) if self.correlation is None else self.correlation

    @cached_property
    def moments(self) -> tuple[Array, Array]:
        """Means and deviations."""
        return tuple(np.array([m(d) for d in self.distributions]) for m in (_mean, _std))  # type: ignore[return-value]

    def of(self, scores: Array, order: Sequence[int] | None = None) -> Array:
        """Values at independent normal scores, (n, variables).

        Args:
            scores: One column a variable, in the order given: a variable depends on the scores of
                those before it, and on its own.
            order: Of the variables; default as they are.
        """
        order = list(range(len(self.names)) if order is None else order)
        from scipy.special import ndtr

        found = np.empty_like(scores)
        found[:, order] = scores @ np.linalg.cholesky(self.matrix[np.ix_(order, order)]).T
        share = np.clip(ndtr(found), 1e-15, 1 - 1e-15)
        return np.stack([d.ppf(share[:, k]) for k, d in enumerate(self.distributions)], axis=1)


def _mean(distribution: Any) -> float:
    return float(distribution.mean())


def _std(distribution: Any) -> float:
    return float(distribution.std())


def scores(count: int, dimension: int, seed: int) -> Array:
    """Independent normal scores, (count, dimension), by a scrambled Sobol sequence.

    Args:
        count: A power of two.
        dimension: Of the sequence; the first points are those of a shorter one.
        seed: Of the scrambling.
    """
    from scipy.special import ndtri
    from scipy.stats import qmc

    points = qmc.Sobol(dimension, scramble=True, seed=seed).random_base2(count.bit_length() - 1)
    return np.asarray(ndtri(np.clip(points, 1e-12, 1 - 1e-12)))
