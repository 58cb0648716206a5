"""Start values of a candidate: moduli by linear least squares, other parameters by trial."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.optimize import brentq, least_squares, lsq_linear

from dealib.arrays import Array
from dealib.calibration.candidates import Candidate
from dealib.calibration.coupon_data import STRESS, TIME, CouponTest
from dealib.calibration.task import Free, Values
from dealib.errors import NotConverged
from dealib.materials import coupon
from dealib.materials.law import invariants_of_stretches

_OGDEN: dict[int, list[tuple[float, ...]]] = {
    1: [(2.0,), (4.0,), (-2.0,)],
    2: [(2.0, -2.0), (1.3, 5.0), (2.0, 8.0)],
    3: [(1.3, 5.0, -2.0), (2.0, 4.0, -2.0)],
    4: [(1.3, 5.0, -2.0, 8.0)],
}


def starts(
    candidate: Candidate, specimens: Sequence[CouponTest], near: Values
) -> list[dict[str, Free]]:
    """Start values of searches, the best first.

    The stress is linear in the moduli, so that these are eliminated. The other parameters are
    searched for from several values (variable projection; G. H. Golub, V. Pereyra, SIAM J. Numer.
    Anal. 10, 413-432, 1973).

    Args:
        candidate: The candidate to fit.
        specimens: The tests.
        near: Parameters of a similar candidate, such as relaxation times.
    """
    found: list[tuple[float, dict[str, Free]]] = []
    for shapes, times in itertools.product(
        _shapes(candidate, specimens), _times(candidate, specimens, near)
    ):
        error, values = _projected(candidate, specimens, shapes | times)
        if not np.isfinite(error):
            continue
        for soft in _softening(candidate, specimens, values):
            tried = values | soft
            squares = error if not soft else _squares(candidate, specimens, tried)
            found.append((squares, _free(candidate, specimens, tried)))
    return [free for _, free in sorted(found, key=lambda pair: pair[0])]


def _shapes(candidate: Candidate, specimens: Sequence[CouponTest]) -> Iterator[Values]:
    """Values of the law's other parameters: exponents, or limits above the largest stretch."""
    if candidate.terms:
        for exponents in _OGDEN[candidate.terms]:
            yield {f"alpha.{k}": a for k, a in enumerate(exponents)}
        return
    limits = {name: limit(candidate, name, specimens) for name in candidate.shapes}
    for factors in itertools.product((1.05, 1.3, 2.0, 6.0), repeat=len(limits)):
        yield {n: f * v for (n, v), f in zip(limits.items(), factors, strict=True)}


def limit(candidate: Candidate, name: str, specimens: Sequence[CouponTest]) -> float:
    """The value of a limit parameter at which the law locks at the largest stretch of the tests."""
    if not candidate.law.locks:  # not a limit: start near the example of the schema
        return float((candidate.law.model_fields[name].examples or [1.0])[0]) / 10
    p = dict.fromkeys(candidate.moduli, 1.0)
    found = 1e-6
    for s in specimens:
        exponent, _ = coupon.MODES[s.path.mode]
        l = s.path.stretch
        i = invariants_of_stretches(l, l**exponent, l ** (-1 - exponent))

        def left(value: float, i: Any = i) -> float:
            used = candidate.law.extension(i, SimpleNamespace(**p, **{name: value}))
            return 1 - float(np.max(used))

        found = max(found, float(brentq(left, 1e-6, 1e6, xtol=1e-9, rtol=1e-9)))
    return found


def _span(specimens: Sequence[CouponTest]) -> tuple[float, float]:
    """Shortest and longest times in the tests, s."""
    times = [s.path.time[np.isfinite(s.path.time)] for s in specimens]
    long = [float(t[-1]) for t in times if len(t) > 1]
    short = [
        float(np.diff(s.measured.columns[TIME]).min()) if s.measured.x == TIME else end / 50
        for s, end in zip([s for s in specimens if np.isfinite(s.path.time[-1])], long, strict=True)
    ]
    return min(short, default=1.0), max(long, default=1.0)


def _times(candidate: Candidate, specimens: Sequence[CouponTest], near: Values) -> Iterator[Values]:
    n = candidate.branches
    keys = [f"branches.{k}.relaxation_time" for k in range(n)]
    if n == 0 or all(key in near for key in keys):
        yield {key: near[key] for key in keys}
        return
    low, high = np.log(_span(specimens))
    for a, b in ((0.1, 0.9), (0.4, 0.9)) if n > 1 else ((0.3, 0.3), (0.7, 0.7)):
        times = np.exp(low + (high - low) * np.linspace(a, b, n))
        yield dict(zip(keys, times.tolist(), strict=True))


def _projected(
    candidate: Candidate, specimens: Sequence[CouponTest], given: Values
) -> tuple[float, Values]:
    """Best parameters without softening near given shapes and times, and the sum of squares."""
    free = {key: f for key, f in _free(candidate, specimens, given).items() if key in given}

    def outer(q: Array) -> Values:
        return {key: f.outer(number) for (key, f), number in zip(free.items(), q, strict=True)}

    def residuals(q: Array) -> Array:
        return _linear(candidate, specimens, [outer(q)])[0][0]

    def jacobian(q: Array) -> Array:
        moved = [outer(q), *(outer(q + step) for step in 1e-5 * np.eye(len(q)))]
        base, *others = (r for r, _ in _linear(candidate, specimens, moved))
        return np.column_stack([(other - base) / 1e-5 for other in others])

    q = np.array([f.inner(f.start) for f in free.values()])
    if not np.isfinite(residuals(q)).all():
        return np.inf, {}
    if len(q):
        ranges = np.array([f.range for f in free.values()]).T
        q = least_squares(residuals, q, jacobian, ranges, ftol=1e-4, xtol=1e-4, max_nfev=40).x
    r, values = _linear(candidate, specimens, [outer(q)])[0]
    return float(r @ r), values


def _linear(
    candidate: Candidate, specimens: Sequence[CouponTest], sets: Sequence[Values]
) -> list[tuple[Array, Values]]:
    """Residuals of the best moduli at given shapes and times, and all values."""
    branches = [f"branches.{k}.shear_modulus" for k in range(candidate.branches)]
    names = candidate.moduli + branches
    bare = replace(candidate, mullins=False, set=False)
    hard = replace(bare, branches=0)
    times = sorted({v for given in sets for k, v in given.items() if k.endswith("time")})
    columns: list[list[Array]] = [[] for _ in sets]
    data = []
    for s in specimens:
        scale = s.weight / s.sigma[STRESS]
        data.append(scale * s.measured.columns[STRESS])
        units = coupon.networks(s.path, candidate.evolution, times)
        for given, rows in zip(sets, columns, strict=True):
            ones = [given | dict.fromkeys(candidate.moduli, 0.0) | {n: 1.0} for n in hard.moduli]
            laws = coupon.stresses(s.path, [hard.material(one) for one in ones])
            own = [units[given[b.replace("shear_modulus", "relaxation_time")]] for b in branches]
            factor = 1e-3 if candidate.unit == "kPa" else 1.0
            rows.append(scale * s.at_points(np.stack([*laws, *(factor * u for u in own)])))
    b = np.concatenate(data)
    low = [0.0 if candidate.positive(name) else -np.inf for name in names]
    out = []
    for given, rows in zip(sets, columns, strict=True):
        A = np.concatenate(rows, axis=1).T
        if not np.isfinite(A).all():
            out.append((np.full(len(b), np.inf), given))
            continue
        x = lsq_linear(A, b, (low, np.inf), method="bvls").x
        least = 1e-3 * float(np.max(np.abs(x)))  # their logarithms are searched for from here
        moduli = np.where((x < least) & (np.array(low) == 0), least, x)
        out.append((A @ x - b, given | dict(zip(names, moduli.tolist(), strict=True))))
    return out


def _squares(candidate: Candidate, specimens: Sequence[CouponTest], values: Values) -> float:
    histories = candidate.solve(specimens, [values])[0]
    off = [
        np.array([np.inf]) if isinstance(h, NotConverged) else s.weight * s.residual(h)
        for s, h in zip(specimens, histories, strict=True)
    ]
    return float(sum(r @ r for r in off))


def _peak(candidate: Candidate, specimens: Sequence[CouponTest], values: Values) -> float:
    """Largest energy density of the law in the tests, in `unit`."""
    p = candidate.material(values | _neutral(candidate)).p
    W = [coupon.energy(candidate.law, p, s.path.mode, s.path.stretch)[0].max() for s in specimens]
    return max(W) * (1e3 if candidate.unit == "kPa" else 1.0)


def _neutral(candidate: Candidate) -> Values:
    found = {"mullins.r": 2.0, "mullins.m": 1.0} if candidate.mullins else {}
    more = {"permanent_set.shear_modulus": 1.0, "permanent_set.energy": 1.0}
    return found | (more if candidate.set else {})


def _softening(
    candidate: Candidate, specimens: Sequence[CouponTest], values: Values
) -> Iterator[Values]:
    if not (candidate.mullins or candidate.set):
        yield {}
        return
    peak = abs(_peak(candidate, specimens, values))
    size = sum(abs(values[name]) for name in candidate.moduli)
    for r, m in itertools.product((1.5, 3.0), (0.1, 0.5)) if candidate.mullins else ((0, 0),):
        soft = {"mullins.r": r, "mullins.m": m * peak} if candidate.mullins else {}
        if candidate.set:
            soft |= {"permanent_set.shear_modulus": 0.2 * size, "permanent_set.energy": 0.3 * peak}
        yield soft


def _free(candidate: Candidate, specimens: Sequence[CouponTest], values: Values) -> dict[str, Free]:
    """The parameters with their bounds."""
    size = sum(abs(v) for k, v in values.items() if k in candidate.moduli or "shear" in k)
    short, long = _span(specimens)
    found, law = {}, [*candidate.moduli, *candidate.shapes]
    for key in [k for k in law if k in values] + sorted(set(values) - set(law)):
        value = values[key]
        if key.startswith("alpha"):
            found[key] = Free("", value, -25.0, 25.0)
        elif key in candidate.shapes:
            locks = limit(candidate, key, specimens)
            found[key] = Free("", value, 1.0001 * locks, 1e3 * locks, log=True)
        elif key == "mullins.r":
            found[key] = Free("", value, 1.0, 1e3, log=True)
        elif key.endswith("relaxation_time"):
            found[key] = Free("s", value, short / 10, long * 10, log=True)
        elif key in candidate.moduli and not candidate.positive(key):
            found[key] = Free(candidate.unit, value)
        else:
            found[key] = Free(candidate.unit, value, 1e-5 * size, 1e4 * size, log=True)
    return found
