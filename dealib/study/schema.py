"""Schema of a study: base config, variations, quantities, panels and windows."""

from __future__ import annotations

import re
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from dealib.config.materials import Material
from dealib.config.names import Cell, Name
from dealib.errors import Place, ValueAt, did_you_mean
from dealib.section import Section
from dealib.units import Length, Time

Limits = tuple[float, float]
Above0 = Annotated[float, Field(gt=0)]
Where = dict[str, str | tuple[str, ...]]
_WHERE = "only cases with these labels on an axis of `vary`"


class MaterialTest(Section):
    """A test of a material alone; its columns are `stretch`, `strain` and `stress_MPa`."""

    material: Material = Field(
        description="a law and its parameters, as in `materials` of a config"
    )
    mode: Literal["uniaxial", "equal-biaxial", "pure shear"] = Field(
        "uniaxial", description="mode of loading; also the name of the only stage"
    )
    stretch: tuple[Above0, Above0] = Field((1.0, 2.0), description="first and last stretch")
    points: int = Field(61, ge=2, le=100_000, description="number of stretches, equally spaced")


class Axis(Section):
    """One axis of a picture."""

    value: str = Field(description="expression of the values on the axis")
    label: str = Field(min_length=1, description="label of the axis, with its unit")
    limits: Limits | None = Field(
        None,
        description="range of the axis, in which values are expected; a falling range reverses it",
    )
    scale: Literal["linear", "log"] = Field("linear", description="scale of the axis")

    @model_validator(mode="after")
    def _logarithmic(self) -> Axis:
        if self.scale == "log" and self.limits is not None and min(self.limits) <= 0:
            raise ValueAt(("limits",), "a log axis needs limits above zero")
        return self


class Reference(Section):
    """Reference values, drawn as points or a line."""

    label: str = Field(description="name in the legend")
    x: tuple[float, ...] = Field(min_length=1, description="values in the unit of the axis")
    y: tuple[float, ...] = Field(
        min_length=1, description="the same number of values, in the unit of the axis"
    )
    style: Literal["line", "points"] = Field("points", description="drawn as points or as a line")

    @model_validator(mode="after")
    def _pairs(self) -> Reference:
        if len(self.x) != len(self.y):
            raise ValueError(f"x has {len(self.x)} values, y has {len(self.y)}")
        return self


class _Panel(Section):
    title: str = Field("", description="title above the panel")
    where: Where = Field({}, description=_WHERE)


class Curves(_Panel):
    """One curve for each case: x and y are expressions over its history and fields."""

    kind: Literal["curves"]
    x: Axis
    y: Axis
    label: str | None = Field(
        None, description="label of a curve, such as '{law}'; default that of the case"
    )
    references: tuple[Reference, ...] = Field((), description="reference values")


class Points(_Panel):
    """One point for each case: x and y are expressions over the quantities."""

    kind: Literal["points"]
    x: Axis
    y: Axis
    group: str | None = Field(None, description="axis of `vary`: one curve for each of its labels")
    references: tuple[Reference, ...] = Field((), description="reference values")


class Contour(_Panel):
    """A field on the layers of one case: deformed, straightened, and both ends true to scale.

    A three-dimensional device is drawn whole and cut in half.
    """

    kind: Literal["contour"]
    field: str = Field(description="name of the field, such as S_RR, S_ZZ, E or phi")
    label: str = Field(min_length=1, description="label of the colour bar, with its unit")
    stage: str = Field(description="stage at whose end the field is drawn")
    factor: float = Field(1.0, description="factor from the internal unit to that of the label")
    limits: Limits | None = Field(
        None, description="range of the colours; by default it covers all but 0.6 % of the area"
    )
    zoom: Length = Field(0.25, gt=0, description="length shown at each end")

    @model_validator(mode="after")
    def _rising(self) -> Contour:
        if self.limits is not None and self.limits[0] >= self.limits[1]:
            raise ValueAt(("limits",), "the first limit must be below the second")
        return self


class Shapes(_Panel):
    """The deformed device of one case at several times, true to scale."""

    kind: Literal["shapes"]
    times: tuple[Time, ...] = Field(
        min_length=1, description="times; the nearest stored states are drawn"
    )


Panel = Annotated[Curves | Points | Contour | Shapes, Field(discriminator="kind")]


class Window(Section):
    """A range in which a number is expected."""

    name: Cell = Field(min_length=1, description="name of the comparison")
    value: str = Field(description="expression over the quantities of all cases")
    low: float | None = Field(None, description="smallest value; give low, high or both")
    high: float | None = Field(None, description="largest value")
    unit: Cell = Field("", description="unit of value, low and high")
    source: Cell = Field("", description="source of the range")
    where: Where = Field({}, description=_WHERE)

    @model_validator(mode="after")
    def _bounded(self) -> Window:
        if self.low is None and self.high is None:
            raise ValueError("give low, high or both")
        if self.low is not None and self.high is not None and self.low > self.high:
            raise ValueError(f"low ({self.low:g}) must not exceed high ({self.high:g})")
        return self


class Study(Section):
    """Cases, quantities, pictures and windows."""

    name: Name = Field(description="short name, also of the files")
    title: str = Field(min_length=1, description="heading in the gallery")
    source: str = Field("", description="source of the reference values")
    base: str | None = Field(
        None, description="config that is varied, with its path from the folder of this file"
    )
    material_test: dict[str, Any] | None = Field(
        None, description="a test of a material instead of a config; see below"
    )
    set: dict[str, Any] = Field({}, description="changes of the base in all cases, by dotted key")
    program: list[Any] | None = Field(None, description="stages that replace those of the base")
    vary: dict[Cell, dict[Cell, Any]] = Field(
        {},
        description="axes; the cases are all their combinations. An axis is either {key: list, "
        "...}, with lists of the same length that vary together, or {label: {key: value, ...}, "
        "...}; the key `base` names a config",
    )
    label: str | None = Field(None, description="label of a case, such as '{law}, {modulus}'")
    quantities: dict[str, str] = Field(
        {}, description="expressions by name, with one number for each case"
    )
    panels: tuple[Panel, ...] = Field((), description="pictures")
    columns: int = Field(2, ge=1, le=4, description="number of panels in a row")
    windows: tuple[Window, ...] = Field((), description="ranges in which numbers are expected")
    comparison: str = Field(
        "", description="a sentence in which {expression:format} is replaced by its value"
    )

    @field_validator("vary")
    @classmethod
    def _axes(cls, axes: dict[str, dict[str, Any]]) -> dict[str, dict[str, Any]]:
        for name, axis in axes.items():
            lists = [isinstance(v, list) for v in axis.values()]
            if not axis or not (all(lists) or all(isinstance(v, dict) for v in axis.values())):
                raise ValueAt(
                    (name,),
                    "expected lists of equal length, such as {mesh.columns: [20, 40]}, or labels "
                    "with changes, such as {coarse: {mesh.columns: 20}}",
                )
            lengths = {len(v) for v in axis.values()} if all(lists) else {1}
            if len(lengths) != 1 or 0 in lengths:
                raise ValueAt((name,), "the lists must have the same length, above zero")
        return axes

    @field_validator("quantities")
    @classmethod
    def _quantities(cls, quantities: dict[str, str]) -> dict[str, str]:
        for name in quantities:
            if not name.isidentifier():
                raise ValueAt((name,), "use letters, digits and '_'")
        return quantities

    @model_validator(mode="after")
    def _consistent(self) -> Study:
        bases = [a.get("base") is not None for a in self.vary.values()]
        bases += [c.get("base") is not None for a in self.vary.values() for c in _choices(a)]
        if self.material_test is not None and (self.base or self.program or any(bases)):
            raise ValueError("give either base or material_test, not both")
        if self.material_test is None and self.base is None and not any(bases):
            raise ValueError("the key 'base' is missing: the config that is varied")
        for name, parts in (("panels", self.panels), ("windows", self.windows)):
            for i, part in enumerate(parts):
                for axis in part.where:
                    self._check_axis((name, i, "where", axis), axis)
                if isinstance(part, Points) and part.group:
                    self._check_axis((name, i, "group"), part.group)
        return self

    def _check_axis(self, where: Place, axis: str) -> None:
        if axis not in self.vary:
            raise ValueAt(where, f"{axis!r} is not an axis of vary{did_you_mean(axis, self.vary)}")

    def inserts(self) -> list[str]:
        """Expressions in the sentence of comparison."""
        return [m[1] for m in INSERT.finditer(self.comparison)]


INSERT = re.compile(r"\{([^{}:]+)(?::([^{}]*))?\}")


def _choices(axis: dict[str, Any]) -> list[dict[str, Any]]:
    return [v for v in axis.values() if isinstance(v, dict)]
