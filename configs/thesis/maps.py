"""Systematic maps around the identified device: what decides Figs. 31, 32 and 37."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from devices import (
    COUPLINGS,
    MASSES,
    VOLTS,
    Device,
    Parameters,
    Target,
    by_finite_elements,
    by_membrane,
    membranes,
)
from fitting import FITTED, Fit, fit
from quantities import strokes
from scipy.optimize import brentq
from windows import WINDOWS, Window

from dealib.units import EPSILON_0

PRESTRETCHES = (1.08, 1.11, 1.14, 1.17, 1.20)
LAWS = ("nh", "mr")
Table = tuple[list[str], list[list[str]]]  # head, rows


@dataclass(frozen=True)
class Maps:
    """All maps of a device.

    Attributes:
        by_prestretch: Pre-stretch x coupling x law, all else as identified.
        refitted: Pre-stretch x coupling, all else identified anew.
        by_coupling: Couplings x law, by finite elements.
        blocking: The blocking force against the growth of the capacitance.
        prestretch_200: See `larger_prestretch_of_200`.
    """

    by_prestretch: Table
    refitted: Table
    by_coupling: Table
    blocking: Table
    prestretch_200: tuple[float, float]

    @classmethod
    def of(cls, p: Parameters, jobs: int = 2) -> Maps:
        """Compute them, in some processes."""
        return cls(
            by_prestretch(p),
            refitted(p, jobs),
            by_coupling(p),
            blocking_by_capacitance(p),
            larger_prestretch_of_200(p),
        )


def direction(found: Sequence[float]) -> str:
    """How the strokes go as the mass grows."""
    falls = np.diff(found) < 0
    if falls.all():
        return "falls"
    if not falls.any():
        return "rises"
    return "falls, then rises" if falls[0] else "rises, then falls"


def _strokes(found: dict[str, float]) -> list[float]:
    return [found[f"stroke_{m:g}"] for m in MASSES]


def by_prestretch(p: Parameters) -> Table:
    """Pre-stretch x coupling x law, all else as identified (membrane)."""
    head = ["pre-stretch", "coupling", "law", "Maxwell stress / pre-stress", "strokes (mm)",
            "stroke", "slope (mm per 10 g)", "blocking, 2 mm (N)", "film alone, 3 mm (N)",
            "electrode / film S_rr"]  # fmt: skip
    rows = []
    for stretch in PRESTRETCHES:
        q = replace(p, prestretch=stretch)
        for coupling in COUPLINGS:
            solve = by_membrane(coupling)
            for law in LAWS:
                device = Device.of(q, law=law)
                alone = solve(Device.of(q, law=law, electrode_thickness=0.0), _push(3))[-1]
                held = solve(device, _push(2))[-1]
                driven = solve(device, [*_push(2), Target(u=2, V=VOLTS)])[-1]
                row = [f"{stretch:.2f}", coupling, law.upper(), f"{ratio(q, law):.2f}"]
                try:
                    found = _strokes(strokes(device, solve))
                except ArithmeticError:
                    row += ["the flat film buckles", "-", "-"]
                else:
                    slope = 10 * (found[-1] - found[0]) / (MASSES[-1] - MASSES[0])
                    row += [_list(found), direction(found), f"{slope:+.3f}"]
                row += [f"{held.F - driven.F:.3f}", f"{alone.F:.3f}"]
                rows.append([*row, f"{held.electrode_stress / held.radial_stress:.2f}"])
    return head, rows


def ratio(p: Parameters, law: str) -> float:
    """Maxwell stress eps (V/H)^2 over the film's radial stress, both flat at rest."""
    (flat,) = by_membrane()(Device.of(p, law=law), [Target(u=1e-3)])
    return EPSILON_0 * p.permittivity * (VOLTS / p.film_thickness) ** 2 / flat.radial_stress


def variants() -> dict[str, list[Window]]:
    """Windows by which coupling has to give Fig. 31; all other windows in each."""
    rest = [w for w in FITTED if w.figure != "31"]
    of = {
        by: [
            replace(w, fitted=True, hard=True)
            for w in WINDOWS
            if w.figure == "31" and w.quantity.endswith("_undeformed") == (by != "energy")
        ]
        for by in COUPLINGS
    }
    return {by: rest + of[by] for by in COUPLINGS}


def refitted(p: Parameters, jobs: int = 2) -> Table:
    """Pre-stretch x coupling for Fig. 31, all other parameters identified anew (membrane)."""
    head = ["pre-stretch", "Fig. 31 by", "misfit", "constraints missed"]
    cases = [(c, s) for c in COUPLINGS for s in PRESTRETCHES]
    with ProcessPoolExecutor(jobs) as pool:
        fits = list(pool.map(partial(_refit, p), *zip(*cases, strict=True)))
    return head, [
        [f"{s:.2f}", c, f"{f.misfit():.3g}", missed(f)]
        for (c, s), f in zip(cases, fits, strict=True)
    ]


def _refit(p: Parameters, coupling: str, stretch: float) -> Fit:
    """The fit with a given pre-stretch; the film starts with the same pre-tension."""

    def tension(s: float) -> float:
        return s**2 - s**-4

    share = np.clip(tension(p.prestretch) / tension(stretch), 0.75, 1.5)
    start = replace(p, prestretch=stretch, film_thickness=p.film_thickness * float(share))
    start = replace(start, permittivity=float(np.clip(p.permittivity * share, 2.1, 4.9)))
    return fit(
        membranes(),
        start,
        windows=variants()[coupling],  # type: ignore[index]
        fixed=["prestretch"],
        evaluations=12,
    )


def missed(f: Fit) -> str:
    """The constraints that a fit misses by more than 0.5 % of their width, with their values."""
    found = []
    for w in f.windows:
        value = f.values[w.quantity]
        if w.hard and w.printed(value) and abs(w.misfit(value)) > 0.005:
            found.append(f"Fig. {w.figure} {w.quantity} {value:.4g} ({w.low:.4g} .. {w.high:.4g})")
    return "; ".join(found) or "none"


def by_coupling(p: Parameters) -> Table:
    """All couplings of the package on the identified device (finite elements)."""
    head = ["coupling", "law", "strokes (mm)", "stroke", "blocking, 2 mm (N)"]
    rows = []
    for coupling in ("energy", "maxwell_traction", "pelrine", "pelrine_undeformed"):
        solve = partial(by_finite_elements, coupling=coupling)
        for law in LAWS:
            device = Device.of(p, law=law)
            found = _strokes(strokes(device, solve))
            held, driven = solve(device, [Target(u=2), Target(u=2, V=VOLTS)])
            rows.append([coupling, law.upper(), _list(found), direction(found),
                         f"{held.F - driven.F:.4f}"])  # fmt: skip
    return head, rows


def blocking_by_capacitance(p: Parameters) -> Table:
    """The blocking force at 2 mm against V^2/2 dC/du (finite elements)."""
    head = ["coupling", "blocking (N)", "V²/2 dC/du at 0 V (N)", "at 2.5 kV (N)"]
    rows = []
    for coupling in COUPLINGS:
        solve = partial(by_finite_elements, coupling=coupling)
        path = [Target(u=u, V=v) for v in (0.0, VOLTS) for u in (1.9, 2.0, 2.1)]
        low = solve(Device.of(p), path)
        slopes = [(low[k + 2].C - low[k].C) / 0.2 for k in (0, 3)]  # pF/mm
        work = [VOLTS**2 / 2 * s * 1e-3 for s in slopes]  # kV^2 nF/mm = N
        rows.append([coupling, f"{low[1].F - low[4].F:.4f}", *(f"{w:.4f}" for w in work)])
    return head, rows


def larger_prestretch_of_200(p: Parameters) -> tuple[float, float]:
    """The pre-stretch of DEAP200 that gives it the stress of DEAP100 at 2 mm, and the stress."""

    def stress(size: int, stretch: float) -> float:
        device = Device.of(replace(p, prestretch=stretch), size)
        return by_membrane()(device, _push(2))[-1].radial_stress

    same = stress(100, p.prestretch)
    return brentq(lambda s: stress(200, s) - same, p.prestretch, 1.5, xtol=1e-4), same


def _push(mm: float) -> list[Target]:
    return [Target(u=u) for u in np.linspace(0, mm, round(mm) + 1)[1:]]


def _list(values: Sequence[float]) -> str:
    return ", ".join(f"{v:.3f}" for v in values)
