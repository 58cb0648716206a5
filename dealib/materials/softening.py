"""Mullins softening and permanent set, which follow from the largest energy density so far.

Both describe the history by one number, W_max, the largest value of the law's energy density W at a
point. Softening scales the law's stress; permanent set is a second network whose chains re-form.
"""

from __future__ import annotations

from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from dealib.arrays import Array
from dealib.materials.evolution import EVOLUTIONS, inverted, unimodular
from dealib.materials.functions import erf, exp, positive
from dealib.materials.law import Invariants, Law
from dealib.section import Section
from dealib.units import Stress

_PIECES = 16  # into which the path between two states is divided


class Mullins(Section):
    """Softening of the law below the largest energy so far: W becomes eta W + phi(eta).

    R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. Lond. A 455, 2861-2877 (1999).
    """

    r: float = Field(ge=1, description="r: the stress falls at most to 1 - 1/r of that of the law")
    m: Stress = Field(
        gt=0, description="m: energy density at which softening sets in (MPa = mJ/mm3)"
    )


class PermanentSet(Section):
    """A second network that breaks and re-forms in the state of stretch while W_max grows.

    A. V. Tobolsky's theory of two networks with the evolution of a transient network,
    d(C_i^-1)/dz = C^-1 - C_i^-1, whose clock is z = W_max / energy in place of time.
    """

    evolution: ClassVar[Literal["network"]] = "network"

    shear_modulus: Stress = Field(gt=0, description="shear modulus of the network that re-forms")
    energy: Stress = Field(
        gt=0, description="growth of W_max over which the network re-forms (mJ/mm3)"
    )


def softening(W: Any, W_max: Any, p: Any) -> Any:
    """Factor eta on the law's stress.

    Args:
        W: Energy density of the law without its volumetric part.
        W_max: Its largest value before; W where W exceeds it.
        p: Parameters r and m.
    """
    return 1 - erf(positive(W_max - W) / p.m) / p.r


def withheld(W: Any, W_max: Any, p: Any) -> Any:
    """Reduction of the law's energy density by softening: W less the integral of eta over W.

    Arguments are UFL expressions or numbers, as for `softening`. At W = W_max it is the energy
    dissipated since the virgin state.
    """
    return p.m / p.r * (_integral(W_max / p.m) - _integral(positive(W_max - W) / p.m))


def _integral(x: Any) -> Any:
    """Integral of the error function from 0 to x, up to a constant."""
    return x * erf(x) + exp(-(x**2)) / np.pi**0.5


def energy(law: Law, C: Array) -> Array:
    """Energy density of a law without its volumetric part, MPa.

    Args:
        law: The law.
        C: Isochoric metric, packed (see `materials.evolution`), (..., components).
    """
    i = Invariants(C[..., :3].sum(-1), inverted(C)[..., :3].sum(-1), 1.0, C[..., 2])
    if C.shape[-1] > 4 and C[..., 4:].any():  # the third axis is no principal direction
        i = Invariants(i.I1, i.I2, 1.0, None)
    return np.asarray(law.isochoric_energy(i, law.values)) + np.zeros(C.shape[:-1])


def path(
    law: Law, given: PermanentSet | None, start: Array, end: Array, inner: Array, peak: Array
) -> tuple[Array, Array]:
    """W_max and C_i of the second network after a straight path from one metric to another.

    Args:
        law: The law, whose energy is the clock.
        given: The second network; None if there is none.
        start: Isochoric metric at the start, packed, (..., components).
        end: The same at the end.
        inner: C_i at the start.
        peak: W_max at the start, (...).
    """
    pieces = _PIECES if given is not None else 1
    before = start
    for share in np.arange(1, pieces + 1) / pieces:
        C = unimodular(start + share * (end - start))
        W = np.maximum(peak, energy(law, C))
        if given is not None:
            rule = EVOLUTIONS[given.evolution]
            inner = rule.end(*rule.step(before, inner, (W - peak) / given.energy), C)
        before, peak = C, W
    return peak, inner
