"""The course of an input over a stage: a list of values, or a waveform by formula or file."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, create_model, model_validator

from dealib.config.names import FilePath
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Angle, Frequency, Time, list_of

_KINDS = {  # key that defines a kind of wave -> keys that may accompany it
    "frequency": ("mean", "amplitude", "phase", "rise"),
    "to": ("rise", "time_constant"),
    "file": (),
}


class Wave(Section):
    """A waveform: a formula in the time t of the stage, or a file.

    Such as `{mean: 2 kV, amplitude: 200 V, frequency: 100 Hz}`, `{to: 2 kV, rise: 1 ms}` or
    `{file: drive.csv}`. If it does not begin at the present value of the port, the value changes
    to its beginning in the first step of the stage.
    """

    mean: float | None = Field(None, description="sine: mean value; default 0")
    amplitude: float | None = Field(None, description="sine: amplitude")
    frequency: Frequency | None = Field(
        None, gt=0, description="sine: mean + amplitude sin(2 pi frequency t + phase)"
    )
    phase: Angle | None = Field(None, description="sine: phase at the start; default 0")
    to: float | None = Field(
        None, description="step: final value; it starts at the present value of the port"
    )
    rise: Time | None = Field(
        None, gt=0, description="time in which a step or an amplitude rises smoothly"
    )
    time_constant: Time | None = Field(
        None, gt=0, description="step: the remaining difference decays as exp(-t / time_constant)"
    )
    file: FilePath | None = Field(
        None,
        description="file of a measured wave, with headers such as 'time [ms], voltage [V]'; its "
        "last value is kept",
    )

    @model_validator(mode="after")
    def _one_kind(self) -> Wave:
        given = {name for name in Wave.model_fields if getattr(self, name) is not None}
        kinds = [key for key in _KINDS if key in given]
        if len(kinds) != 1:
            some = " and ".join(kinds) or "none of them"
            raise ValueError(f"a wave has one of {', '.join(_KINDS)}; here: {some}")
        (kind,) = kinds
        for key in sorted(given - {kind, *_KINDS[kind]}):
            owner = next(k for k, keys in _KINDS.items() if key in (k, *keys))
            raise ValueAt((key,), f"cannot be combined with {kind}, only with {owner}")
        if kind == "frequency" and self.amplitude is None:
            raise ValueAt(("amplitude",), "this key is missing")
        if kind == "to" and (self.rise is None) == (self.time_constant is None):
            raise ValueAt(("to",), "a step needs rise or time_constant")
        return self

    @property
    def reach(self) -> tuple[float, ...]:
        """Values that the wave reaches; empty for a file."""
        if self.frequency is not None:
            mean, amplitude = self.mean or 0.0, self.amplitude or 0.0
            return (mean, mean - amplitude, mean + amplitude, mean)
        return () if self.to is None else (self.to,)

    def at(self, t: float, start: float) -> float:
        """Value of a wave that is given by a formula.

        Args:
            t: Time since the stage began, s.
            start: Value of the port at that time.
        """
        if self.frequency is not None:
            turn = 2 * math.pi * self.frequency * t + (self.phase or 0.0)
            amplitude = (self.amplitude or 0.0) * self._risen(t)
            return (self.mean or 0.0) + amplitude * math.sin(turn)
        assert self.to is not None
        share = self._risen(t)
        if self.time_constant is not None:
            share = -math.expm1(-t / self.time_constant)
        return start + share * (self.to - start)

    def _risen(self, t: float) -> float:
        """Smooth rise from 0 to 1 with continuous first and second derivatives in time."""
        s = 1.0 if self.rise is None else min(t / self.rise, 1.0)
        return s**3 * (10 - 15 * s + 6 * s**2)


def course(kind: Any, name: str) -> Any:
    """A type for a value to ramp to, a list of values, or a wave.

    Args:
        kind: Type of the values, such as `Voltage`.
        name: Name of the input, such as 'voltage'.
    """
    own: dict[str, Any] = {
        key: (kind | None, Wave.model_fields[key]) for key in ("mean", "amplitude", "to")
    }
    model = create_model(f"{name.title()}Wave", __base__=Wave, __doc__=Wave.__doc__, **own)
    globals()[model.__name__] = model  # pickle finds classes here
    return Annotated[
        Annotated[list_of(kind), Tag("list")] | Annotated[model, Tag("wave")],
        Discriminator(lambda given: "wave" if isinstance(given, (dict, Wave)) else "list"),
    ]


def reach(given: tuple[float, ...] | Wave) -> tuple[float, ...]:
    """Values that a course reaches; empty for a file."""
    return given.reach if isinstance(given, Wave) else given
