"""The config: frozen models whose every dimensional value carries its unit in the file."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path
from typing import Literal

from pydantic import Field, model_validator

from dealib.config.bias import check_second_films
from dealib.config.follow import check_branches
from dealib.config.materials import Material, Materials, check_materials
from dealib.config.names import FilePath, Name
from dealib.config.probes import Probe, check_probes
from dealib.config.program import Stage, check_inputs
from dealib.config.stop import Condition, check_conditions
from dealib.config.tables import Tables
from dealib.config.wave import reach
from dealib.device import msh
from dealib.device.assembly import Sections, device
from dealib.device.device import Device
from dealib.device.ports import Chamber, Hold, Mount, Terminal
from dealib.device.records import TERMINAL
from dealib.device.shapes import AnnularStrips, Geometry, MeshShape
from dealib.errors import ValueAt, did_you_mean
from dealib.section import Section
from dealib.units import ElectricField, Length, Rate, Resistance, Stress, Time

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
        description="membrane: of laminates, on the middle surface, without bending; the deviation "
        "is linear in the thickness over the span",
    )
    wrinkling: Literal["taut", "tension_field"] = Field(
        "taut",
        description="of membranes; taut: they bear compression; tension_field: they wrinkle finely "
        "where they would be pressed",
    )
    slack_stiffness: float = Field(
        1e-3,
        gt=0,
        le=0.1,
        description="of tension fields: share of the shear modulus with which springs hold the "
        "sheet where it was mounted, so that no part of it is without stiffness",
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
        description="on the strain of Maxwell branches in a step, and on the motion of a dynamic "
        "one over the largest motion of its stage, by which increments are cut; 0: never, steps "
        "as given",
    )
    rho: float = Field(
        0.8,
        ge=0,
        le=1,
        description="of dynamic stages: share that the fastest vibrations keep in a step; 1: no "
        "algorithmic dissipation",
    )
    predictor_order: int = Field(
        3, ge=0, le=4, description="highest order of the extrapolation; 0: from the last state"
    )
    linear: Literal["auto", "direct", "iterative", "lu"] = Field(
        "auto",
        description="direct: LDL^T where the tangent is symmetric, with air by blocks; iterative: "
        "FGMRES with multigrid, for thick solids in three dimensions; auto: iterative above 40,000 "
        "unknowns if the film is thicker than a tenth of its span, or if the memory is too small "
        "for direct; lu: LU of the whole tangent, for comparison",
    )


class Damping(Section):
    """Rayleigh damping of what moves in time: forces in proportion to velocities."""

    mass: Rate = Field(0.0, ge=0, description="a of the damping a M + b K, such as 5 1/s")
    stiffness: Time = Field(
        0.0, ge=0, description="b, such as 10 us; K is the stiffness of each step"
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
    charging: bool = Field(
        False,
        description="the electrodes charge through it in time, from the contact on; needs "
        "sheet_resistance",
    )
    contact: str | None = Field(
        None, description="end of the base at which both electrodes are contacted; default the last"
    )


# --- the whole -----------------------------------------------------------------------------------


class Output(Section):
    """Where results go."""

    directory: FilePath | None = Field(None, description="default runs/NAME")
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


class Config(Section):
    """One run: a device, its mesh, its materials and a load program."""

    name: Name = Field(min_length=1, description="short name; also the default run directory")
    description: str = Field("", description="one line, shown in reports")
    library: str | None = Field(
        None,
        description="YAML file of materials of your own, beside this one; they are then known to "
        "`library` of a material, as the published ones are",
    )
    geometry: Geometry = Field(description="what the device is made of: by `shape`")
    regions: dict[str, str] | None = Field(
        None, description="of an own mesh: materials of regions whose names are no materials"
    )
    mesh: Mesh = Mesh()
    materials: Materials = Field(min_length=1, description="by region")
    terminals: dict[str, Terminal] | None = Field(
        None, description="electrodes by name; default those that the base brings"
    )
    mounts: dict[str, Mount] | None = Field(
        None, description="rigid moving parts by name; default those that the base brings"
    )
    holds: tuple[Hold, ...] | None = Field(
        None, description="what does not move; default what the base brings"
    )
    chambers: dict[str, Chamber] | None = Field(None, description="closed spaces by name")
    probes: dict[Name, Probe] | None = Field(
        None, description="what else the history has, each a column of its name and unit"
    )
    physics: Physics = Physics()
    damping: Damping = Damping()
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
    def mesh_file(self) -> str | None:
        """Gmsh file that is read instead of meshing."""
        geometry = self.geometry
        return geometry.file if isinstance(geometry, MeshShape) else self.mesh.file

    @cached_property
    def device(self) -> Device:
        """What it describes: regions, ports, supports; of a mesh file, its names are read."""
        names = None
        if isinstance(self.geometry, MeshShape):
            names = msh.physical_names(Path(self.geometry.file))
        sections = Sections(self.terminals, self.mounts, self.holds, self.chambers, self.regions)
        conductors = {name: self.conducts(name) for name in self.materials}
        sheet = self.physics.model == "membrane"
        return device(self.geometry, conductors, sections, names, sheet)

    def conducts(self, material: str) -> bool:
        """Whether a material is a conductor here."""
        strips = isinstance(self.geometry, AnnularStrips)
        return self.materials[material].conducts or (strips and material == "electrode")

    @property
    def solids(self) -> dict[str, Material]:
        """The materials that are in the device."""
        used = dict.fromkeys(region.material for region in self.device.solids)
        return {name: self.materials[name] for name in used if name is not None}

    @property
    def moves(self) -> bool:
        """Whether a stage of the program is dynamic."""
        return any(stage.dynamic for stage in self.program)

    @property
    def film(self) -> Material:
        """The first dielectric material that is in the device."""
        return next(m for name, m in self.solids.items() if not self.conducts(name))

    @model_validator(mode="after")
    def _consistent(self) -> Config:
        for i, stage in enumerate(self.program[1:], start=1):
            if stage.stage == "prestrain":
                raise ValueAt(("program", i, "stage"), "prestrain can only be the first stage")
        first = self.program[0]
        if first.stage == "prestrain":
            for path, *_ in first.inputs:
                raise ValueAt(("program", 0, *path), "a prestrain stage takes no input")
            if first.stop_when:
                problem = "a prestrain stage always comes to its end"
                raise ValueAt(("program", 0, "stop_when"), problem)
        check_materials(self.materials)
        if self.physics.formulation == "mixed" and self.mesh.order != 2:
            raise ValueAt(("mesh", "order"), "physics.formulation: mixed needs order 2")
        if self.physics.wrinkling != "taut" and self.physics.model != "membrane":
            raise ValueAt(("physics", "wrinkling"), "tension_field is for physics.model: membrane")
        if self.physics.model == "membrane":
            if self.physics.formulation == "mixed":
                where = ("physics", "formulation")
                raise ValueAt(where, "a membrane needs no pressure: it is thin, and free across")
            if isinstance(self.geometry, MeshShape):
                raise ValueAt(("physics", "model"), "membrane: only of laminates")
        if self.mesh.file is not None and not isinstance(self.geometry, AnnularStrips):
            raise ValueAt(("mesh", "file"), "only of annular_strips; else geometry.shape: mesh")
        if not isinstance(self.geometry, MeshShape):  # whose file is found by `load`
            self.check_device()
        return self

    def check_device(self) -> None:
        """Raise `ValueAt` for what does not fit the device."""
        if isinstance(self.geometry, AnnularStrips):
            thick, known = self.geometry.electrode_thickness > 0, self.materials
            if thick and "electrode" not in known:
                raise ValueAt(
                    ("materials", "electrode"),
                    "this key is missing, but geometry.electrode_thickness is above zero",
                )
            if "film" in known and known["film"].conducts:
                raise ValueAt(
                    ("materials", "film", "relative_permittivity"),
                    "this key is missing; without it the film would be a conductor",
                )
        elif self.physics.coupling != "energy":
            raise ValueAt(("physics", "coupling"), "other devices than annular_strips: energy only")
        if self.regions is not None and not isinstance(self.geometry, MeshShape):
            raise ValueAt(("regions",), "only of geometry.shape: mesh; a layer names its material")
        check_inputs(self.program, self.device)
        if self.moves:
            self.check_density()
        check_probes(self)
        check_conditions(self)
        self._one_ladder()
        self._air_above_stroke()
        if self.tables is not None:
            self.tables.check(self)
        check_branches(self)
        if self.output.modes and self.physics.coupling != "energy":
            raise ValueAt(("output", "modes"), "needs physics.coupling: energy")
        check_second_films(self)

    def check_density(self) -> None:
        """Raise `ValueAt` if a material in the device has no density."""
        for name, material in self.solids.items():
            if material.density is None:
                problem = "this key is missing; what moves in time needs it, such as 960 kg/m^3"
                raise ValueAt(("materials", name, "density"), problem)

    def _one_ladder(self) -> None:
        """Resistances are those of the electrodes on one film, along a line."""
        charging = ("sensing", "charging")
        if self.sensing.sheet_resistance is None:
            if self.sensing.charging:
                raise ValueAt(charging, "needs sensing.sheet_resistance")
            return
        for other, there in {
            "sensing.differential": self.sensing.differential,
            "output.modes": self.output.modes > 0,
            "a stage with follow": any(s.follow is not None for s in self.program),
            "another coupling than energy": self.physics.coupling != "energy",
        }.items():
            if self.sensing.charging and there:
                raise ValueAt(charging, f"does not go with {other}, which is of equilibria")
        device, contact = self.device, self.sensing.contact
        laminate, space = device.laminate, device.kinematics
        lines = space.dim == 2 and not space.sheet and len(device.of(TERMINAL)) == 1
        if laminate is None or not lines:
            where = ("sensing", "sheet_resistance")
            raise ValueAt(where, "only of a laminate in two dimensions with one terminal")
        ends = [end for end in laminate.base.ends if end is not None]
        if contact is not None and contact not in ends:
            where = ("sensing", "contact")
            raise ValueAt(where, f"the base has no end {contact!r}{did_you_mean(contact, ends)}")

    def _air_above_stroke(self) -> None:
        """The air must stay higher than a prescribed displacement of what it covers."""
        laminate = self.device.laminate
        if laminate is None or laminate.air_height == 0:
            return
        below = laminate.blocks.height if laminate.blocks else laminate.thickness / 2
        given: list[tuple[str, tuple[float, ...]]] = []
        for stage in self.program:
            where = f"in stage {stage.stage!r}"
            moved = (getattr(item, "displacement", None) for *_, item in stage.inputs)
            given += [(where, reach(course)) for course in moved if course]
            if stage.follow is not None and stage.follow.pair[1] == "displacement":
                given.append((where, (stage.follow.until["displacement"],)))
        if self.tables is not None:
            given.append(("in tables", self.tables.axes.get("displacement", ())))
        for where, reached in given:
            stroke = max(map(abs, reached), default=0.0)
            if stroke >= 0.9 * (laminate.air_height - below):
                raise ValueAt(
                    ("geometry", "air_height"),
                    f"{laminate.air_height:g} mm of air are too low for the displacement of "
                    f"{stroke:g} mm {where}; twice the stroke works well",
                )
