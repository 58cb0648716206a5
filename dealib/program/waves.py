"""Waves that ports follow over a stage, given by a formula or a measured file."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from dealib.config.program import Stage
from dealib.config.wave import Wave
from dealib.errors import ConfigError
from dealib.units import DIMENSIONS

_TIME = "time_s"


@dataclass(frozen=True)
class Waveform:
    """A wave in a stage.

    Attributes:
        wave: The formula, or the file.
        duration: Duration of the stage, s.
        first: Share of it that the first step takes.
        times: Times of measured points, s; empty for a formula.
        values: Values at these times.
    """

    wave: Wave
    duration: float
    first: float
    times: tuple[float, ...] = ()
    values: tuple[float, ...] = ()

    @classmethod
    def of(cls, wave: Wave, stage: Stage, quantity: str, dimension: str) -> Waveform:
        """A wave of a stage.

        Args:
            wave: As the config gives it.
            stage: The stage.
            quantity: Such as 'voltage', as it is called in a file.
            dimension: Of its values.

        Raises:
            ConfigError: If the file cannot be read, lacks a column, or its times do not increase.
        """
        found = cls(wave, stage.duration, 1 / stage.count)
        if wave.file is None:
            return found
        times, values = _read(wave.file, quantity, DIMENSIONS[dimension][0])
        return cls(wave, found.duration, found.first, times, values)

    def at(self, share: float, start: float) -> float:
        """Value at a share of the stage.

        Args:
            share: 0 to 1.
            start: Value at the start of the stage. The wave's difference from it decays linearly to
                zero over the first step.
        """
        off = start - self._raw(0.0, start)
        return self._raw(share, start) + off * max(0.0, 1 - share / self.first)

    def begin(self) -> float:
        """Value of the wave itself at the start."""
        return self._raw(0.0, 0.0)

    def _raw(self, share: float, start: float) -> float:
        t = share * self.duration
        if self.times:
            return float(np.interp(t, self.times, self.values))
        return self.wave.at(t, start)

    def plain(self) -> dict[str, Any]:
        """As numbers, texts, lists and dicts."""
        return {**vars(self), "wave": {k: v for k, v in vars(self.wave).items() if v is not None}}

    @classmethod
    def restored(cls, plain: dict[str, Any]) -> Waveform:
        """Inverse of `plain`, also after a round trip through JSON."""
        times, values = (tuple(plain[k]) for k in ("times", "values"))
        wave = Wave.model_construct(**plain["wave"])
        return cls(wave, plain["duration"], plain["first"], times, values)


def _read(file: str, quantity: str, unit: str) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Times and values of a measured course."""
    from dealib.data.measured import measured
    from dealib.data.schema import Selection

    column = f"{quantity}_{unit}"
    found = measured(file, [_TIME, column], Selection(file=file, x="time")).columns
    times, values = (tuple(map(float, found[name])) for name in (_TIME, column))
    if len(times) < 2 or not all(a < b for a, b in pairwise(times)):
        raise ConfigError(f"{file}: its times must increase")
    return times, values
