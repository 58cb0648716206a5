"""A design that has been read: its file, its base config and the cases of its points."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal

from dealib.config import Case, load
from dealib.config.messages import validate
from dealib.config.schema import Config
from dealib.config.source import Source
from dealib.design.keys import Key, keys
from dealib.design.schema import Design, Variable
from dealib.errors import ConfigError, Place, ValueAt
from dealib.study.expressions import inlined
from dealib.study.scope import of_history, setting
from dealib.units import convert

Point = dict[str, float | str]  # by variable: a number in its unit, or the label of a choice


class DesignPlan:
    """A validated design with its base config.

    Attributes:
        source: The file with the positions of its keys.
        design: The content of the file.
        path: The file.
        base: The file of the base config.
        config: The config of the start.
        quantities: Expressions over columns of the history, by name.
        start: The first design of a search.
        keys: Numbers of the config, by the name of the variable.

    Args:
        path: The YAML file.

    Raises:
        ConfigError: With one message for each mistake and its place in the file.
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
        """Unit of a variable that is a number; that of its bounds, or dealib's internal one."""
        return self.design.variables[name].unit or self.keys[name].unit

    def spread(self, name: str) -> Any:
        """The distribution of a variable in its unit, as an object of `scipy.stats`.

        Bounds alone give a uniform distribution.

        Raises:
            ConfigError: If the variable has no distribution, with its place in the file.
        """
        variable, where = self.design.variables[name], ("variables", name)
        if variable.choices is not None:
            raise self.fault((*where, "choices"), "a choice has no distribution; name a number")
        key, unit = self.keys[name], self.unit(name)
        try:
            usual = convert((key.value, key.unit), unit)
        except ValueError:  # a unit of another dimension, which `of` reports with its key
            usual, unit = key.value, key.unit
        try:
            return variable.of(unit, usual)
        except ValueAt as error:
            raise self.fault((*where, *error.where), str(error)) from None

    def fault(
        self, where: Place, problem: str, at: Literal["key", "value"] = "value"
    ) -> ConfigError:
        """An error that points at a place of the file."""
        return ConfigError(self.source.message(where, problem, at))

    def expression(self, text: str, where: Place, config: Config | None = None) -> str:
        """Replace the names of quantities in an expression by their expressions.

        Raises:
            ConfigError: If it uses an unknown name or function, with its place in the file.
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

    def _load(self, changes: dict[str, Any], where: Place) -> Case:
        at: Literal["key", "value"] = "key" if where[0] == "variables" else "value"
        try:
            return load(self.base, {**self._fixed, **changes})
        except ConfigError as error:
            raise self.fault(where, f"in {self.base}, {error}", at) from None

    def _begin(self, name: str, variable: Variable, own: Config) -> float:
        """The value of a number in the first design; its key is stored in `keys`."""
        where = ("variables", name)
        if variable.scatters:
            self.keys[name] = self._key(name, own)
            return float(self.spread(name).mean())
        low, high = variable.range
        try:
            self.keys[name] = self._key(name, own)
        except ConfigError:  # the base does not give the number, or gives 0
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
        """The number of the config that a variable names."""
        where = ("variables", name)
        try:
            found = keys(config, [name])
        except ConfigError as error:
            raise self.fault(where, str(error), "key") from None
        if [key.name for key in found] != [name]:
            raise self.fault(where, "this is a section; name one number of it", "key")
        return found[0]
