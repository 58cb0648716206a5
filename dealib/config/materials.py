"""Materials in the config: a law with its parameters, other properties, and the library."""

from __future__ import annotations

import functools
from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias, Union

from pydantic import BaseModel, BeforeValidator, Field, create_model

from dealib.errors import Place, ValueAt, did_you_mean
from dealib.materials.branches import Inelastic
from dealib.materials.laws import LAWS, Law, invariants_of_stretches
from dealib.materials.permittivity import RelativePermittivity, StretchPermittivity
from dealib.materials.prestretch import thickness_range
from dealib.materials.published import library
from dealib.units import Density


def _pair(value: object) -> object:
    if isinstance(value, (list, tuple)) and len(value) == 2:
        return value
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ValueError("expected a number such as 1.15, or two: [radial, hoop]")
    return [value, value]


# accepted moduli in MPa: gels and greases have 100 Pa, diamond 1 TPa, and bulk moduli that
# stand for incompressibility may be larger
_SOFTEST, _HARDEST = 1e-5, 1e7

Stretch = Annotated[float, Field(ge=0.5, le=10)]


class Named(BaseModel):
    """A material that may come from the library."""

    library: str | None = Field(
        None,
        description="material that supplies all values not given here: a published one (see "
        "dealib materials) or one of the config's `library`",
        json_schema_extra=lambda node: node.update({"examples": list(library())}),
    )


class Properties(Named):
    """Properties of a material besides its law."""

    relative_permittivity: RelativePermittivity | None = Field(
        None,
        description="a number, or {intercept: a, slope: b} for a + b * stretch; a material without "
        "this key is a conductor",
    )
    density: Density | None = Field(
        None,
        gt=0,
        description="density of the unstretched material, such as 960 kg/m^3; dynamic stages "
        "and vibrations need it",
    )
    prestretch: Annotated[
        tuple[Stretch, Stretch],
        BeforeValidator(_pair, json_schema_input_type=Stretch | tuple[Stretch, Stretch]),
    ] = Field(
        (1.0, 1.0),
        description="in-plane pre-stretch: one number if equal-biaxial, or two along the "
        "directions of the layer: [radial, hoop], [axial, hoop] of a tube, [along X, along Y]",
    )
    mounted: Literal["relaxed", "fresh"] = Field(
        "relaxed",
        description="state of the branches at the start; relaxed: they bear no stress, the film "
        "was pre-stretched long ago; fresh: it was pre-stretched just now, and they relax from "
        "there",
    )

    @property
    def permittivity(self) -> StretchPermittivity:
        """Relative permittivity of a dielectric as a function of stretch."""
        given = self.relative_permittivity
        if isinstance(given, StretchPermittivity):
            return given
        assert given is not None
        return StretchPermittivity(intercept=given, slope=0.0)

    @property
    def conducts(self) -> bool:
        """Whether the material is a conductor."""
        return self.relative_permittivity is None


def _complete(given: object, only: tuple[str, ...]) -> object:
    """Complete a material with values of the library.

    Args:
        given: The material as in the file.
        only: Keys besides those of the law that are taken from the library.
    """
    if not isinstance(given, dict) or not isinstance(given.get("library"), str):
        return given
    name = given["library"]
    if name not in library():
        hint = did_you_mean(name, library())
        if name.endswith((".yaml", ".yml")):
            hint = f"; name a file by 'library: {name}' at the top level of the config, and here "
            hint += "one of its materials"
        raise ValueAt(("library",), f"unknown material {name!r}{hint}")
    law = library()[name].values["law"]
    if given.get("law", law) != law:
        raise ValueAt(("law",), f"the law of {name} is {law}; leave out law, or library")
    return library()[name].with_changes(given, only)


def _choice(bases: tuple[type[BaseModel], ...], suffix: str) -> Any:
    """A union of one model for each law, chosen by the key `law` or a material of the library."""
    models: Any = tuple(
        create_model(f"{law.__name__}{suffix}", __base__=(law, *bases), __doc__=law.__doc__)
        for law in LAWS.values()
    )
    globals().update({model.__name__: model for model in models})  # pickle finds classes here
    own = tuple(name for base in bases for name in base.model_fields)
    return Annotated[
        Union[models],  # noqa: UP007 - built at run time
        Field(discriminator="law"),
        BeforeValidator(functools.partial(_complete, only=own)),
    ]


if TYPE_CHECKING:

    class Material(Law, Inelastic, Properties):
        """A law and further properties."""

        law: str
else:
    Material = _choice((Inelastic, Properties), "Material")


def _or_named(node: dict[str, Any]) -> None:
    """Allow materials of the library without a law in the JSON schema."""
    choices = node if "oneOf" in node else next(c for c in node["anyOf"] if "oneOf" in c)
    choices["oneOf"].append(
        {
            "type": "object",
            "properties": {"library": {"type": "string", "examples": list(library())}},
            "required": ["library"],
            "not": {"required": ["law"]},
        }
    )


def _moduli(material: Law) -> Iterator[tuple[Place, str, float]]:
    """Path, kind and value (MPa) of each modulus of a material."""
    by = None if material.youngs_modulus is None else "youngs_modulus"
    yield (by or material.names()[0],), "shear", material.shear_modulus_at_rest
    yield (by or "bulk_modulus",), "bulk", material.parameters["bulk_modulus"]
    for i, branch in enumerate(getattr(material, "branches", ())):
        yield ("branches", i, "shear_modulus"), "shear", branch.shear_modulus


if TYPE_CHECKING:
    Materials: TypeAlias = dict[str, Material]
else:
    Materials = dict[str, Annotated[Material, Field(json_schema_extra=_or_named)]]


def check_materials(materials: Materials) -> None:
    """Raise `ValueAt` if a material's moduli, pre-stretch or permittivity are impossible."""
    for name, material in materials.items():
        for where, what, modulus in _moduli(material):
            if not _SOFTEST <= modulus <= _HARDEST:
                raise ValueAt(
                    ("materials", name, *where),
                    f"a {what} modulus of {modulus:.4g} MPa is outside the range of solids (10 Pa "
                    "to 10 TPa); check the unit: MPa is mega, mPa is milli",
                )
        first, second = material.prestretch
        mounted = invariants_of_stretches(first, second, 1 / (first * second))
        where = ("materials", name, "prestretch")
        if material.extension(mounted, material.values) >= 1:
            raise ValueAt(where, f"{material.law} reaches its limiting stretch before this one")
        if thickness_range(material, first, second) is None:
            raise ValueAt(
                where,
                f"{material.law} with these parameters is unstable at this stretch: there is no "
                "thickness at which the transverse stress vanishes",
            )
        for stretch in () if material.conducts else (1.0, (first * second) ** 0.5):
            if (value := material.permittivity.at(stretch)) < 1:
                raise ValueAt(
                    ("materials", name, "relative_permittivity"),
                    f"must be at least 1, that of vacuum; it is {value:.4g} at the stretch "
                    f"{stretch:.4g}",
                )
