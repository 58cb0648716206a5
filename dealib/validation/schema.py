"""A benchmark: a device, how it is driven, and the numbers that are known of it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from dealib.config.band import Band
from dealib.config.names import Cell, Name
from dealib.errors import Place, ValueAt, did_you_mean
from dealib.section import OneOf, Section
from dealib.study.expressions import Expression
from dealib.study.schema import Axis

Above0 = Annotated[float, Field(gt=0)]
Kind = Literal["analytical", "code", "measured"]


class Modes(Section):
    """Vibrations about the state at the end of a stage; expressions then read `modes.csv`."""

    count: int = Field(4, ge=1, le=100, description="number of modes, from the lowest frequency on")
    stage: str | None = Field(None, description="stage at whose end; default the last one")


class Spectrum(Band):
    """Small-signal response at the end of a stage; expressions then read `response.csv`."""

    stage: str | None = Field(None, description="stage at whose end; default the last one")


class Tolerance(OneOf):
    """How far a result may lie from its reference."""

    relative: Above0 | None = Field(
        None, description="largest difference as a share of the reference"
    )
    absolute: Above0 | None = Field(None, description="largest difference in the quantity's unit")


class Check(Section):
    """A number with its reference."""

    name: Cell = Field(min_length=1, description="name of the quantity, in words")
    unit: Cell = Field("", description="unit of all numbers of this quantity")
    value: str = Field(description="computed number: expression over the quantities of all cases")
    reference: float | str = Field(
        description="known number, or an expression over `constants` that gives it"
    )
    tolerance: Tolerance
    because: str = Field("", description="reason of the tolerance, where it needs one")


class ReferenceCurve(Section):
    """Points of a reference curve, given here or in a file of two columns."""

    label: str = Field(min_length=1, description="label in the legend")
    x: tuple[float, ...] = Field((), description="points along x, in the unit of the axis")
    y: tuple[float, ...] = Field((), description="as many points along y")
    file: str | None = Field(
        None,
        description="CSV of two columns, beside this file or in the folder that DEALIB_DATA names",
    )
    branch: Literal["all", "loading", "unloading"] = Field(
        "all", description="all points of the file, or those up to or from its largest x"
    )
    style: Literal["line", "points"] = Field("points", description="line or points in the picture")

    @model_validator(mode="after")
    def _one_source(self) -> ReferenceCurve:
        if self.file is not None and (self.x or self.y):
            raise ValueAt(("file",), "give either a file or x and y")
        if self.file is None and not self.x:
            raise ValueError("give x and y, or a file")
        if len(self.x) != len(self.y):
            raise ValueError(f"x has {len(self.x)} values, y has {len(self.y)}")
        return self


class CurveCheck(Section):
    """A curve of one case beside that of a reference, point by point."""

    name: Cell = Field(min_length=1, description="name of the curve, in words")
    case: Cell | None = Field(None, description="label of the case; default the first one")
    x: Axis = Field(description="horizontal axis, along which the curve rises")
    y: Axis = Field(description="vertical axis")
    reference: ReferenceCurve
    unit: Cell = Field("", description="unit of y")
    rms: Above0 | None = Field(
        None, description="largest root mean square of the differences in y; none: drawn only"
    )
    because: str = Field("", description="reason of the tolerance, where it needs one")


class Benchmark(Section):
    """A device, what is computed of it, and what it is compared with."""

    name: Name = Field(description="name of the file, without its suffix")
    title: str = Field(min_length=1, description="what it is, in one line")
    kind: Kind = Field(
        description="what the references are: closed forms and differential equations, "
        "other codes, or measurements"
    )
    source: str = Field(min_length=1, description="paper, equation or table of the reference")
    obtained: str = Field(min_length=1, description="how the reference numbers were obtained")
    licence: str = Field("", description="licence of data that others made")
    device: dict[str, Any] = Field(description="a whole config: geometry, materials, program")
    cases: dict[Cell, dict[Cell, Any]] = Field(
        {}, description="variants, as label: {dotted key of the device: value}; default one case"
    )
    modes: Modes | None = Field(None, description="vibrations that are found beside the run")
    spectrum: Spectrum | None = Field(None, description="spectrum that is found beside the run")
    quantities: dict[str, str] = Field({}, description="name: expression, one number a case")
    constants: dict[str, float | str] = Field(
        {}, description="name: number, or an expression over those before it"
    )
    checks: tuple[Check, ...] = Field((), description="numbers with references")
    curves: tuple[CurveCheck, ...] = Field((), description="curves with references")

    @field_validator("quantities", "constants")
    @classmethod
    def _names(cls, given: dict[str, Any]) -> dict[str, Any]:
        for name in given:
            if not name.isidentifier():
                raise ValueAt((name,), "use letters, digits and '_'")
        return given

    @model_validator(mode="after")
    def _consistent(self) -> Benchmark:
        if self.modes is not None and self.spectrum is not None:
            raise ValueAt(("spectrum",), "modes and spectrum exclude each other; give one")
        if not self.checks and not any(c.rms for c in self.curves):
            raise ValueError("nothing is compared: give checks, or curves with rms")
        self.numbers()
        named = [*(c.name for c in self.checks), *(c.name for c in self.curves)]
        for k, name in enumerate(named):
            if name in named[:k]:
                at = ("checks", k) if k < len(self.checks) else ("curves", k - len(self.checks))
                raise ValueAt((*at, "name"), f"two quantities are named {name!r}")
        for k, curve in enumerate(self.curves):
            if curve.case is not None and curve.case not in self.labels:
                problem = f"there is no case {curve.case!r}{did_you_mean(curve.case, self.labels)}"
                raise ValueAt(("curves", k, "case"), problem)
        return self

    @property
    def labels(self) -> list[str]:
        """Labels of the cases."""
        return list(self.cases) or [self.name]

    def numbers(self) -> list[float]:
        """The references of the checks.

        Raises:
            ValueAt: If one is no finite number.
        """
        known: dict[str, float] = {}
        for name, given in self.constants.items():
            known[name] = _number(given, known, ("constants", name))
        found = []
        for k, check in enumerate(self.checks):
            where = ("checks", k, "reference")
            found.append(_number(check.reference, known, where))
            if found[-1] == 0 and check.tolerance.relative is not None:
                raise ValueAt(where, "a share of 0 is 0: give the tolerance as absolute")
        return found


def _number(given: float | str, known: Mapping[str, float], where: Place) -> float:
    if not isinstance(given, str):
        return float(given)
    try:
        value = float(Expression(given, {})(known, {}))
    except (ValueError, TypeError) as error:
        raise ValueAt(where, str(error)) from None
    if not math.isfinite(value):
        raise ValueAt(where, f"{given!r} is no finite number")
    return value
