"""Schema of a design file: a base config, its variables, objectives and limits."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, model_validator

from dealib.config.names import FilePath, Name
from dealib.config.settings import Destination, Weibull
from dealib.data.schema import Amount
from dealib.design.distributions import Correlation, Spread
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import convert, list_of

Share = Annotated[float, Field(gt=0, lt=1)]
if TYPE_CHECKING:
    Texts: TypeAlias = tuple[str, ...]
else:
    Texts = list_of(str)


class Variable(Spread):
    """A variable: a number of the config within bounds or with a distribution, or a choice.

    `{mean, deviation}` is a normal distribution; `{min, max}` are bounds, or a uniform
    distribution.
    """

    start: Amount | None = Field(
        None, description="start of a search; default the value of the base, or the middle"
    )
    choices: list[Any] | dict[str, dict[str, Any]] | None = Field(
        None,
        description="list of values of the key; or names, each with the keys that it sets",
        min_length=1,
    )

    @property
    def unit(self) -> str:
        """Unit of the number: that of the lower bound, or of the mean; empty if none is given."""
        given = self.min or self.mean or self.mode or self.max
        return given[1] if given else ""

    @property
    def range(self) -> tuple[float, float]:
        """Bounds of the number in `unit`."""
        assert self.min is not None
        assert self.max is not None
        return self.min[0], convert(self.max, self.unit)

    @property
    def changes(self) -> dict[str, Any]:
        """The choices by label: the keys that each sets, or its value."""
        given = self.choices or {}
        return given if isinstance(given, dict) else {str(value): value for value in given}

    @model_validator(mode="after")
    def _whole(self) -> Variable:
        if self.choices is not None:
            numbers = [k for k in type(self).model_fields if k != "choices"]
            if given := [k for k in numbers if getattr(self, k) is not None]:
                raise ValueAt((given[0],), f"choices and {given[0]} exclude each other")
            if len(self.changes) < len(self.choices):
                raise ValueAt(("choices",), "a choice is given twice")
            return self
        if self.scatters:
            return self
        for missing in ("min", "max"):
            if getattr(self, missing) is None:
                raise ValueError(f"{missing} is missing; give min and max, or choices")
        for key in ("max", "start"):
            if (amount := getattr(self, key)) is not None:
                try:
                    convert(amount, self.unit)
                except ValueError as error:
                    raise ValueAt((key,), str(error)) from None
        low, high = self.range
        if not low < high:
            raise ValueAt(("min",), "min must be below max")
        if self.start is not None and not low <= convert(self.start, self.unit) <= high:
            raise ValueAt(("start",), "the start must lie between min and max")
        return self

    def text(self, value: float) -> str:
        """A value of the number in `unit`, as text for the config."""
        return f"{value!r} {self.unit}".strip()


class Sampling(Section):
    """Samples of `dealib uncertainty`."""

    samples: Literal[16, 32, 64, 128, 256, 512, 1024, 2048, 4096] = Field(
        128, description="number of cases; a larger sample begins with the smaller one"
    )
    seed: int = Field(0, ge=0, description="seed of the quasi-random points")
    quantiles: tuple[Share, ...] = Field(
        (0.05, 0.5, 0.95), description="quantiles that are reported"
    )


class Search(Section):
    """Settings of the search for an optimum."""

    starts: int = Field(
        3,
        ge=1,
        le=1000,
        description="number of starts: the given one, and others within the bounds",
    )
    evaluations: int = Field(
        40, ge=1, description="largest number of evaluations per start and per point of the front"
    )
    front: int = Field(
        9, ge=3, le=200, description="number of points of the front of two objectives"
    )
    tolerance: float = Field(1e-4, gt=0, lt=0.1, description="relative tolerance on the objective")
    margin: float = Field(
        1e-5, ge=0, lt=0.1, description="relative distance that the search keeps from each limit"
    )


class Design(Section):
    """A design: a base config, its variables, and objectives and limits or distributions."""

    name: Name | None = Field(None, description="short name; default that of the file")
    description: str = Field("", description="one line, the title of pictures")
    base: FilePath = Field(description="base config, with its path from the folder of this file")
    set: dict[str, Any] = Field({}, description="changes of the base config in all designs, by key")
    variables: dict[str, Variable] = Field(
        min_length=1, description="variables by dotted key of the config"
    )
    quantities: dict[str, str] = Field(
        {}, description="expressions over the history by name, as in studies"
    )
    maximise: Texts = Field(
        (), description="objective: a quantity or an expression; two objectives give a front"
    )
    minimise: Texts = Field(
        (), description="objective, as for maximise; one of each gives a front as well"
    )
    subject_to: Texts = Field(
        (), description="limits, such as 'used <= 0.8' or '0 <= max(force_N) <= 2'"
    )
    model: Literal["auto", "solid", "membrane"] = Field(
        "auto",
        description="model that is solved; auto: the search uses the membrane if it agrees with "
        "the solid, and solves the best designs as solids",
    )
    search: Search = Search()
    correlations: tuple[Correlation, ...] = Field(
        (), description="correlations of variables with distributions"
    )
    breakdown: Weibull | None = Field(
        None, description="sets limits.weibull, which adds failure_probability to the history"
    )
    sampling: Sampling = Sampling()
    output: Destination = Destination()
