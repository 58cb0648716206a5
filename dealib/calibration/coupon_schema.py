"""The file that says which tests of a material are fitted, and by which laws."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from dealib.calibration.schema import INTERVALS, Intervals
from dealib.config.schema import Name
from dealib.data.schema import Amount, Reading
from dealib.errors import ValueAt, did_you_mean
from dealib.materials.coupon import MODES
from dealib.materials.laws import LAWS
from dealib.materials.permittivity import RelativePermittivity
from dealib.section import Section
from dealib.units import Length, Rate, Stress, Time, list_of


class Specimen(Section):
    """Dimensions before the test, by which force and elongation become stress and stretch."""

    length: Length | None = Field(None, gt=0, description="gauge length, between marks or clamps")
    width: Length | None = Field(None, gt=0, description="width of the specimen, across the load")
    thickness: Length | None = Field(None, gt=0, description="thickness of the sheet")


class Relaxation(Section):
    """A test of stress against time: stretched once, then held."""

    stretch: float = Field(gt=0, description="stretch that is held")
    ramp: Time = Field(gt=0, description="time in which it is reached, from the first instant on")


class Test(Reading):
    """One measured test; columns stretch, strain or elongation, stress or force, and time."""

    mode: Literal["uniaxial", "equal-biaxial", "pure shear"] = Field(
        "uniaxial", description="pure shear: a wide strip that keeps its width"
    )
    specimen: Specimen = Specimen()
    rate: Rate | None = Field(
        None,
        gt=0,
        description="of the stretch, where the file has no time; without both the test counts as "
        "infinitely slow",
    )
    path: tuple[Annotated[float, Field(gt=0)], ...] = Field(
        (),
        description="stretches between which it was driven, from 1 on, such as [1, 2.5, 1]; "
        "default where the data turn",
    )
    relaxation: Relaxation | None = Field(None, description="for files without a stretch")
    sigma: dict[str, Amount] = Field(
        {},
        description="standard deviation of the noise by quantity; default 1 % of the stress's "
        "range and none of the stretch",
    )
    weight: float = Field(1.0, gt=0, description="factor on the residuals of this test")

    @field_validator("mode", mode="before")
    @classmethod
    def _mode(cls, mode: object) -> object:
        if mode not in MODES:  # the nearest word to biaxial is uniaxial
            raise ValueError(f"{mode!r} is not allowed; one of {', '.join(MODES)}")
        return mode

    @model_validator(mode="after")
    def _one_clock(self) -> Test:
        if self.rate is not None and self.relaxation is not None:
            raise ValueAt(("rate",), "a relaxation has its own ramp; drop rate")
        return self


class Wanted(Section):
    """What may describe the material, and what is known of it."""

    laws: tuple[str, ...] = Field(tuple(LAWS), min_length=1, description="laws that are tried")
    ogden_terms: int = Field(2, ge=1, le=4, description="most terms of the law ogden; fewer tried")
    branches: list_of(int) = Field(  # type: ignore[valid-type]
        (0,), description="number of Maxwell branches; of several the criterion chooses"
    )
    evolution: Literal["multiplicative", "network"] = Field(
        "multiplicative", description="evolution of the branches, as in a config"
    )
    mullins: bool | Literal["auto"] = Field(
        False, description="softening below the largest energy so far; auto: if the data show it"
    )
    permanent_set: bool | Literal["auto"] = Field(
        False, description="a second network that re-forms under load; auto: if the data show it"
    )
    stretch_max: float | None = Field(
        None,
        gt=1,
        description="up to which the law must be stable in all modes; default the largest measured",
    )
    bulk_modulus: Stress | None = Field(
        None, gt=0, description="default 1000 shear moduli: incompressible, as in the fit"
    )
    relative_permittivity: RelativePermittivity | None = Field(
        None, description="if known: the material is then complete for a film"
    )

    @field_validator("laws")
    @classmethod
    def _known(cls, laws: tuple[str, ...]) -> tuple[str, ...]:
        for i, law in enumerate(laws):
            if law not in LAWS:
                raise ValueAt((i,), f"unknown law {law!r}{did_you_mean(law, LAWS)}")
        return laws

    @field_validator("branches")
    @classmethod
    def _few(cls, branches: tuple[int, ...]) -> tuple[int, ...]:
        if not all(0 <= n <= 6 for n in branches):
            raise ValueError("expected numbers from 0 to 6")
        return branches


class CouponMethod(Section):
    """How the fit is done: Levenberg-Marquardt from several starts."""

    criterion: Literal["AICc", "BIC"] = Field(
        "AICc", description="information criterion by which the best law is chosen"
    )
    confidence: float = Field(0.95, gt=0.5, lt=1, description="level of the intervals")
    intervals: Intervals = Field("auto", description=INTERVALS)
    max_evaluations: int = Field(200, ge=2, description="most evaluations from each start")


class CouponOutput(Section):
    """Where results go."""

    directory: str | None = Field(None, description="directory of the results; default runs/NAME")
    library: str | None = Field(
        None, description="YAML file of materials, beside this one, to which the result is added"
    )
    material: Name | None = Field(None, description="its name there; default that of the fit")


class Coupon(Section):
    """A coupon fit: tests of a material, and the laws that may describe it."""

    name: Name = Field(description="short name; also the default directory")
    description: str = Field("", description="one line, shown in report and library")
    tests: tuple[Test, ...] = Field(min_length=1)
    material: Wanted = Wanted()
    method: CouponMethod = CouponMethod()
    output: CouponOutput = CouponOutput()

    @property
    def directory(self) -> str:
        """Directory of the results."""
        return os.path.expanduser(self.output.directory or f"runs/{self.name}")

    @property
    def material_name(self) -> str:
        """Name of the result in a library."""
        return self.output.material or self.name

    def library(self, path: Path) -> Path | None:
        """The library that the result of a fit in a file is added to."""
        name = self.output.library
        return None if name is None else path.parent / Path(name).expanduser()
