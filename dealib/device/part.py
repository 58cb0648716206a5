"""A part of a base, such as an interval of an annulus or a circle on a rectangle."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

Span = tuple[float, float]


@dataclass(frozen=True)
class Part:
    """A part of a base.

    Attributes:
        spans: Interval along each axis that limits it, mm.
        circle: Centre and radius of a circle instead, mm.
    """

    spans: Mapping[str, Span] = field(default_factory=dict)
    circle: tuple[float, float, float] | None = None

    def covers(self, at: Mapping[str, Any]) -> Any:
        """Mask of the points that it covers, given by their coordinates along each axis, mm."""
        inside = np.ones(np.shape(next(iter(at.values()))), dtype=bool)
        for axis, (a, b) in self.spans.items():
            inside &= (a <= at[axis]) & (at[axis] <= b)
        if self.circle is not None:
            x, y, radius = self.circle
            inside &= np.hypot(at["X"] - x, at["Y"] - y) <= radius
        return inside

    def breaks(self, axis: str) -> tuple[float, ...]:
        """Coordinates along an axis at which it begins and ends, mm."""
        return self.spans.get(axis, ())

    def touches(self, other: Part) -> bool:
        """Whether it shares a point with another part."""
        if self.circle is not None and other.circle is not None:
            (x, y, one), (u, v, two) = self.circle, other.circle
            return math.hypot(x - u, y - v) <= one + two
        if other.circle is not None:
            return other.touches(self)
        if self.circle is not None:
            *centre, radius = self.circle
            spans = (other.spans.get(axis, (-math.inf, math.inf)) for axis in "XY")
            away = [max(a - c, c - b, 0.0) for c, (a, b) in zip(centre, spans, strict=True)]
            return math.hypot(*away) <= radius
        both = self.spans.keys() & other.spans.keys()
        pairs = ((self.spans[axis], other.spans[axis]) for axis in both)
        return all(a <= d and c <= b for (a, b), (c, d) in pairs)

    def overlaps(self, other: Part) -> bool:
        """Whether it may share an area with another part; parts with a circle always may."""
        common = self.spans.keys() & other.spans.keys()
        pairs = [(self.spans[axis], other.spans[axis]) for axis in common]
        return all(a[0] < b[1] and b[0] < a[1] for a, b in pairs)
