"""The schema of a config: frozen models; in the file every dimensional value has its unit."""

from __future__ import annotations

import os
from functools import cached_property
from pathlib import Path

from pydantic import Field, model_validator

from dealib.config.bias import check_second_films
from dealib.config.follow import check_branches
from dealib.config.materials import Material, Materials, check_materials
from dealib.config.names import Name
from dealib.config.probes import Probe, check_probes
from dealib.config.program import Stage, check_held, check_inputs, check_steps
from dealib.config.sensing import Sensing, check_sensing
from dealib.config.settings import Damping, Limits, Mesh, Output, Physics, Solver
from dealib.config.stop import Condition, check_conditions
from dealib.config.tables import Tables
from dealib.config.wave import reach
from dealib.device import msh
from dealib.device.assembly import Sections, device
from dealib.device.device import Device
from dealib.device.ports import Chamber, Hold, Mount, Terminal
from dealib.device.shapes import AnnularStrips, Geometry, MeshShape
from dealib.errors import ValueAt
from dealib.section import Section


class Config(Section):
    """One run: a device, its mesh, its materials and a load program."""

    name: Name = Field(min_length=1, description="short name; also the default run directory")
    description: str = Field("", description="one line, shown in reports")
    library: str | None = Field(
        None,
        description="YAML file with your own materials, in this folder; `library` of a material "
        "may then name them",
    )
    geometry: Geometry = Field(description="shape and dimensions of the device")
    regions: dict[str, str] | None = Field(
        None,
        description="for a mesh file: the material of each region that is not named like one",
    )
    mesh: Mesh = Mesh()
    materials: Materials = Field(
        min_length=1, description="materials by name; a region has the material of its name"
    )
    terminals: dict[str, Terminal] | None = Field(
        None, description="electrodes by name; default those of the shape"
    )
    mounts: dict[str, Mount] | None = Field(
        None, description="rigid moving parts by name; default that of the shape"
    )
    holds: tuple[Hold, ...] | None = Field(
        None, description="fixed boundaries; default those of the shape"
    )
    chambers: dict[str, Chamber] | None = Field(None, description="enclosed volumes by name")
    probes: dict[Name, Probe] | None = Field(
        None, description="additional columns of the history, by name"
    )
    physics: Physics = Physics()
    damping: Damping = Damping()
    limits: Limits = Limits()
    sensing: Sensing = Sensing()
    solver: Solver = Solver()
    program: tuple[Stage, ...] = Field(min_length=1)
    stop_when: tuple[Condition, ...] = Field((), description="conditions that end the run")
    output: Output = Output()
    tables: Tables | None = Field(
        None, description="tables for system simulation; see dealib export"
    )

    @property
    def directory(self) -> str:
        """Run directory."""
        return os.path.expanduser(self.output.directory or f"runs/{self.name}")

    @property
    def mesh_file(self) -> str | None:
        """Gmsh file that replaces the generated mesh; None: the mesh is generated."""
        geometry = self.geometry
        return geometry.file if isinstance(geometry, MeshShape) else self.mesh.file

    @cached_property
    def device(self) -> Device:
        """The device: regions, ports and supports; the names of a mesh file are read from it."""
        names = None
        if isinstance(self.geometry, MeshShape):
            names = msh.physical_names(Path(self.geometry.file))
        sections = Sections(self.terminals, self.mounts, self.holds, self.chambers, self.regions)
        conductors = {name: self.conducts(name) for name in self.materials}
        sheet = self.physics.model == "membrane"
        return device(self.geometry, conductors, sections, names, sheet)

    def conducts(self, material: str) -> bool:
        """Whether a material is a conductor in this device."""
        strips = isinstance(self.geometry, AnnularStrips)
        return self.materials[material].conducts or (strips and material == "electrode")

    @property
    def solids(self) -> dict[str, Material]:
        """The materials of the device's solid regions, by name."""
        used = dict.fromkeys(region.material for region in self.device.solids)
        return {name: self.materials[name] for name in used if name is not None}

    @property
    def moves(self) -> bool:
        """Whether a stage of the program is dynamic."""
        return any(stage.dynamic for stage in self.program)

    @property
    def film(self) -> Material:
        """The first dielectric material of the device."""
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
                problem = "a prestrain stage cannot be stopped early"
                raise ValueAt(("program", 0, "stop_when"), problem)
        check_materials(self.materials)
        if self.physics.formulation == "mixed" and self.mesh.order != 2:
            raise ValueAt(("mesh", "order"), "physics.formulation: mixed needs order 2")
        if self.physics.wrinkling != "taut" and self.physics.model != "membrane":
            raise ValueAt(("physics", "wrinkling"), "tension_field needs physics.model: membrane")
        if self.physics.model == "membrane":
            if self.physics.formulation == "mixed":
                where = ("physics", "formulation")
                raise ValueAt(where, "a membrane has plane stress: use formulation: displacement")
            if isinstance(self.geometry, MeshShape):
                raise ValueAt(("physics", "model"), "membrane: only for laminates")
        if self.mesh.file is not None and not isinstance(self.geometry, AnnularStrips):
            raise ValueAt(
                ("mesh", "file"), "only for annular_strips; otherwise use geometry.shape: mesh"
            )
        if not isinstance(self.geometry, MeshShape):  # `load` finds its file first
            self.check_device()
        return self

    def check_device(self) -> None:
        """Raise `ValueAt` if a section does not fit the device."""
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
            raise ValueAt(("physics", "coupling"), "only energy unless the shape is annular_strips")
        if self.regions is not None and not isinstance(self.geometry, MeshShape):
            raise ValueAt(("regions",), "only for geometry.shape: mesh; layers name their material")
        check_inputs(self.program, self.device)
        check_held(self.program, self.device)
        check_steps(self)
        if self.moves:
            self.check_density()
        check_probes(self)
        check_conditions(self)
        check_sensing(self)
        self._air_above_stroke()
        if self.tables is not None:
            self.tables.check(self)
        check_branches(self)
        if self.output.modes and self.physics.coupling != "energy":
            raise ValueAt(("output", "modes"), "needs physics.coupling: energy")
        check_second_films(self)

    def check_density(self) -> None:
        """Raise `ValueAt` if a material of the device has no density."""
        for name, material in self.solids.items():
            if material.density is None:
                problem = "this key is missing; inertia needs it, such as 960 kg/m^3"
                raise ValueAt(("materials", name, "density"), problem)

    def _air_above_stroke(self) -> None:
        """Raise `ValueAt` if a prescribed displacement nearly reaches the top of the air."""
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
                    f"{stroke:g} mm {where}; use about twice the displacement",
                )
