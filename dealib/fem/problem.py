"""The total potential of a config: energies on regions and faces, compiled once a kind."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.kinematics import Kinematics
from dealib.device.records import CHAMBER, Region
from dealib.fem import compat
from dealib.fem.branches import maxwell_branches, step_terms
from dealib.fem.chambers import chamber_energies, sides
from dealib.fem.constraints import ConstraintMap, build
from dealib.fem.couplings import COUPLINGS, Coupling
from dealib.fem.domain import Domain, Spaces, build_domain, build_spaces
from dealib.fem.energies import (
    Energy,
    Hyperelastic,
    IdealDielectric,
    MeshElasticity,
    MixedHyperelastic,
    Point,
    StretchedDielectric,
    constant,
    in_plane,
    parameters,
)
from dealib.materials import thickness_stretch
from dealib.units import EPSILON_0


@dataclass
class Group:
    """Regions of one material and direction, which share their energies.

    Attributes:
        name: Of its material and direction, or of its region.
        material: Key of `materials`; empty for air and rigid blocks.
        regions: Names.
        normal: Component across the layer.
        prestretch: Constant: stretches along the components; None where there is no pre-stretch.
    """

    name: str
    material: str
    regions: tuple[str, ...]
    normal: int
    prestretch: Any = None


@dataclass
class Problem:
    """Everything that is fixed during a run.

    Attributes:
        config: The config.
        domain: Mesh and names.
        spaces: Spaces and current state.
        constraints: Map to the reduced unknowns.
        groups: Regions that share energies.
        elastic: Elastic energies.
        electric: Electric energies.
        loads: Energies of ports that no degree of freedom follows, with the port's name.
        values: Values of these ports, as constants.
        mesh_motion: Fictitious energies that only move the air's mesh.
        coupling: How the electric field loads the body.
        locking: Constant: the share of a law's extensibility that `locked` asks for.
        branches: Potentials of the Maxwell branches over a time step.
        terms: What they depend on besides the deformation (`Viscosity` sets it); None without.
    """

    config: Config
    domain: Domain
    spaces: Spaces
    constraints: ConstraintMap
    groups: tuple[Group, ...]
    elastic: list[Energy]
    electric: list[Energy]
    loads: list[tuple[str, Energy]]
    values: dict[str, Any]
    mesh_motion: list[Energy]
    coupling: Coupling
    locking: Any
    branches: list[Energy] = field(default_factory=list)
    terms: Any = None
    _forms: dict[str, Any] = field(default_factory=dict)

    @property
    def device(self) -> Device:
        """The device."""
        return self.domain.device

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        return self.device.kinematics

    @property
    def degree(self) -> int:
        """Quadrature degree (see `quadrature_degree`)."""
        return quadrature_degree(self.spaces.order)

    @property
    def state(self) -> Any:
        """Function of the current state."""
        return self.spaces.w

    @property
    def body(self) -> list[Energy]:
        """Energies of the solids."""
        return self.elastic + self.branches

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is: one potential, and no air, whose mesh moves one-way."""
        return self.coupling.symmetric and not self.mesh_motion

    @cached_property
    def point(self) -> Point:
        """A point of the current state inside the body."""
        u, phi = ufl.split(self.spaces.w)[:2]
        x, k = ufl.SpatialCoordinate(self.domain.mesh), self.kinematics
        return Point(x, u, k.deformation_gradient(u, x), k.nominal_field(phi))

    @cached_property
    def face(self) -> Point:
        """A point of the current state on a face, its normal out of the cell."""
        N = self.kinematics.vector(ufl.FacetNormal(self.domain.mesh))
        p = self.point
        return Point(p.x, p.u, p.F, p.E, N)

    # --- integrals -------------------------------------------------------------------------------

    @cached_property
    def _tags(self) -> Any:
        return self.domain.tagged(tuple(group.regions for group in self.groups))

    def measure(self, group: str) -> Any:
        """Integration over a group of regions, in volume of the device."""
        tag = 1 + next(k for k, g in enumerate(self.groups) if g.name == group)
        return self._measure("dx", self._tags)(tag)

    def over(self, group: str, density: Any) -> Any:
        """Integral over a group of regions."""
        return density * self.kinematics.volume(self.point.x) * self.measure(group)

    def over_face(self, name: str, density: Any, *regions: str) -> Any:
        """Integral over a boundary of a density at `face`, on the side of some regions.

        Args:
            name: Of the boundary.
            density: Per mesh area.
            regions: Where the facets lie inside the mesh, one of their sides is of these.
        """
        density = density * self.kinematics.volume(self.point.x)
        tags = tuple(tag for _, tag in self.domain.tags(name))
        if sides(self.domain, name) == 1:
            return density * self._measure("ds", self.domain.facet_tags)(tags)
        mesh = self.domain.mesh
        V = compat.functionspace(mesh, compat.element(mesh, "DG", 0))
        chi = fem.Function(V, name="indicator")
        chi.x.array[compat.cell_dofs(V)[self.domain.cells(*regions), 0]] = 1.0
        both = chi("+") * density("+") + chi("-") * density("-")
        return both * self._measure("dS", self.domain.facet_tags)(tags)

    def _measure(self, sort: str, tags: Any) -> Any:
        return ufl.Measure(
            sort,
            domain=self.domain.mesh,
            subdomain_data=tags,
            metadata={"quadrature_degree": self.degree},
        )

    def potential(self, energies: list[Energy]) -> Any:
        """Sum of energies over their regions, in mJ."""
        return _sum(self.over(e.on, e.density(self.point)) for e in energies)

    def work_of(self, port: str, derive: bool = False) -> Any:
        """Potential of a port that no degree of freedom follows, or its derivative by its value."""
        value = self.values[port]
        found = [(e.on, e.density(self.face)) for name, e in self.loads if name == port]
        if derive:
            found = [(on, ufl.diff(density, value)) for on, density in found]
        solids = [region.name for region in self.device.solids]
        return _sum(self.over_face(on, density, *solids) for on, density in found)

    # --- forms -----------------------------------------------------------------------------------

    def form(self, name: str) -> Any:
        """A compiled form by name, or None where the device has no such part.

        Args:
            name: 'elastic', 'electric' (energies); 'locked' (area near a law's limit);
                'residual', 'tangent' (of both, coupled); 'mesh_residual', 'mesh_tangent' (of the
                air's fictitious elasticity); 'dual PORT', 'column PORT' (first and mixed second
                derivative of the potential by the value of a port in `values`).
        """
        if name not in self._forms:
            self._forms[name] = self._compile(name)
        return self._forms[name]

    def _compile(self, name: str) -> Any:
        W, w = self.spaces.W, self.spaces.w
        if name == "locked":
            return compat.form(self._locked_volume())
        if name in ("elastic", "electric"):
            return compat.form(self.potential(getattr(self, name)))
        kind, _, port = name.partition(" ")
        if port:
            dual = self.work_of(port, derive=True)
            if kind == "column":
                dual = ufl.derivative(dual, w, ufl.TestFunction(W))
            return compat.form(dual)
        if name.startswith("mesh"):
            if not self.mesh_motion:
                return None
            first = ufl.derivative(self.potential(self.mesh_motion), w, ufl.TestFunction(W))
        else:
            first = self.coupling.residual(self, ufl.TestFunction(W))
            for port in self.values:
                first = first + ufl.derivative(self.work_of(port), w, ufl.TestFunction(W))
        if name.endswith("residual"):
            return compat.form(first)
        return compat.form(ufl.derivative(first, w, ufl.TrialFunction(W)))

    def locked(self, share: float = 0.99) -> bool:
        """Whether a law is somewhere stretched to a share of its limit (see `Law.extension`).

        At 99 % it is dozens of times as stiff as at rest, and a body that is stretched on grows in
        volume instead; beyond 100 % the derivatives of its energy are finite but mean nothing.
        """
        if not any(part.law.locks for part in self.solids):
            return False
        self.locking.value = share
        return self.integrate("locked") > 0

    @property
    def solids(self) -> list[Hyperelastic]:
        """The hyperelastic parts."""
        parts = [getattr(part, "solid", part) for part in self.elastic]
        return [part for part in parts if isinstance(part, Hyperelastic)]

    def _locked_volume(self) -> Any:
        """Mesh area in which a law is stretched to the share `locking` of its limit."""
        F = self.point.F
        return _sum(
            ufl.conditional(ufl.ge(part.extension(F), self.locking), 1.0, 0.0)
            * self.measure(part.on)
            for part in self.solids
            if part.law.locks
        )

    def set_prestretch(self, fraction: float) -> None:
        """Pre-stretch the body by a fraction (0: none, 1: all) of the config's pre-stretches."""
        for group in self.groups:
            if group.prestretch is None:
                continue
            material = self.config.materials[group.material]
            a, b = (1 + fraction * (s - 1) for s in material.prestretch)
            stretches = np.empty(3)
            stretches[list(in_plane(group.normal))] = a, b
            stretches[group.normal] = thickness_stretch(material, a, b)
            group.prestretch.value[:] = stretches

    def set_values(self, ports: dict[str, float]) -> None:
        """Set the values of the ports that no degree of freedom follows."""
        for name, value in self.values.items():
            value.ufl_operands[0].value = ports[name]

    def integrate(self, name: str) -> float:
        """Integral of a scalar form at the current state, summed over ranks."""
        local = fem.assemble_scalar(self.form(name))
        return float(self.domain.comm.allreduce(local, op=MPI.SUM))

    @cached_property
    def force_scale(self) -> float:
        """Characteristic force, N: film modulus times the film's cross-section."""
        sizes = self.domain.sizes
        return sizes.width * sizes.thickness * self.config.film.shear_modulus_at_rest

    @cached_property
    def charge_scale(self) -> float:
        """Characteristic charge, uC: of the flat film at 1 kV."""
        sizes, film = self.domain.sizes, self.config.film
        stretch = math.sqrt(math.prod(film.prestretch))
        return float(EPSILON_0 * film.permittivity.at(stretch) * sizes.area / sizes.thickness)


def quadrature_degree(order: int) -> int:
    """Of integrals: 3 x 3 Gauss points on second-order cells, 2 x 2 on first-order."""
    return 2 * order


def _sum(terms: Iterable[Any]) -> Any:
    first, *others = terms
    return sum(others, first)


def build_problem(config: Config, comm: MPI.Comm, mesh_file: Path | None = None) -> Problem:
    """Mesh, spaces, constraints and energies of a config (collective).

    Args:
        config: The config.
        comm: MPI communicator.
        mesh_file: Where to write the mesh, if anywhere.
    """
    return problem_on(build_domain(config, comm, mesh_file), config)


def problem_on(domain: Domain, config: Config) -> Problem:
    """The same on any mesh with the names of its device (collective).

    Args:
        domain: The mesh; it need not be that of the config's geometry.
        config: Materials, order and solver.
    """
    mixed = config.physics.formulation == "mixed"
    spaces = build_spaces(domain, config.mesh.order, mixed)
    device, mesh = domain.device, domain.mesh
    groups = _groups(config, domain)
    count = max(len(m.branches) for m in config.solids.values())
    terms = step_terms(mesh, quadrature_degree(spaces.order), count) if count else None
    elastic: list[Energy] = []
    electric: list[Energy] = []
    motion: list[Energy] = []
    branches: list[Energy] = []
    for group in groups:
        material = config.materials.get(group.material)
        if material is None:
            region = device.region(group.regions[0])
            electric.append(IdealDielectric(group.name, _permittivity(mesh, region)))
            if region.air:
                stiffness = constant(mesh, config.physics.air_stiffness)
                motion.append(MeshElasticity(group.name, stiffness))
            continue
        part = Hyperelastic(group.name, material, parameters(mesh, material), group.prestretch)
        branches += maxwell_branches(part, material.branches, terms) if material.branches else []
        elastic.append(MixedHyperelastic(part, ufl.split(spaces.w)[2]) if mixed else part)
        if not config.conducts(group.material):
            electric.append(_dielectric(mesh, group, material))
    values = {p.name: ufl.variable(constant(mesh, 0.0)) for p in device.of(CHAMBER)}
    loads: list[tuple[str, Energy]] = [
        (p.name, energy)
        for p in device.of(CHAMBER)
        for energy in chamber_energies(domain, p, values[p.name])
    ]
    return Problem(
        config=config,
        domain=domain,
        spaces=spaces,
        constraints=build(domain, spaces),
        groups=groups,
        elastic=elastic,
        electric=electric,
        loads=loads,
        values=values,
        mesh_motion=motion,
        coupling=COUPLINGS[config.physics.coupling],
        locking=constant(mesh, 1.0),
        branches=branches,
        terms=terms,
    )


def _groups(config: Config, domain: Domain) -> tuple[Group, ...]:
    """Regions by material and direction, in the order of the device; dielectrics first."""
    found: dict[str, list[Region]] = {}
    for region in domain.device.regions:
        if not domain.has(region.name):
            continue
        if region.material is None:
            name = "air" if region.air else f"rigid {region.permittivity:g}"
        else:
            name = region.material
            others = found.get(name, [])
            if others and others[0].normal != region.normal:
                name = f"{name} across {region.normal}"
        found.setdefault(name, []).append(region)
    groups = []
    for name, regions in found.items():
        normal = regions[0].normal
        if normal is None:  # no layer: what is pre-stretched is so across Z
            normal = domain.device.kinematics.components.index("Z")
        stretched = None
        if (key := regions[0].material) is not None:
            material = config.materials[key]
            if not config.conducts(key) or material.prestretch != (1.0, 1.0):
                stretched = constant(domain.mesh, [1.0, 1.0, 1.0])
        key = key or ""
        groups.append(Group(name, key, tuple(r.name for r in regions), normal, stretched))

    def rank(group: Group) -> int:
        return int(config.conducts(group.material)) if group.material else 2

    return tuple(sorted(groups, key=rank))


def _permittivity(mesh: Any, region: Region) -> Any:
    assert region.permittivity is not None
    return constant(mesh, EPSILON_0 * region.permittivity)


def _dielectric(mesh: Any, group: Group, material: Any) -> Energy:
    by_stretch = material.permittivity
    fixed = constant(mesh, EPSILON_0 * by_stretch.intercept)
    if not by_stretch.slope:
        return IdealDielectric(group.name, fixed)
    slope = constant(mesh, EPSILON_0 * by_stretch.slope)
    return StretchedDielectric(group.name, fixed, slope, group.prestretch, group.normal)
