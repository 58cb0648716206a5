"""Windows of a study: ranges in which values are expected, compared with those computed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array
from dealib.study.schema import Axis, Window

_ROUNDING = 1e-6  # tolerance at the edges of a window, as a share of its width


@dataclass(frozen=True)
class Verdict:
    """Comparison of a window with computed values.

    Attributes:
        window: The window.
        smallest: Smallest value; NaN without values.
        largest: Largest value; NaN without values.
    """

    window: Window
    smallest: float
    largest: float

    @property
    def holds(self) -> bool:
        """Whether all values exist and lie in the window."""
        low = -np.inf if self.window.low is None else self.window.low
        high = np.inf if self.window.high is None else self.window.high
        width = high - low if np.isfinite(high - low) else max(abs(self.largest), 1e-300)
        slack = _ROUNDING * width
        return bool(self.smallest >= low - slack and self.largest <= high + slack)

    @property
    def value(self) -> str:
        """The value, or the range of the values, in words."""
        if np.isnan(self.smallest):
            return "no value"
        unit = f" {self.window.unit}" if self.window.unit else ""
        scale = max(abs(self.smallest), abs(self.largest))
        low, high = (
            f"{0.0 if abs(v) < 1e-9 * scale else v:.4g}" for v in (self.smallest, self.largest)
        )
        return (low if low == high else f"{low} .. {high}") + unit

    @property
    def range(self) -> str:
        """The window in words."""
        w = self.window
        unit = f" {w.unit}" if w.unit else ""
        if w.low is None:
            return f"at most {w.high:.4g}{unit}"
        if w.high is None:
            return f"at least {w.low:.4g}{unit}"
        return f"{w.low:.4g}{unit}" if w.low == w.high else f"{w.low:.4g} .. {w.high:.4g}{unit}"


def judge(window: Window, values: Array) -> Verdict:
    """Compare values with a window; without values, or with a NaN among them, it does not hold."""
    if values.size == 0 or np.isnan(values).any():
        return Verdict(window, np.nan, np.nan)
    return Verdict(window, float(values.min()), float(values.max()))


def between(x: Array, y: Array, limits: tuple[float, float] | None) -> Array:
    """The values of y whose x is within limits; all without limits."""
    if limits is None:
        return y
    low, high = sorted(limits)
    return np.asarray(y[(x >= low) & (x <= high)])


def axis_window(title: str, axis: Axis, source: str) -> Window:
    """The range of an axis of a picture as a window.

    Args:
        title: Title of the panel.
        axis: The axis, with limits.
        source: Source of the study.
    """
    assert axis.limits is not None
    low, high = sorted(axis.limits)
    label, _, unit = axis.label.partition("(")
    return Window(
        name=f"{title}: {label.strip()} within the axis".lstrip(": "),
        value="0",
        low=low,
        high=high,
        unit=unit.rstrip(")"),
        source=f"axis of {source}" if source else "axis",
    )
