"""The config: frozen models whose every dimensional value carries its unit in the file."""

from __future__ import annotations

import os
from typing import Literal

from pydantic import Field, model_validator

from dealib.config.bias import check_second_films
from dealib.config.follow import check_branches
from dealib.config.materials import Materials
from dealib.config.names import FilePath, Name
from dealib.config.program import Stage
from dealib.config.section import Section
from dealib.config.stop import Condition, check_conditions
from dealib.config.tables import Tables
from dealib.errors import ValueAt
from dealib.materials.branches import Viscoelastic
from dealib.units import ElectricField, Length, Resistance, Stress

# --- geometry and mesh ---------------------------------------------------------------------------


class Clamps(Section):
    """Rigid dielectric blocks around both ends of the strips; the inner one is the mount."""

    width: Length = Field(gt=0, description="radial width of each block")
    height: Length = Field(gt=0, description="height above and below the middle plane")
    relative_permittivity: float = Field(3.0, ge=1, description="of the blocks")


class Geometry(Section):
    """Axisymmetric electrode - elastomer - electrode strip, as mounted, in air."""

    shape: Literal["annular_strips"] = "annular_strips"
    inner_radius: Length = Field(gt=0, description="radius of the rigid centre mount")
    outer_radius: Length = Field(gt=0, description="inner radius of the rigid frame")
    film_thickness: Length = Field(gt=0, description="as mounted, that is pre-stretched")
    electrode_thickness: Length = Field(
        ge=0, description="0 um: no electrode bodies, the film's faces are the electrodes"
    )
    air_height: Length = Field(
        0.0, ge=0, description="air above and below, from the middle plane; 0 mm: no air"
    )
    clamps: Clamps | None = Field(None, description="rigid mount and frame blocks")

    @property
    def half_thickness(self) -> float:
        """Half the thickness of all strips together, mm."""
        return self.film_thickness / 2 + self.electrode_thickness

    @model_validator(mode="after")
    def _possible(self) -> Geometry:
        if self.outer_radius <= self.inner_radius:
            raise ValueAt(
                ("outer_radius",),
                f"{self.outer_radius:g} mm must exceed inner_radius ({self.inner_radius:g} mm)",
            )
        length = self.outer_radius - self.inner_radius
        if length < 1e-6 * self.inner_radius:
            raise ValueAt(("outer_radius",), "a strip of less than a millionth of inner_radius")
        for key in ("film_thickness", "electrode_thickness"):
            if 0 < getattr(self, key) < 1e-6 * length:
                raise ValueAt(
                    (key,),
                    f"{getattr(self, key):g} mm are less than a millionth of the strips' length "
                    f"({length:g} mm); check the unit",
                )
        solid = self.half_thickness
        if self.clamps is not None:
            if self.clamps.width >= self.inner_radius:
                raise ValueAt(
                    ("clamps", "width"),
                    f"{self.clamps.width:g} mm must be below "
                    f"inner_radius ({self.inner_radius:g} mm)",
                )
            if self.clamps.height <= solid:
                raise ValueAt(
                    ("clamps", "height"),
                    f"{self.clamps.height:g} mm must exceed half the strips' "
                    f"thickness ({solid:g} mm)",
                )
            solid = self.clamps.height
        if 0 < self.air_height <= solid:
            raise ValueAt(
                ("air_height",),
                f"{self.air_height:g} mm must exceed the solid below it ({solid:g} mm), or be 0 mm",
            )
        return self


class Mesh(Section):
    """Mapped strips; free quadrilateral air that matches their edges."""

    columns: int = Field(60, ge=4, multiple_of=2, description="cells along the strips; even")
    film_rows: int = Field(4, ge=1, description="cells across the film")
    electrode_rows: int = Field(1, ge=1, description="cells across each electrode")
    grading: Literal["ends", "uniform", "tanh"] = Field(
        "ends", description="ends: nearly square cells at both ends; tanh: the benchmark's"
    )
    order: Literal[1, 2] = Field(2, description="polynomial order of displacement and potential")
    air_size: Length | None = Field(
        None, gt=0, description="cell size at the far side of the air; default air_height / 5"
    )
    file: FilePath | None = Field(
        None, description="read this Gmsh mesh instead, with the same physical names"
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
    formulation: Literal["displacement", "mixed"] = Field(
        "displacement",
        description="displacement: u and phi; mixed: u, phi and the pressure, for bulk moduli "
        "above a few thousand shear moduli",
    )
    air_stiffness: Stress = Field(
        1e-6, gt=0, description="fictitious, carries the air's mesh; results do not depend on it"
    )


class Solver(Section):
    """Newton's method and increments; the defaults serve all shipped configs."""

    tolerance: float = Field(
        1e-9, gt=0, lt=1e-3, description="on the residual of each field, relative to its scale"
    )
    max_iterations: int = Field(
        12, ge=2, le=1000, description="Newton iterations before a cut-back"
    )
    target_iterations: int = Field(
        6, ge=1, description="increments grow back while a step needs at most this many"
    )
    max_cuts: int = Field(10, ge=0, le=40, description="halvings of an increment before giving up")
    time_tolerance: float = Field(
        1e-3,
        ge=0,
        description="on the strain of Maxwell branches in a step, by which increments are cut; 0: "
        "never, steps as given",
    )
    predictor_order: int = Field(
        3, ge=0, le=4, description="highest order of the extrapolation; 0: from the last state"
    )
    linear: Literal["auto", "lu"] = Field(
        "auto",
        description="auto: LDL^T where the tangent is symmetric, with air by blocks; "
        "lu: LU of the whole tangent, for comparison",
    )


class Limits(Section):
    """What the film bears; the history then says how much of it is used, 1 being the limit."""

    breakdown_strength: ElectricField | None = Field(
        None, gt=0, description="of the film's material; default none"
    )
    electrode_knockdown: float = Field(
        1.0, gt=0, le=1, description="share of the strength that is left between real electrodes"
    )
    stretch_max: float | None = Field(
        None, gt=1, description="largest principal stretch of the film, from its unstretched state"
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


class Sensing(Section):
    """What a driver or a sensor sees of the device: further columns of the history."""

    differential: bool = Field(
        False, description="small-signal capacitances and stiffness; costs one more tangent a step"
    )
    sheet_resistance: Resistance | None = Field(
        None, gt=0, description="of each electrode as mounted, in ohm per square; default none"
    )
    area_exponent: float = Field(
        1.0, ge=0, description="n: it grows as (area ratio)^n; 1: constant volume and resistivity"
    )
    contact: Literal["inner", "outer"] = Field(
        "outer", description="edge at which both electrodes are contacted"
    )


# --- the whole -----------------------------------------------------------------------------------


class Output(Section):
    """Where results go."""

    directory: FilePath | None = Field(None, description="default runs/NAME")
    fields: Literal["every", "stage", "none"] = Field(
        "every", description="store fields each step, at the end of each stage, or never"
    )


class Config(Section):
    """One run: a device, its mesh, its materials and a load program."""

    name: Name = Field(min_length=1, description="short name; also the default run directory")
    description: str = Field("", description="one line, shown in reports")
    library: str | None = Field(
        None,
        description="YAML file of materials of your own, beside this one; they are then known to "
        "`library` of a material, as the published ones are",
    )
    geometry: Geometry
    mesh: Mesh = Mesh()
    materials: Materials
    physics: Physics = Physics()
    limits: Limits = Limits()
    sensing: Sensing = Sensing()
    solver: Solver = Solver()
    program: tuple[Stage, ...] = Field(min_length=1)
    stop_when: tuple[Condition, ...] = Field(
        (), description="ends the run at a state that meets one"
    )
    output: Output = Output()
    tables: Tables | None = Field(None, description="for system simulation; see dealib export")

    @property
    def directory(self) -> str:
        """Run directory."""
        return os.path.expanduser(self.output.directory or f"runs/{self.name}")

    @property
    def solids(self) -> dict[str, Viscoelastic]:
        """The materials that are in the device."""
        m = self.materials
        bodies = self.geometry.electrode_thickness > 0
        return {"film": m.film} | ({"electrode": m.electrode} if bodies and m.electrode else {})

    @model_validator(mode="after")
    def _consistent(self) -> Config:
        if self.geometry.electrode_thickness > 0 and self.materials.electrode is None:
            raise ValueAt(
                ("materials", "electrode"),
                "this key is missing, but geometry.electrode_thickness is above zero",
            )
        for i, stage in enumerate(self.program[1:], start=1):
            if stage.stage == "prestrain":
                raise ValueAt(("program", i, "stage"), "prestrain can only be the first stage")
        first = self.program[0]
        for port in ("mount", "terminal"):
            if first.stage == "prestrain" and getattr(first, port) is not None:
                raise ValueAt(("program", 0, port), "a prestrain stage takes no input")
        if first.stage == "prestrain" and first.stop_when:
            raise ValueAt(("program", 0, "stop_when"), "a prestrain stage always comes to its end")
        check_conditions(self)
        if self.physics.formulation == "mixed" and self.mesh.order != 2:
            raise ValueAt(("mesh", "order"), "physics.formulation: mixed needs order 2")
        self._air_above_stroke()
        if self.tables is not None and self.physics.coupling != "energy":
            raise ValueAt(("physics", "coupling"), "tables come from one potential: energy only")
        for region, law in self.solids.items() if self.tables is not None else ():
            if law.branches:
                where = f"materials.{region} has branches"
                raise ValueAt(("tables",), f"{where}: its force depends on time, which tables lack")
        check_branches(self.program, self.physics.coupling, self.solids)
        check_second_films(self)
        return self

    def _air_above_stroke(self) -> None:
        """The air must stay higher than a prescribed displacement of what it covers."""
        g = self.geometry
        if g.air_height == 0:
            return
        below = g.clamps.height if g.clamps else g.half_thickness
        given: list[tuple[str, tuple[float, ...]]] = []
        for stage in self.program:
            values = (stage.mount and stage.mount.displacement) or ()
            if stage.follow is not None and stage.follow.pair[1] == "displacement":
                values = (stage.follow.until.displacement or 0.0,)
            given.append((f"in stage {stage.stage!r}", values))
        if self.tables is not None:
            given.append(("in tables", self.tables.displacement))
        for where, values in given:
            stroke = max(map(abs, values), default=0.0)
            if stroke >= 0.9 * (g.air_height - below):
                raise ValueAt(
                    ("geometry", "air_height"),
                    f"{g.air_height:g} mm of air are too low for the displacement of "
                    f"{stroke:g} mm {where}; twice the stroke works well",
                )
