"""The file of a design: a config, what may vary in it, and what is asked of it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

from pydantic import Field, model_validator

from dealib.config import Case, load
from dealib.config.messages import validate
from dealib.config.names import FilePath, Name
from dealib.config.schema import Config
from dealib.config.settings import Destination, Weibull
from dealib.config.source import Path_, Source
from dealib.data.schema import Amount
from dealib.design.distributions import Correlation, Spread
from dealib.design.keys import Key, keys
from dealib.errors import ConfigError, ValueAt
from dealib.section import Section
from dealib.study.expressions import inlined
from dealib.study.scope import of_history, setting
from dealib.units import convert, list_of

Share = Annotated[float, Field(gt=0, lt=1)]
Point = dict[str, float | str]  # by variable: a number in its unit, or the label of a choice
if TYPE_CHECKING:
    Texts: TypeAlias = tuple[str, ...]
else:
    Texts = list_of(str)


class Variable(Spread):
    """A number of the config: within bounds, with a distribution, or a choice.

    `{mean, deviation}` is a normal distribution, `{min, max}` a uniform one or bounds.
    """

    start: Amount | None = Field(
        None, description="where a search starts; default the base's value, or the middle"
    )
    choices: list[Any] | dict[str, dict[str, Any]] | None = Field(
        None,
        description="values of the key; or names, each with the keys that it sets",
        min_length=1,
    )

    @property
    def unit(self) -> str:
        """Unit in which the number is told: of the lower bound, or of the mean."""
        given = self.min or self.mean or self.mode or self.max
        return given[1] if given else ""

    @property
    def range(self) -> tuple[float, float]:
        """Bounds of a number in that unit."""
        assert self.min is not None
        assert self.max is not None
        return self.min[0], convert(self.max, self.unit)

    @property
    def changes(self) -> dict[str, Any]:
        """Of a choice: what each label sets; values stand for themselves."""
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
        """A number as the config wants it."""
        return f"{value!r} {self.unit}".strip()


class Sampling(Section):
    """Where the config is solved for `dealib uncertainty`."""

    samples: Literal[16, 32, 64, 128, 256, 512, 1024, 2048, 4096] = Field(
        128, description="number of cases; a larger sample begins with the smaller one"
    )
    seed: int = Field(0, ge=0, description="seed of the quasi-random points")
    quantiles: tuple[Share, ...] = Field(
        (0.05, 0.5, 0.95), description="quantiles that are reported"
    )


class Search(Section):
    """How an optimum is searched for."""

    starts: int = Field(
        3,
        ge=1,
        le=1000,
        description="number of starts: the given one, and others within the bounds",
    )
    evaluations: int = Field(
        40, ge=1, description="largest number of evaluations for a start or a point of the front"
    )
    front: int = Field(
        9, ge=3, le=200, description="number of points of the front of two objectives"
    )
    tolerance: float = Field(1e-4, gt=0, lt=0.1, description="relative tolerance on the objective")
    margin: float = Field(
        1e-5, ge=0, lt=0.1, description="relative distance that it keeps from each limit"
    )


class Design(Section):
    """A design: a config, what may vary in it, and what is asked of it."""

    name: Name | None = Field(None, description="short name; default that of the file")
    description: str = Field("", description="one line, a title of pictures")
    base: FilePath = Field(description="config to start from, beside this file")
    set: dict[str, Any] = Field({}, description="keys of the config that differ in all designs")
    variables: dict[str, Variable] = Field(min_length=1, description="by dotted key of the config")
    quantities: dict[str, str] = Field(
        {}, description="expressions over the history by name, as in studies"
    )
    maximise: Texts = Field((), description="a quantity or an expression; two: a front")
    minimise: Texts = Field((), description="the same; one of each: a front, too")
    subject_to: Texts = Field(
        (), description="limits, such as 'used <= 0.8' or '0 <= max(force_N) <= 2'"
    )
    model: Literal["auto", "solid", "membrane"] = Field(
        "auto",
        description="auto: the membrane if it is near the solid, which then has the last word",
    )
    search: Search = Search()
    correlations: tuple[Correlation, ...] = Field(
        (), description="correlations of variables that scatter"
    )
    breakdown: Weibull | None = Field(
        None, description="sets limits.weibull: the history then tells failure_probability"
    )
    sampling: Sampling = Sampling()
    output: Destination = Destination()


class Plan:
    """A validated design and what it refers to.

    Attributes:
        source: The file with its positions.
        design: What it says.
        path: The file.
        base: The config's file.
        quantities: By name, as expressions over the history alone.
        start: The first design of a search.
        keys: Of the variables that are numbers.

    Args:
        path: The YAML file.

    Raises:
        ConfigError: With one message a mistake, each with its place in the file.
    """

    def __init__(self, path: Path) -> None:
        self.source, self.path = Source(path), path
        self.design = validate(Design, self.source)
        self.base = path.parent / self.design.base
        if not self.base.is_file():
            raise self.fault(("base",), f"there is no file {self.base}")
        self.start: Point = {}
        self.keys: dict[str, Key] = {}
        own = self._load({}, ("base",)).config
        for name, variable in self.design.variables.items():
            where = ("variables", name)
            if variable.choices is None:
                self.start[name] = self._begin(name, variable, own)
                continue
            for label in variable.changes:
                self._load(self._changes({name: label}), (*where, "choices"))
            self.start[name] = next(iter(variable.changes))
        config = self._load(self._changes(self.start), ("variables",)).config
        self.quantities: dict[str, str] = {}
        for name, text in self.design.quantities.items():
            self.quantities[name] = self.expression(text, ("quantities", name), config)
        self.config = config

    @property
    def name(self) -> str:
        """Name of the design."""
        return self.design.name or self.path.stem

    def unit(self, name: str) -> str:
        """Unit of a variable that is a number."""
        return self.design.variables[name].unit or self.keys[name].unit

    def spread(self, name: str) -> Any:
        """The distribution of a variable, of `scipy.stats`, in its unit; of bounds a uniform one.

        Raises:
            ConfigError: If there is none, with its place.
        """
        variable, where = self.design.variables[name], ("variables", name)
        if variable.choices is not None:
            raise self.fault((*where, "choices"), "a choice does not scatter; name a number")
        key, unit = self.keys[name], self.unit(name)
        try:
            usual = convert((key.value, key.unit), unit)
        except ValueError:  # the unit is none of this number's, as is told of its key below
            usual, unit = key.value, key.unit
        try:
            return variable.of(unit, usual)
        except ValueAt as error:
            raise self.fault((*where, *error.where), str(error)) from None

    def fault(
        self, where: Path_, problem: str, at: Literal["key", "value"] = "value"
    ) -> ConfigError:
        """An error that points at a place of the file."""
        return ConfigError(self.source.message(where, problem, at))

    def expression(self, text: str, where: Path_, config: Config | None = None) -> str:
        """An expression over quantities and the history as one over the history alone.

        Raises:
            ConfigError: If it asks for what is not there, with its place.
        """
        try:
            found = inlined(text, self.quantities)
            of_history(found, config or self.config, self.quantities)
        except ValueError as error:
            raise self.fault(where, str(error)) from None
        return found

    def case(self, point: Mapping[str, float | str], **others: Any) -> Case:
        """The case of a design.

        Args:
            point: Value of each variable.
            others: Further keys of the config, such as `{"physics.model": "membrane"}`.

        Raises:
            ConfigError: If the values are impossible together.
        """
        return load(self.base, {**self._fixed, **self._changes(point), **others})

    @property
    def _fixed(self) -> dict[str, Any]:
        """Keys of the config that all designs set."""
        chance = self.design.breakdown
        more = {} if chance is None else {"limits.weibull": chance.model_dump()}
        return {**self.design.set, **more}

    def _changes(self, point: Mapping[str, float | str]) -> dict[str, Any]:
        return dict(pair for name, value in point.items() for pair in self._changed(name, value))

    def _changed(self, name: str, value: float | str) -> Iterator[tuple[str, Any]]:
        """Keys of the config that a variable sets."""
        variable = self.design.variables[name]
        if variable.choices is None:
            yield name, f"{float(value)!r} {self.unit(name)}".strip()
            return
        given = variable.changes[str(value)]
        yield from given.items() if isinstance(variable.choices, dict) else [(name, given)]

    def _load(self, changes: dict[str, Any], where: Path_) -> Case:
        at: Literal["key", "value"] = "key" if where[0] == "variables" else "value"
        try:
            return load(self.base, {**self._fixed, **changes})
        except ConfigError as error:
            raise self.fault(where, f"in {self.base}, {error}", at) from None

    def _begin(self, name: str, variable: Variable, own: Config) -> float:
        """Where a search begins in a number; its key is found, too."""
        where = ("variables", name)
        if variable.scatters:
            self.keys[name] = self._key(name, own)
            return float(self.spread(name).mean())
        low, high = variable.range
        try:
            self.keys[name] = self._key(name, own)
        except ConfigError:  # the base does not give it, or as 0, which has no unit
            inner = next(v for v in ((low + high) / 2, low, high) if v)
            changed = self._load({name: variable.text(inner)}, where).config
            self.keys[name] = self._key(name, changed)
        try:
            convert((low, variable.unit), self.keys[name].unit)
        except ValueError as error:
            raise self.fault((*where, "min"), str(error)) from None
        if variable.start is not None:
            return convert(variable.start, variable.unit)
        try:
            value = convert((setting(own, name), self.keys[name].unit), variable.unit)
        except ValueError:
            return (low + high) / 2
        return min(max(value, low), high)

    def _key(self, name: str, config: Config) -> Key:
        """The number that a variable is."""
        where = ("variables", name)
        try:
            found = keys(config, [name])
        except ConfigError as error:
            raise self.fault(where, str(error), "key") from None
        if [key.name for key in found] != [name]:
            raise self.fault(where, "this is a section; name one number of it", "key")
        return found[0]
