"""The schema of a fit's file: a config, its free parameters, and the data."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Any, Literal

from pydantic import Field, model_validator

from dealib.config import Case, load
from dealib.config.band import Band
from dealib.config.messages import validate
from dealib.config.names import FilePath, Name
from dealib.config.settings import Destination
from dealib.config.source import Source
from dealib.data.schema import Amount, Selection
from dealib.errors import ConfigError, Place, ValueAt
from dealib.section import Section
from dealib.units import convert


def _fault(amount: tuple[float, str], unit: str) -> str:
    """Why an amount cannot be converted to a unit; empty if it can."""
    try:
        convert(amount, unit)
    except ValueError as error:
        return str(error)
    return ""


class Parameter(Section):
    """A number of the config that is fitted, within bounds."""

    start: Amount = Field(description="where the search starts, such as '1 MPa'")
    min: Amount = Field(description="lower bound, such as '0.2 MPa'")
    max: Amount = Field(description="upper bound, such as '5 MPa'")

    @property
    def unit(self) -> str:
        """Unit of the start, in which the parameter is fitted and reported."""
        return self.start[1]

    @property
    def range(self) -> tuple[float, float]:
        """Bounds in that unit."""
        return convert(self.min, self.unit), convert(self.max, self.unit)

    @model_validator(mode="after")
    def _ordered(self) -> Parameter:
        """Check that bounds and start have units of one kind; the error names the odd one out."""
        odd, kind = "start", self.min[1]
        if _fault(self.max, kind):
            odd, kind = ("min", self.unit) if not _fault(self.max, self.unit) else ("max", kind)
        if fault := _fault(getattr(self, odd), kind):
            raise ValueAt((odd,), fault)
        low, high = self.range
        if not low < self.start[0] < high:
            raise ValueAt(("start",), "the start must lie between min and max")
        return self

    def text(self, value: float) -> str:
        """A value as the config wants it."""
        return f"{value!r} {self.unit}".strip()


class Data(Selection):
    """Measured curves, the part of a run that they belong to, and what they count."""

    set: dict[str, Any] = Field({}, description="keys of the config that differ for these data")
    sigma: dict[str, Amount] = Field(
        {},
        description="standard deviation of the noise by quantity; default 1 % of its range, "
        "and 0 of the abscissa",
    )
    weight: float = Field(1.0, gt=0, description="factor on the residuals of these data")
    spectrum: Band | None = Field(
        None,
        description="they are of the small-signal spectrum at the end of `stage`, the abscissa "
        "`frequency`; quantities are the columns of response.csv",
    )


Intervals = Literal["auto", "linear", "profile"]
INTERVALS = (
    "linear: from the derivatives at the best fit; profile: from the sum of squares with the "
    "others fitted again, better where the model is bent, but many more evaluations; auto: profile "
    "where the linear ones mislead"
)


class Method(Section):
    """How the fit is done: Levenberg-Marquardt with bounds."""

    max_evaluations: int = Field(30, ge=2, description="most evaluations of the residuals")
    tolerance: float = Field(
        1e-6,
        gt=0,
        lt=0.1,
        description="relative change of the sum of squares and of the parameters",
    )
    difference: float = Field(
        1e-3, gt=0, lt=0.1, description="relative step of the finite differences"
    )
    confidence: float = Field(0.95, gt=0.5, lt=1, description="level of the intervals")
    intervals: Intervals = Field("linear", description=INTERVALS)


class Fit(Section):
    """A fit: a config, what may change in it, and the data it shall meet."""

    name: Name = Field(description="short name; also the default directory")
    description: str = Field("", description="one line, shown in the report")
    base: FilePath = Field(description="config to start from, beside this file")
    set: dict[str, Any] = Field({}, description="keys of the config that differ for the whole fit")
    parameters: dict[str, Parameter] = Field(
        min_length=1, description="fitted numbers, by dotted key of the config"
    )
    data: tuple[Data, ...] = Field(min_length=1)
    method: Method = Method()
    output: Destination = Destination()

    @property
    def directory(self) -> str:
        """Directory of the results."""
        return os.path.expanduser(self.output.directory or f"runs/{self.name}")


class FitPlan:
    """A validated fit and what it refers to.

    Args:
        path: The YAML file.

    Raises:
        ConfigError: With one message a mistake.
    """

    def __init__(self, path: Path) -> None:
        self.source = Source(path)
        self.fit = validate(Fit, self.source)
        self.base = path.parent / self.fit.base
        if not self.base.is_file():
            raise ConfigError(self.source.message(("base",), f"there is no file {self.base}"))
        self.files = [path.parent / data.file for data in self.fit.data]
        for i, file in enumerate(self.files):
            if not file.is_file():
                where = ("data", i, "file")
                raise ConfigError(self.source.message(where, f"there is no file {file}"))
        for key, parameter in self.fit.parameters.items():
            start, (low, high) = parameter.start[0], parameter.range
            beside = start + self.fit.method.difference * max(abs(start), (high - low) / 100)
            # the second value is a fraction, which keys of whole numbers refuse
            for value in (start, min(beside, (start + high) / 2)):
                self._load({key: parameter.text(value)}, ("parameters", key))
        for i, data in enumerate(self.fit.data):
            config = self._load(data.set, ("data", i, "set")).config
            if data.stage not in (None, *(s.stage for s in config.program)):
                known = ", ".join(s.stage for s in config.program)
                problem = f"the program has no such stage; it has {known}"
                raise ConfigError(self.source.message(("data", i, "stage"), problem))

    def _load(self, changes: dict[str, Any], where: Place) -> Case:
        try:
            return load(self.base, {**self.fit.set, **changes})
        except ConfigError as error:
            at: Literal["key", "value"] = "key" if where[0] == "parameters" else "value"
            problem = f"in {self.base}, {error}"
            raise ConfigError(self.source.message(where, problem, at)) from None

    def case(self, index: int, values: dict[str, float]) -> Case:
        """The case of a data set at parameter values.

        Args:
            index: Number of the data set.
            values: Parameters by dotted key, in their units.

        Raises:
            ConfigError: If the values are impossible together.
        """
        numbers = {key: self.fit.parameters[key].text(value) for key, value in values.items()}
        return load(self.base, {**self.fit.set, **self.fit.data[index].set, **numbers})

    def sigma(self, index: int, quantity: str, unit: str, spread: float) -> float:
        """Standard deviation of a measured quantity, in a unit.

        Raises:
            ConfigError: If it is given in a unit of another kind.
        """
        given = self.fit.data[index].sigma.get(quantity)
        if given is None:
            return 0.01 * spread
        where = ("data", index, "sigma", quantity)
        try:
            value = convert(given, unit)
        except ValueError as error:
            raise ConfigError(self.source.message(where, str(error))) from None
        if not (value > 0 and math.isfinite(value)):
            raise ConfigError(self.source.message(where, "must be above 0"))
        return value
