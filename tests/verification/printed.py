"""Comparison with numbers as they were printed."""

from __future__ import annotations

from collections.abc import Iterable


def printed(value: float, text: str) -> bool:
    """Whether a value rounds to a printed number."""
    mantissa, _, exponent = text.partition("e")
    digits = len(mantissa.partition(".")[2])
    unit = 10.0 ** (int(exponent or 0) - digits)
    return abs(value - float(text)) <= 0.51 * unit


def all_printed(values: Iterable[float], texts: str) -> None:
    """Assert it of several values and a text of as many numbers."""
    for value, text in zip(values, texts.split(), strict=True):
        assert printed(value, text), f"{value!r} is not {text}"
