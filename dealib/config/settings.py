"""Sections of the config that all devices share: mesh, physics, solver, limits and output."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from dealib.config.names import FilePath
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import ElectricField, Length, Rate, Stress, Time, Volume


class Mesh(Section):
    """Structured cells in the layers, and unstructured quadrilaterals in the air."""

    columns: int = Field(60, ge=4, multiple_of=2, description="cells along the layers; even")
    film_rows: int = Field(4, ge=1, description="cells across each dielectric layer")
    electrode_rows: int = Field(1, ge=1, description="cells across each conducting layer")
    sectors: int = Field(
        8,
        ge=2,
        multiple_of=2,
        description="in three dimensions: cells in a quarter turn of a round base, or in half the "
        "width of a straight one; even",
    )
    grading: Literal["ends", "uniform", "tanh"] = Field(
        "ends",
        description="ends: nearly square cells at ends, clamps and edges of electrodes; tanh: the "
        "grading of the strip benchmark",
    )
    order: Literal[1, 2] = Field(2, description="polynomial order of displacement and potential")
    air_size: Length | None = Field(
        None, gt=0, description="cell size at the far side of the air; default air_height / 5"
    )
    file: FilePath | None = Field(
        None, description="for annular strips: Gmsh file to read, with the same physical names"
    )


class Physics(Section):
    """Which equations are solved."""

    coupling: Literal["energy", "maxwell_traction", "pelrine", "pelrine_undeformed"] = Field(
        "energy",
        description="energy: one electro-elastic potential; for comparison, loads on the film's "
        "electrode faces: maxwell_traction, the Maxwell stress; pelrine, eps (V/d)^2; or "
        "pelrine_undeformed, the same with the thickness at rest",
    )
    model: Literal["solid", "membrane"] = Field(
        "solid",
        description="membrane: laminates as their middle surface, without bending stiffness; the "
        "error is proportional to thickness over span",
    )
    wrinkling: Literal["taut", "tension_field"] = Field(
        "taut",
        description="for membranes; taut: they bear compression; tension_field: fine wrinkles "
        "relieve compression",
    )
    slack_stiffness: float = Field(
        1e-3,
        gt=0,
        le=0.1,
        description="for tension fields: weak springs that hold the sheet at its mounted position, "
        "so that slack parts keep some stiffness; as a share of the shear modulus",
    )
    formulation: Literal["displacement", "mixed"] = Field(
        "displacement",
        description="displacement: u and phi; mixed: u, phi and the pressure, for bulk moduli "
        "above a few thousand shear moduli",
    )
    air_stiffness: Stress = Field(
        1e-6,
        gt=0,
        description="fictitious modulus by which the mesh of the air follows the device, without "
        "effect on results",
    )


class Solver(Section):
    """Newton's method and increments; the defaults suit all shipped configs."""

    tolerance: float = Field(
        1e-9,
        gt=0,
        lt=1e-3,
        description="tolerance on the residual of each field, relative to its scale",
    )
    max_iterations: int = Field(
        12, ge=2, le=1000, description="Newton iterations (tangents) before the increment is halved"
    )
    target_iterations: int = Field(
        6, ge=1, description="increments grow again while a step needs at most so many iterations"
    )
    max_cuts: int = Field(10, ge=0, le=40, description="halvings of an increment before giving up")
    time_tolerance: float = Field(
        1e-3,
        ge=0,
        description="increments are halved until the time-integration error of a step is below "
        "this share of the branches' strain, and of the largest motion of a dynamic stage; 0: "
        "steps as given",
    )
    rho: float = Field(
        0.8,
        ge=0,
        le=1,
        description="dynamic stages: spectral radius of the time integration at infinite "
        "frequency; 1: no numerical dissipation",
    )
    predictor_order: int = Field(
        7,
        ge=0,
        le=9,
        description="highest order at which earlier states and their rates are extrapolated as "
        "the start of Newton's method; 0: start from the last state",
    )
    linear: Literal["auto", "direct", "iterative", "lu"] = Field(
        "auto",
        description="direct: LDL^T of a symmetric tangent, with the air eliminated by blocks; "
        "iterative: FGMRES with multigrid, for thick solids in three dimensions; auto: iterative "
        "above 40,000 unknowns if the film is thicker than a tenth of its span, or if the memory "
        "is too small for direct; lu: LU of the whole tangent, for comparison",
    )


class Damping(Section):
    """Rayleigh damping of motion and spectra: forces proportional to velocities."""

    mass: Rate = Field(0.0, ge=0, description="a in the damping matrix a M + b K, such as 5 1/s")
    stiffness: Time = Field(
        0.0, ge=0, description="b, such as 10 us; K is the tangent stiffness of each step"
    )


class Weibull(Section):
    """Weibull distribution of the breakdown strength: larger films fail at smaller fields."""

    strength: ElectricField = Field(
        gt=0, description="uniform field at which 63.2 % of films of the given volume fail"
    )
    shape: float = Field(gt=0, le=100, description="Weibull modulus m; larger scatters less")
    volume: Volume = Field(
        gt=0, description="undeformed volume between the electrodes of the films that were tested"
    )


class Limits(Section):
    """Limits of the film; the history has the share of each that is used, 1 at the limit."""

    breakdown_strength: ElectricField | None = Field(
        None, gt=0, description="breakdown strength of the film's material; default none"
    )
    electrode_knockdown: float = Field(
        1.0, gt=0, le=1, description="share of the breakdown strength that remains with electrodes"
    )
    stretch_max: float | None = Field(
        None, gt=1, description="largest principal stretch of the film, from its unstretched state"
    )
    weibull: Weibull | None = Field(
        None, description="scatter of the breakdown strength: adds the column failure_probability"
    )

    @property
    def breakdown(self) -> float | None:
        """Breakdown strength of the film between its electrodes, MV/m."""
        strength = self.breakdown_strength
        return None if strength is None else strength * self.electrode_knockdown

    @model_validator(mode="after")
    def _knocks_down(self) -> Limits:
        if self.breakdown_strength is None and self.electrode_knockdown != 1:
            raise ValueAt(("electrode_knockdown",), "needs breakdown_strength, which it reduces")
        return self


class Output(Section):
    """Where results go."""

    directory: FilePath | None = Field(None, description="run directory; default runs/NAME")
    fields: Literal["every", "stage", "none"] = Field(
        "every",
        description="store fields at every solved state, at the end of each stage, or never",
    )
    modes: int = Field(
        0,
        ge=0,
        le=9,
        description="monitor stability: the history gets the softest mode, and this number of the "
        "softest modes is stored where the device buckles or wrinkles; costs about two iterations "
        "per step",
    )


class Destination(Section):
    """Where results go."""

    directory: FilePath | None = Field(None, description="run directory; default runs/NAME")
