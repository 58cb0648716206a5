"""Functions that laws need beyond arithmetic, for UFL expressions and for numbers alike."""

from __future__ import annotations

from typing import Any

import numpy as np


def ln(x: Any) -> Any:
    """Natural logarithm of a UFL expression, or of (complex) numbers whose real part is positive.

    Elsewhere numbers give NaN: a complex step would take the jump of arg(x) for a derivative.
    """
    if hasattr(x, "ufl_shape"):
        import ufl

        return ufl.ln(x)
    x = np.asarray(x)
    valid = x.real > 0
    return np.where(valid, np.log(np.where(valid, x, 1.0)), np.nan * x)
