"""What the largest energy so far does to an elastomer: Mullins softening and permanent set.

Both know the history by one number, W_max, the largest value of the law's energy density W at a
point. Softening scales the law's stress; set is a second network whose chains re-form.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from dealib.materials.functions import erf
from dealib.units import Stress


class Mullins(BaseModel):
    """Softening of the law below the largest energy so far: W becomes eta W + phi(eta).

    R. W. Ogden, D. G. Roxburgh, Proc. R. Soc. Lond. A 455, 2861-2877 (1999).
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    r: float = Field(ge=1, description="1 - 1/r is what is left of the stress at most")
    m: Stress = Field(gt=0, description="energy density at which softening sets in (MPa = mJ/mm3)")


class PermanentSet(BaseModel):
    """A second network that breaks and re-forms in the state of stretch while W_max grows.

    A. V. Tobolsky's theory of two networks with the evolution of a transient network,
    d(C_i^-1)/dz = C^-1 - C_i^-1, whose clock is z = W_max / energy in place of time.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    shear_modulus: Stress = Field(gt=0, description="of the network that re-forms")
    energy: Stress = Field(gt=0, description="growth of W_max in which it re-forms (mJ/mm3)")


def softening(W: Any, W_max: Any, p: Any) -> Any:
    """Factor eta on the law's stress.

    Args:
        W: Energy density of the law: a UFL expression, or numbers.
        W_max: Its largest value so far, at least W.
        p: Parameters r and m.
    """
    return 1 - erf((W_max - W) / p.m) / p.r


def dissipated(W_max: Any, p: Any) -> Any:
    """Energy density lost to softening since the virgin state: the integral of 1 - eta over W."""
    x = W_max / p.m
    return p.m / p.r * (x * erf(x) - (1 - np.exp(-(x**2))) / np.sqrt(np.pi))
