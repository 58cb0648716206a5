"""What a port does over a stage: lists of values, or waveforms by a formula or a file."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import Discriminator, Field, Tag, create_model, model_validator

from dealib.config.names import FilePath
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import Angle, Frequency, Time, list_of

_KINDS = {  # key that makes it -> keys that go with it
    "frequency": ("mean", "amplitude", "phase", "rise"),
    "to": ("rise", "time_constant"),
    "file": (),
}


class Wave(Section):
    """A waveform: a formula in the time t of the stage, or a file.

    Such as `{mean: 2 kV, amplitude: 200 V, frequency: 100 Hz}`, `{to: 2 kV, rise: 1 ms}` or
    `{file: drive.csv}`. If it does not begin at the present value of the port, the port goes to
    its beginning in the first step of the stage.
    """

    mean: float | None = Field(None, description="sine: mean value; default 0")
    amplitude: float | None = Field(None, description="sine: amplitude")
    frequency: Frequency | None = Field(
        None, gt=0, description="sine: mean + amplitude sin(2 pi frequency t + phase)"
    )
    phase: Angle | None = Field(None, description="sine: phase at the start; default 0")
    to: float | None = Field(None, description="step: final value, from where the port is")
    rise: Time | None = Field(
        None, gt=0, description="time over which a step or an amplitude rises, smoothly"
    )
    time_constant: Time | None = Field(
        None, gt=0, description="step: the rest decays as exp(-t / time_constant)"
    )
    file: FilePath | None = Field(
        None,
        description="measured, with headers such as 'time [ms], voltage [V]'; its last value stays",
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
            raise ValueAt((key,), f"does not go with {kind}, but with {_kind_of(key)}")
        if kind == "frequency" and self.amplitude is None:
            raise ValueAt(("amplitude",), "this key is missing")
        if kind == "to" and (self.rise is None) == (self.time_constant is None):
            raise ValueAt(("to",), "a step needs rise or time_constant")
        return self

    @property
    def reach(self) -> tuple[float, ...]:
        """Values that it reaches, as far as the config knows."""
        if self.frequency is not None:
            mean, amplitude = self.mean or 0.0, self.amplitude or 0.0
            return (mean, mean - amplitude, mean + amplitude, mean)
        return () if self.to is None else (self.to,)

    def at(self, t: float, start: float) -> float:
        """Value of a wave by a formula.

        Args:
            t: Time since the stage began, s.
            start: Where the port was then.
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
        """From 0 to 1; velocity and acceleration are continuous, as bodies in motion want it."""
        s = 1.0 if self.rise is None else min(t / self.rise, 1.0)
        return s**3 * (10 - 15 * s + 6 * s**2)


def _kind_of(key: str) -> str:
    return next(kind for kind, keys in _KINDS.items() if key in (kind, *keys))


def course(kind: Any, name: str) -> Any:
    """A type for a value to ramp to, a list of values, or a wave.

    Args:
        kind: Of the values.
        name: Of what follows the course, such as 'voltage'.
    """
    own: dict[str, Any] = {
        key: (kind | None, Wave.model_fields[key]) for key in ("mean", "amplitude", "to")
    }
    model = create_model(f"{name.title()}Wave", __base__=Wave, __doc__=Wave.__doc__, **own)
    globals()[model.__name__] = model  # where pickle looks for it
    return Annotated[
        Annotated[list_of(kind), Tag("list")] | Annotated[model, Tag("wave")],
        Discriminator(lambda given: "wave" if isinstance(given, (dict, Wave)) else "list"),
    ]


def reach(given: tuple[float, ...] | Wave) -> tuple[float, ...]:
    """Values of a course, as far as the config knows."""
    return given.reach if isinstance(given, Wave) else given
