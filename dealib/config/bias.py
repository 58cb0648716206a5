"""Bias elements on the mount: each is a class with its keys in the config and its force.

A new element is a new class here with `load`, and a key of `BiasElement`. The forces of a list of
elements add up. Each element counts the displacement from its own anchor, which may move.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias

from pydantic import AfterValidator, Field, ValidationError, model_validator

from dealib.config.messages import in_file, problem
from dealib.config.wave import Wave, course
from dealib.errors import ValueAt
from dealib.materials.laws import LAWS
from dealib.section import OneOf, Section
from dealib.units import Force, Length, Mass, Stiffness, list_of


def _positive(mass: float) -> float:
    if mass < 0:
        raise ValueError("a mass is positive; a pull upwards is a positive force")
    return mass


if TYPE_CHECKING:
    Lengths: TypeAlias = tuple[float, ...]
    Masses: TypeAlias = tuple[float, ...]
    Anchor: TypeAlias = tuple[float, ...] | Wave
else:
    Lengths, Masses = list_of(Length), list_of(Annotated[Mass, AfterValidator(_positive)])
    Anchor = course(Length, "anchor")


class Spring(Section):
    """Linear spring between mount and anchor: force = stiffness x (anchor - displacement)."""

    stiffness: Stiffness = Field(gt=0)
    anchor: Anchor = Field(
        description="displacement of the mount at which the spring is slack; reached by a ramp"
    )

    def load(self, x: float) -> tuple[float, float]:
        """Force on the mount in N, and its derivative in N/mm, at x mm from the anchor."""
        return -self.stiffness * x, -self.stiffness


class Bistable(Section):
    """Spring with two rest positions and a negative rate between them; its force is cubic."""

    rate: Stiffness = Field(lt=0, description="stiffness at the anchor; negative")
    well: Length = Field(gt=0, description="distance of both rest positions from the anchor")
    anchor: Anchor = Field(description="displacement of the mount at its unstable centre")

    def load(self, x: float) -> tuple[float, float]:
        """See `Spring`."""
        s = (x / self.well) ** 2
        return -self.rate * x * (1 - s), -self.rate * (1 - 3 * s)


class Sampled(Section):
    """A smooth force computed at some displacements: a quintic spline, linear beyond them."""

    displacement: tuple[float, ...]
    force: tuple[float, ...]

    @cached_property
    def _curve(self) -> Any:
        from scipy.interpolate import make_interp_spline

        return make_interp_spline(self.displacement, self.force, k=5)

    @property
    def reach(self) -> tuple[float, float]:
        """First and last displacement from the anchor that is given, mm."""
        return self.displacement[0], self.displacement[-1]

    def load(self, x: float) -> tuple[float, float]:
        """See `Spring`."""
        first, last = self.reach
        inside = min(max(x, first), last)
        slope = float(self._curve(inside, 1))
        return float(self._curve(inside)) + slope * (x - inside), slope


class Table(Sampled):
    """Any spring by points: interpolated without overshoot (PCHIP), linear beyond them."""

    displacement: tuple[Length, ...] = Field(
        min_length=2, description="displacements of the mount from the anchor, increasing"
    )
    force: tuple[Force, ...] = Field(
        min_length=2, description="forces on the mount; negative is down"
    )
    anchor: Anchor = Field(description="displacement of the mount at the zero of the table")

    @model_validator(mode="after")
    def _matches(self) -> Table:
        if len(self.force) != len(self.displacement):
            n, m = len(self.displacement), len(self.force)
            raise ValueAt(("force",), f"{m} forces for {n} displacements")
        for a, b in pairwise(self.displacement):
            if b <= a:
                raise ValueAt(("displacement",), f"must increase, but {b:g} mm follows {a:g} mm")
        return self

    @cached_property
    def _curve(self) -> Any:
        from scipy.interpolate import PchipInterpolator

        return PchipInterpolator(self.displacement, self.force)


class SecondFilm(Section):
    """A second, passive film on the same mount: a double cone.

    It is a mirror image of this device without voltage. Its frame is a distance below this
    device's, so that it pulls the mount down. Its force is computed once, by a run of its own.
    """

    distance: Lengths = Field(
        description="distance between both frames; both films are flat at 0 mm"
    )
    set: dict[str, Any] | None = Field(
        None, description="keys in which the second device differs, such as geometry.film_thickness"
    )

    @model_validator(mode="after")
    def _apart(self) -> SecondFilm:
        if max(self.distance) <= 0:
            raise ValueAt(("distance",), "must be above 0 mm somewhere")
        return self

    @property
    def anchor(self) -> Lengths:
        """Displacement of the mount at which the second film is flat."""
        return tuple(-d for d in self.distance)


class BiasElement(OneOf):
    """One bias element: exactly one of the following."""

    mass: Masses | None = Field(None, description="suspended mass: force -m g")
    spring: Spring | None = Field(None, description="linear spring")
    bistable: Bistable | None = Field(
        None, description="spring with two rest positions, of negative rate between them"
    )
    table: Table | None = Field(None, description="any spring, by points of its curve")
    film: SecondFilm | None = Field(None, description="a second film, which makes a double cone")

    @property
    def course(self) -> tuple[tuple[str, ...], tuple[float, ...] | Wave]:
        """Path and course of the value that may change over a stage."""
        name, given = self.given
        if isinstance(given, tuple):
            return (name,), given
        key = "distance" if isinstance(given, SecondFilm) else "anchor"
        return (name, key), getattr(given, key)


Element: TypeAlias = Spring | Bistable | Table | Sampled


def second_device(config: Any, film: SecondFilm) -> Any:
    """Config of the run that computes the force of a second film.

    It pushes the film to 1.25 times the largest distance. The air and the clamp blocks are left
    out, since without voltage they exert no force on the film.

    Raises:
        ValueAt: If `set` makes no valid config.
    """
    tree = config.model_dump(exclude_none=True)
    far = 1.25 * max(film.distance)
    tree["program"] = [
        {"stage": "push", "mount": {"displacement": f"{-far!r} mm"}, "steps": 24},
    ]
    tree.pop("stop_when", None)
    if config.mesh.file is None and "air_height" in tree["geometry"]:
        tree["geometry"]["air_height"] = "0 mm"
        tree["geometry"].pop("clamps", None)
    for region, material in tree["materials"].items():
        head = f"materials.{region}."
        changes = (film.set or {}).items()
        _drop_replaced(material, {k[len(head) :]: v for k, v in changes if k.startswith(head)})
    for key, value in (film.set or {}).items():
        *above, last = key.split(".")
        node = tree
        for part in above:
            node = node.get(part) if isinstance(node, dict) else None
        if not isinstance(node, dict) or not above or above[0] not in ("geometry", "materials"):
            raise ValueAt(
                ("set",), f"{key}: only keys such as geometry.film_thickness or materials.film"
            )
        node[last] = value
    materials = tree["materials"].values()
    if any(isinstance(part, dict) and part.get("branches") for part in materials):
        raise ValueAt(
            ("set",),
            "a second film is elastic, without viscosity: set materials.film.branches (and those "
            "of the electrode) to [], which leaves the long-term stiffness",
        )
    softening = ("mullins", "permanent_set")
    if any(isinstance(part, dict) and part.get(key) for part in materials for key in softening):
        raise ValueAt(
            ("set",),
            "a second film is elastic, without softening: set materials.film.mullins and "
            "permanent_set to null",
        )
    try:
        return type(config).model_validate(tree)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(map(str, in_file(first, tree)))
        raise ValueAt(("set",), f"{where}: {problem(first, type(config))}") from None


def _drop_replaced(material: dict[str, Any], changes: dict[str, Any]) -> None:
    """Remove from a material the keys that its changes replace.

    A validated config holds the moduli that follow from `youngs_modulus` and the law that comes
    from `library`; they would contradict new values of these keys.
    """
    law = LAWS[material["law"]]
    replaced: tuple[str, ...] = law.ruled() if changes.get("youngs_modulus") is not None else ()
    if "library" in changes or changes.get("law", material["law"]) != material["law"]:
        replaced = ("law", "library", *law.names())
    for key in replaced:
        material.pop(key, None)


def check_second_films(config: Any) -> None:
    """Raise `ValueAt` if the config of a second film in the program is not valid."""
    for i, stage in enumerate(config.program):
        for path, _, _, given in stage.inputs:
            for k, element in enumerate(getattr(given, "bias", None) or ()):
                if element.film is None:
                    continue
                try:
                    second_device(config, element.film)
                except ValueAt as error:
                    where = ("program", i, *path, "bias", k, "film", *error.where)
                    raise ValueAt(where, str(error)) from None
