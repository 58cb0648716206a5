"""Config of stages that follow a branch of equilibria past its limit points."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import AfterValidator, BeforeValidator, Field, PlainSerializer, model_validator

from dealib.device.device import Device
from dealib.device.records import KIND_OF
from dealib.errors import ValueAt, did_you_mean
from dealib.section import Section
from dealib.units import parse, write

_VARIABLES = {v.name: v for kind in KIND_OF.values() for v in kind.variables}


def _variable(name: str) -> str:
    if name.partition(".")[0] not in _VARIABLES:
        hint = did_you_mean(name, _VARIABLES)
        raise ValueError(f"{name!r} is no variable of a port{hint}")
    return name


def _limits(given: object) -> object:
    if not isinstance(given, Mapping):
        raise ValueError("expected a mapping, such as {displacement: -3 mm}")
    found = {}
    for name, value in given.items():
        try:
            found[name] = parse(value, _VARIABLES[_variable(str(name)).partition(".")[0]].dimension)
        except ValueError as error:
            raise ValueAt((name,), str(error)) from None
    return found


def _written(limits: dict[str, float]) -> dict[str, str]:
    dimension = {n: _VARIABLES[n.partition(".")[0]].dimension for n in limits}
    return {n: write(value, dimension[n]) for n, value in limits.items()}


Name = Annotated[str, AfterValidator(_variable)]
if TYPE_CHECKING:
    Limits: TypeAlias = dict[str, float]
else:
    Limits = Annotated[
        dict[str, float],
        BeforeValidator(_limits, json_schema_input_type=dict[str, str]),
        PlainSerializer(_written, return_type=dict[str, str]),
    ]


def partner(name: str) -> str:
    """The other variable of the same port."""
    stem, dot, port = name.partition(".")
    one, other = (v.name for v in KIND_OF[stem].variables)
    return (other if stem == one else one) + dot + port


def crossed(program: Iterable[Any]) -> bool:
    """Whether a stage follows a branch in variables of two ports, with an unsymmetric tangent."""
    pairs = [stage.follow.pair for stage in program if stage.follow is not None]
    return any(partner(vary) != along for vary, along in pairs)


class Follow(Section):
    """Pseudo-arc-length: the path of equilibria in two port variables, past limit points.

    The first variable, `vary`, is solved for instead of prescribed; the history tells whether a
    state would be stable if it were prescribed. The first increment is the distance to the end of
    `along` divided by `steps`. Time is proportional to the arc length: a straight path to that end
    takes `duration`.
    """

    vary: Name = Field(
        description="variable that is solved for, such as voltage, or voltage.NAME if there are "
        "several terminals; limit points are extrema of it"
    )
    along: Name | None = Field(
        None,
        description="second variable of the path; default the dual of `vary` at the same port: "
        "charge for voltage, displacement for force, volume for pressure, and the reverse",
    )
    until: Limits = Field(
        min_length=1,
        description="values that end the stage when the first of them is reached, such as "
        "{displacement: -3 mm}; the one of `along` is required and met exactly; for the others, "
        "the last state is the first one beyond the value",
    )
    states: int | None = Field(
        None, ge=1, description="largest number of states; default ten times `steps`"
    )

    @property
    def pair(self) -> tuple[str, str]:
        """The variables `vary` and `along`."""
        return self.vary, self.along or partner(self.vary)

    @model_validator(mode="after")
    def _possible(self) -> Follow:
        vary, along = self.pair
        if vary == along:
            raise ValueAt(("along",), f"must be another variable than {vary}")
        if along not in self.until:
            raise ValueAt(("until",), f"give the last value of {along}, which the steps divide")
        return self


def check_branches(config: Any) -> None:
    """Check stages with `follow`: they need a potential, elastic materials and free variables.

    Raises:
        ValueAt: If a stage cannot follow a branch.
    """
    device: Device = config.device
    driven = {p.name: "" if p.floating else p.kind.primal.name for p in device.ports}
    for i, stage in enumerate(config.program):
        driven |= {port: given.given[0] for port, given in stage.driven(device).items()}
        if stage.follow is None:
            continue
        where = ("program", i, "follow")
        if config.physics.coupling != "energy":
            raise ValueAt(("physics", "coupling"), "a stage with follow needs coupling: energy")
        for material, law in config.solids.items():
            if law.memory:
                raise ValueAt(
                    ("materials", material, law.memory[0]),
                    "a stage with follow computes equilibria, independent of time: remove this key",
                )
        vary, along = stage.follow.pair
        names = [("vary", vary), ("along", along), *(("until", n) for n in stage.follow.until)]
        for key, name in names:
            if name not in device.variables:
                known = ", ".join(device.variables)
                raise ValueAt((*where, key), f"the device has no {name!r}; it has {known}")
        port, other = device.variables[vary], device.variables[along]
        stem = along.partition(".")[0]
        if other != port and driven[other.name] in (stem, ""):
            raise ValueAt(
                where,
                f"{along} is prescribed here, so that no branch can be followed along it; "
                f"prescribe {partner(along)} in a stage before",
            )
        if other != port and stem == other.kind.dual.name:
            raise ValueAt(
                (*where, "along"),
                f"beside {vary} only {partner(vary)} or the {other.kind.primal.name} of the "
                f"{other.kind.name} measures the path, not its {stem}",
            )
        if driven[port.name] in ("spring", "bias", "gas"):
            raise ValueAt(
                (*where, "vary"),
                f"varying {vary} would remove the {driven[port.name]} from the {port.kind.name}; "
                "vary another variable",
            )
        driven[port.name] = vary.partition(".")[0]
