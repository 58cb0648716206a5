"""The coupon fit: candidates are fitted, compared by a criterion, and the best one is written."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dealib.calibration import coupon_result as result
from dealib.calibration.candidates import Candidate
from dealib.calibration.coupon_data import STRESS, STRETCH, TIME, CouponPlan
from dealib.calibration.report import Fitted, Table, failures
from dealib.calibration.search import blind, search
from dealib.calibration.starts import starts
from dealib.calibration.task import FitResult, Free, Task, Values
from dealib.errors import ConfigError
from dealib.materials import coupon
from dealib.materials.laws import LAWS
from dealib.materials.response import stability_limit

_TRIED = 2  # searches for each candidate, from its best starts


@dataclass(frozen=True)
class Tried:
    """A fitted candidate.

    Attributes:
        candidate: The candidate.
        found: Result of its search.
        stable: Stretch up to which the law is stable in all modes.
        failed: Reasons why it cannot be chosen; empty if it can.
    """

    candidate: Candidate
    found: FitResult
    stable: float
    failed: list[str]


def criterion(found: FitResult, kind: str, points: float) -> float:
    """Information criterion of a fit for noise of unknown size; the smaller the better.

    AICc: N. Sugiura, Commun. Stat. A 7, 13-26 (1978); BIC: G. Schwarz, Ann. Stat. 6, 461-464
    (1978). Correlated points count for less: quasi-likelihood, as in K. P. Burnham, D. R. Anderson,
    Model Selection and Multimodel Inference (2002), section 2.5.

    Args:
        found: The fit.
        kind: AICc or BIC.
        points: Number of independent points.
    """
    n, k = found.points, len(found.estimates) + 1  # the size of the noise is a parameter too
    likelihood = points * np.log(found.sum_of_squares / n)
    if kind == "BIC":
        return float(likelihood + k * np.log(n))
    return float(likelihood + 2 * k + 2 * k * (k + 1) / (n - k - 1)) if n > k + 1 else np.inf


def run_coupon(plan: CouponPlan, progress: Callable[[str], None]) -> Fitted:
    """Fit the material.

    Args:
        plan: The fit.
        progress: Called with one line for each candidate.

    Raises:
        ConfigError: If no candidate can be fitted.
    """
    wanted, method = plan.coupon.material, plan.coupon.method
    fits: list[Tried] = []

    def fit(candidates: Sequence[Candidate]) -> Tried:
        known = {f.candidate for f in fits}
        for candidate in candidates:
            near = [f.found.values for f in fits if f.candidate.branches == candidate.branches]
            if candidate in known:
                continue
            if (found := _fit(plan, candidate, near[-1] if near else {})) is not None:
                fits.append(found)
                rmse = np.sqrt(found.found.sum_of_squares / found.found.points)
                progress(f"{candidate.label:<48} {rmse:.4g} standard deviations")
        if not fits:
            raise ConfigError(f"{plan.source.path}: too few points for any of these laws")
        # laws are not judged by whether a branch too many is determined: a later stage removes it
        stable = [f for f in fits if f.stable >= use(plan)] or fits
        n = independent(fits)
        return min(stable, key=lambda f: criterion(f.found, method.criterion, n))

    peak = max(np.max(np.abs(s.measured.columns[STRESS])) for s in plan.specimens)
    full = Candidate(
        LAWS["neo_hookean"], 0, max(wanted.branches), wanted.evolution, bool(wanted.mullins),
        bool(wanted.permanent_set), "kPa" if peak < 0.5 else "MPa",
    )  # fmt: skip
    laws = [
        replace(full, law=LAWS[name], terms=terms)
        for name in dict.fromkeys(wanted.laws)
        for terms in (range(1, wanted.ogden_terms + 1) if name == "ogden" else (0,))
    ]
    best = fit(laws).candidate
    best = fit([replace(best, branches=n) for n in wanted.branches]).candidate
    best = fit([replace(law, branches=best.branches) for law in laws]).candidate
    if wanted.mullins == "auto":
        best = fit([replace(best, mullins=False)]).candidate
    if wanted.permanent_set == "auto":
        best = fit([replace(best, set=False)]).candidate
    return _fitted(plan, ranked(fits, method.criterion), len(fits))


def ranked(fits: list[Tried], kind: str) -> list[Tried]:
    """Fits by their criterion, those that can be chosen first."""
    n = independent(fits)
    return sorted(fits, key=lambda f: (bool(f.failed), criterion(f.found, kind, n)))


def independent(fits: list[Tried]) -> float:
    """Effective number of independent points, from the residuals of the closest fit."""
    closest = min(fits, key=lambda f: f.found.sum_of_squares).found
    return sum(n.points for noise in closest.noise for n in noise)


def _fit(plan: CouponPlan, candidate: Candidate, near: Values) -> Tried | None:
    method = plan.coupon.method
    solve = functools.partial(candidate.solve, plan.specimens)
    points = sum(len(s.measured.columns[STRESS]) for s in plan.specimens)
    best: FitResult | None = None
    for free in starts(candidate, plan.specimens, near)[:_TRIED]:
        if len(free) + 2 >= points:
            return None
        task = Task(
            free, plan.specimens, solve, 1e-5, 1e-6, method.max_evaluations, method.confidence,
            "linear",
        )  # fmt: skip
        found = search(task)
        if best is None or found.sum_of_squares < best.sum_of_squares:
            best = found
    if best is None:
        return None
    stable, reach = stability(candidate, best), use(plan)
    failed = failures(best)
    if stable < reach:
        failed.append(f"The law is stable only up to a stretch of {stable:.4g}.")
    return Tried(candidate, best, stable, failed)


def use(plan: CouponPlan) -> float:
    """Stretch up to which the law must be stable."""
    largest = max(float(s.path.stretch.max()) for s in plan.specimens)
    return plan.coupon.material.stretch_max or largest


def stability(candidate: Candidate, found: FitResult) -> float:
    """Stretch up to which the law alone is stable in all modes (see `stability_limit`)."""
    return min(stability_limit(candidate.fitted(found.values), mode) for mode in coupon.MODES)


def _fitted(plan: CouponPlan, fits: list[Tried], number: int) -> Fitted:
    """The best candidate, fitted again to a smaller tolerance, with intervals and report."""
    best = fits[0]
    start = replace(best.found.task, intervals=plan.coupon.method.intervals, tolerance=1e-9)
    free = _in_order(best.candidate, start.free, best.found.values)
    found = search(replace(start, free=free))
    values = result.material(plan, best.candidate, found)
    notes = _notes(plan, replace(best, found=found), fits[1:], number)
    if said := result.complaint(values):
        notes.append(f"A config does not take this material: {said}.")
    return Fitted(
        plan.coupon.name,
        plan.coupon.description,
        found,
        blind(start),
        notes,
        {"Laws": _table(fits, plan.coupon.method.criterion)},
        {"material.yaml": result.as_config(plan, values)},
        functools.partial(_draw, plan, best.candidate, found),
        result.entry(plan, best.candidate, values),
    )


def _in_order(candidate: Candidate, free: dict[str, Free], values: Values) -> dict[str, Free]:
    """Parameters that start at given values, with the branches from fast to slow."""
    pairs = sorted(
        [values[f"branches.{k}.{name}"] for name in ("relaxation_time", "shear_modulus")]
        for k in range(candidate.branches)
    )
    for k, (time, modulus) in enumerate(pairs):
        own = {f"branches.{k}.relaxation_time": time, f"branches.{k}.shear_modulus": modulus}
        values = values | own
    return {key: replace(f, start=values[key]) for key, f in free.items()}


def _table(fits: list[Tried], kind: str) -> Table:
    n = independent(fits)
    values = [criterion(f.found, kind, n) for f in fits]
    rows: list[Sequence[str]] = []
    for f, value in zip(fits, values, strict=True):
        rmse = float(np.sqrt(f.found.sum_of_squares / f.found.points))
        stable = "10 and more" if f.stable > 10 else f"{f.stable:.4g}"
        cells = (f"{rmse:.4g}", f"{value - values[0]:+.1f}", stable)
        rows.append((f.candidate.label, str(len(f.found.estimates)), *cells, " ".join(f.failed)))
    head = ("law", "parameters", "RMSE / sigma", f"{kind} - best", "stable to stretch", "why not")
    return head, rows


def _notes(plan: CouponPlan, best: Tried, others: list[Tried], number: int) -> list[str]:
    wanted, kind = plan.coupon.material, plan.coupon.method.criterion
    said = [f"{best.candidate.label} is the best of {number} candidates by {kind}."]
    n = independent([best, *others])
    value = criterion(best.found, kind, n)
    closer = [f for f in others if f.failed and criterion(f.found, kind, n) < value]
    said += [f"{f.candidate.label} is closer, but: {' '.join(f.failed)}" for f in closer]
    if wanted.bulk_modulus is None:
        said.append("The bulk modulus is 1000 shear moduli: these tests say nothing about it.")
    still = [s.title for s in plan.specimens if not np.isfinite(s.path.time[-1])]
    if still and best.candidate.branches:
        said.append(f"Without time or rate {', '.join(still)} counts as infinitely slow.")
    if best.candidate.mullins or best.candidate.set or best.candidate.branches:
        found = [
            s.title
            for s, test in zip(plan.specimens, plan.coupon.tests, strict=True)
            if s.sigma.get(STRETCH) and not test.path and len(np.unique(s.first)) > 1
        ]
        if found:
            said.append(
                f"Where {', '.join(found)} turns was taken from noisy data, which is not in the "
                "intervals: give its path as it was programmed."
            )
    if best.candidate.mullins or best.candidate.set:
        said.append(
            "Softening and set are parts of this fit, not yet of a device: material.yaml tells "
            "them in comments."
        )
    return said


def _draw(plan: CouponPlan, candidate: Candidate, found: FitResult, picture: Path) -> None:
    from dealib.plots.coupon import CouponCurve, draw_coupon

    unit = candidate.unit
    scale = 1e3 if unit == "kPa" else 1.0
    curves, clocks = [], any(np.isfinite(s.path.time[-1]) for s in plan.specimens)
    for s, comparisons in zip(plan.specimens, found.comparisons, strict=True):
        c = comparisons[0]
        (stress,) = coupon.stresses(s.path, [candidate.material(found.values)])
        timed = c.x_name == TIME
        along = s.path.time if timed else s.path.stretch
        panel = f"{s.path.mode}, over time" if timed else s.path.mode
        if clocks and not np.isfinite(s.path.time[-1]):
            panel += ", infinitely slow"
        off = scale * (c.computed - c.measured)
        x_label = "Time (s)" if timed else "Stretch"
        label = f"{Path(s.title).name}, R² {c.r2:.4f}"
        path = np.stack([along, scale * stress])
        curves.append(CouponCurve(panel, label, x_label, c.x, scale * c.measured, off, path))
    draw_coupon(curves, f"{plan.coupon.name}: {candidate.label}", unit, picture)
