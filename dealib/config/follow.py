"""Stages that follow a branch of equilibria past its limit points, in the config."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, Literal, TypeAlias

from pydantic import Field, model_validator

from dealib.config.section import Section
from dealib.errors import ValueAt
from dealib.units import Charge, Force, Length, Voltage

Variable: TypeAlias = Literal["displacement", "force", "voltage", "charge"]
PORT_OF: dict[str, str] = {
    "displacement": "mount",
    "force": "mount",
    "voltage": "terminal",
    "charge": "terminal",
}
PARTNER: dict[str, Variable] = {
    "displacement": "force",
    "force": "displacement",
    "voltage": "charge",
    "charge": "voltage",
}


class Until(Section):
    """Where to stop: at the first of these that is reached.

    The end of `along` is met exactly; of the others, the first state beyond is the last one.
    """

    displacement: Length | None = Field(None, description="of the mount")
    force: Force | None = Field(None, description="on the mount")
    voltage: Voltage | None = Field(None, description="of the terminal")
    charge: Charge | None = Field(None, description="on the terminal")


class Follow(Section):
    """Pseudo-arc-length: the path of equilibria in two port variables, past limit points.

    The first one is set free and varies as equilibrium asks; states are stable or not under its
    control. `steps` would lead straight to the end of `along`; the path takes more. Time only
    counts the path, `duration` over a length as that straight one.
    """

    vary: Variable = Field(description="what is set free; limit points are those of it")
    along: Variable | None = Field(
        None,
        description="what else measures the path; default the partner at the same port: charge of "
        "voltage, displacement of force, and the reverse",
    )
    until: Until = Field(description="where to stop; `along` needs its end here")
    states: int | None = Field(
        None, ge=1, description="stop after so many states; default ten times `steps`"
    )

    @property
    def pair(self) -> tuple[Variable, Variable]:
        """Both variables."""
        return self.vary, self.along or PARTNER[self.vary]

    @model_validator(mode="after")
    def _possible(self) -> Follow:
        vary, along = self.pair
        allowed = [PARTNER[vary]]
        allowed.append("displacement" if PORT_OF[vary] == "terminal" else "voltage")
        if along not in allowed:
            raise ValueAt(("along",), f"beside {vary} only {' or '.join(allowed)}, not {along}")
        if getattr(self.until, along) is None:
            raise ValueAt(("until",), f"give the end of {along}, along which the steps are counted")
        return self


def check_branches(program: Iterable[Any], coupling: str, solids: Mapping[str, Any]) -> None:
    """Branches of equilibria need a potential, elastic materials, and two variables that are free.

    Raises:
        ValueAt: If a stage cannot be followed.
    """
    prescribed = {"mount": "displacement", "terminal": "voltage"}
    driven = dict(prescribed)
    for i, stage in enumerate(program):
        for port in driven:
            given = getattr(stage, port)
            if given is not None:
                driven[port] = given.given[0]
        if stage.follow is None:
            continue
        if coupling != "energy":
            raise ValueAt(("physics", "coupling"), "branches are followed with energy only")
        for region, law in solids.items():
            if law.branches:
                raise ValueAt(
                    ("materials", region, "branches"),
                    "a stage with follow runs along equilibria, out of time; take these out for it",
                )
        vary, along = stage.follow.pair
        other = PORT_OF[along]
        if other != PORT_OF[vary] and driven[other] == prescribed[other]:
            raise ValueAt(
                ("program", i, "follow"),
                f"{along} is prescribed here, so no branch runs along it; load the {other}",
            )
        if driven[PORT_OF[vary]] in ("spring", "bias"):
            raise ValueAt(
                ("program", i, "follow", "vary"),
                f"the bias would be taken off the mount to vary its {vary}; vary the voltage",
            )
        driven[PORT_OF[vary]] = vary
