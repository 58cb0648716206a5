"""Sections of numbers and choices that all devices share."""

from __future__ import annotations

from typing import Literal

from pydantic import Field, model_validator

from dealib.config.names import FilePath
from dealib.errors import ValueAt
from dealib.section import Section
from dealib.units import ElectricField, Length, Rate, Stress, Time, Volume

# --- mesh -----------------------------------------------------------------------------------------


class Mesh(Section):
    """Mapped layers; free quadrilateral air that matches their edges."""

    columns: int = Field(60, ge=4, multiple_of=2, description="cells along the layers; even")
    film_rows: int = Field(4, ge=1, description="cells across each dielectric layer")
    electrode_rows: int = Field(1, ge=1, description="cells across each conducting layer")
    sectors: int = Field(
        8,
        ge=2,
        multiple_of=2,
        description="in three dimensions: cells in a quarter of a turn, or half of them across; "
        "even",
    )
    grading: Literal["ends", "uniform", "tanh"] = Field(
        "ends",
        description="ends: nearly square cells at ends, clamps and electrodes' edges; tanh: the "
        "benchmark's",
    )
    order: Literal[1, 2] = Field(2, description="polynomial order of displacement and potential")
    air_size: Length | None = Field(
        None, gt=0, description="cell size at the far side of the air; default air_height / 5"
    )
    file: FilePath | None = Field(
        None, description="of annular strips: read this Gmsh mesh, with the same physical names"
    )


# --- physics and solver --------------------------------------------------------------------------


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
        description="membrane: laminates only, on the middle surface, without bending; the "
        "deviation is linear in the thickness over the span",
    )
    wrinkling: Literal["taut", "tension_field"] = Field(
        "taut",
        description="for membranes; taut: they bear compression; tension_field: they wrinkle "
        "finely where they would be pressed",
    )
    slack_stiffness: float = Field(
        1e-3,
        gt=0,
        le=0.1,
        description="for tension fields: share of the shear modulus with which springs hold the "
        "sheet where it was mounted, so that no part of it is without stiffness",
    )
    formulation: Literal["displacement", "mixed"] = Field(
        "displacement",
        description="displacement: u and phi; mixed: u, phi and the pressure, for bulk moduli "
        "above a few thousand shear moduli",
    )
    air_stiffness: Stress = Field(
        1e-6,
        gt=0,
        description="fictitious modulus that moves the mesh of the air, without effect on results",
    )


class Solver(Section):
    """Newton's method and increments; the defaults serve all shipped configs."""

    tolerance: float = Field(
        1e-9,
        gt=0,
        lt=1e-3,
        description="tolerance on the residual of each field, relative to its scale",
    )
    max_iterations: int = Field(
        12, ge=2, le=1000, description="Newton iterations (tangents) before a cut-back"
    )
    target_iterations: int = Field(
        6, ge=1, description="increments grow back while a step needs at most this many"
    )
    max_cuts: int = Field(10, ge=0, le=40, description="halvings of an increment before giving up")
    time_tolerance: float = Field(
        1e-3,
        ge=0,
        description="increments are cut until the error of a step is below this share: of the "
        "strain of branches, and of the largest motion of a dynamic stage; 0: steps as given",
    )
    rho: float = Field(
        0.8,
        ge=0,
        le=1,
        description="dynamic stages: spectral radius for the fastest vibrations; 1: no "
        "numerical dissipation",
    )
    predictor_order: int = Field(
        7,
        ge=0,
        le=9,
        description="highest order of the extrapolation of states and their rates; 0: from the "
        "last state",
    )
    linear: Literal["auto", "direct", "iterative", "lu"] = Field(
        "auto",
        description="direct: LDL^T where the tangent is symmetric, with air by blocks; iterative: "
        "FGMRES with multigrid, for thick solids in three dimensions; auto: iterative above 40,000 "
        "unknowns if the film is thicker than a tenth of its span, or if the memory is too small "
        "for direct; lu: LU of the whole tangent, for comparison",
    )


class Damping(Section):
    """Rayleigh damping of motion and spectra: forces proportional to velocities."""

    mass: Rate = Field(0.0, ge=0, description="a of the damping matrix a M + b K, such as 5 1/s")
    stiffness: Time = Field(
        0.0, ge=0, description="b, such as 10 us; K is the stiffness of each step"
    )


class Weibull(Section):
    """Strengths that scatter from place to place: larger films fail at smaller fields."""

    strength: ElectricField = Field(
        gt=0, description="uniform field at which 63.2 % of films of the given volume fail"
    )
    shape: float = Field(gt=0, le=100, description="Weibull modulus m; larger scatters less")
    volume: Volume = Field(
        gt=0, description="volume that was tested: between the electrodes, undeformed"
    )


class Limits(Section):
    """Limits of the film; the history has the used share of each, 1 being the limit."""

    breakdown_strength: ElectricField | None = Field(
        None, gt=0, description="breakdown strength of the film's material; default none"
    )
    electrode_knockdown: float = Field(
        1.0, gt=0, le=1, description="share of the breakdown strength that real electrodes leave"
    )
    stretch_max: float | None = Field(
        None, gt=1, description="largest principal stretch of the film, from its unstretched state"
    )
    weibull: Weibull | None = Field(
        None, description="breakdown as a matter of chance: adds the column failure_probability"
    )

    @property
    def breakdown(self) -> float | None:
        """Field that the film bears between its electrodes, MV/m."""
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
        "every", description="store fields each step, at the end of each stage, or never"
    )
    modes: int = Field(
        0,
        ge=0,
        le=9,
        description="watch stability: the history tells the softest mode, and where the device "
        "buckles or wrinkles, so many of the softest modes are stored; costs about two iterations "
        "a step",
    )


class Destination(Section):
    """Where results go."""

    directory: FilePath | None = Field(None, description="run directory; default runs/NAME")
