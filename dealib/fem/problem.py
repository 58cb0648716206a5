"""The total potential of a config: energies by region, compiled once a kind of problem."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem

from dealib.config.schema import Config
from dealib.fem import compat
from dealib.fem.branches import maxwell_branches, step_terms
from dealib.fem.constraints import ConstraintMap, build
from dealib.fem.couplings import COUPLINGS, Coupling
from dealib.fem.device import KIND_TAGS, Device, Spaces, build_device, build_spaces
from dealib.fem.energies import (
    Energy,
    Hyperelastic,
    IdealDielectric,
    MeshElasticity,
    MixedHyperelastic,
    StretchedDielectric,
    constant,
    parameters,
)
from dealib.fem.kinematics import Axisymmetric
from dealib.geometry import names
from dealib.geometry.supports import Support, supports
from dealib.materials import thickness_stretch
from dealib.units import EPSILON_0


@dataclass
class Problem:
    """Everything that is fixed during a run.

    Attributes:
        config: The config.
        device: Mesh and names.
        spaces: Spaces and current state.
        constraints: Map to the reduced unknowns.
        kinematics: F and E from u and phi.
        elastic: Elastic energies.
        electric: Electric energies.
        mesh_motion: Fictitious energies that only move the air's mesh.
        prestretch: Constant (radial, thickness, hoop) of the film.
        coupling: How the electric field loads the body.
        locking: Constant: the share of a law's extensibility that `locked` asks for.
        branches: Potentials of the Maxwell branches over a time step.
        terms: What they depend on besides the deformation (`Viscosity` sets it); None without.
    """

    config: Config
    device: Device
    spaces: Spaces
    constraints: ConstraintMap
    kinematics: Axisymmetric
    elastic: list[Energy]
    electric: list[Energy]
    mesh_motion: list[Energy]
    prestretch: Any
    coupling: Coupling
    locking: Any
    branches: list[Energy] = field(default_factory=list)
    terms: Any = None
    _forms: dict[str, Any] = field(default_factory=dict)

    @property
    def degree(self) -> int:
        """Quadrature degree (see `quadrature_degree`)."""
        return quadrature_degree(self.spaces.order)

    @property
    def body(self) -> list[Energy]:
        """Energies of the solids."""
        return self.elastic + self.branches

    @property
    def symmetric(self) -> bool:
        """Whether the tangent is: one potential, and no air, whose mesh moves one-way."""
        return self.coupling.symmetric and not self.mesh_motion

    def fields(self) -> tuple[Any, Any]:
        """Deformation gradient F and nominal field E of the current state."""
        u, phi = ufl.split(self.spaces.w)[:2]
        return self.kinematics.deformation_gradient(u), self.kinematics.nominal_field(phi)

    def measure(self, kind: str) -> Any:
        """Integration over one kind of region."""
        return self._measure("dx", self.device.kind_tags)(KIND_TAGS[kind])

    def facets(self, sort: str, name: str) -> Any:
        """Integration over a named boundary: sort 'ds' if it is an outer one, 'dS' if inner."""
        return self._measure(sort, self.device.facet_tags)(self.device.groups[name][1])

    def _measure(self, sort: str, tags: Any) -> Any:
        return ufl.Measure(
            sort,
            domain=self.device.mesh,
            subdomain_data=tags,
            metadata={"quadrature_degree": self.degree},
        )

    def potential(self, energies: list[Energy]) -> Any:
        """Sum of energies over their regions, in mJ."""
        F, E = self.fields()
        terms = [e.density(F, E) * self.kinematics.volume * self.measure(e.kind) for e in energies]
        return sum(terms[1:], terms[0])

    def form(self, name: str) -> Any:
        """A compiled form by name, or None where the device has no such part.

        Args:
            name: 'elastic', 'electric' (energies); 'locked' (area near a law's limit);
                'residual', 'tangent' (of both, coupled); 'mesh_residual', 'mesh_tangent' (of the
                air's fictitious elasticity).
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
        if name.startswith("mesh"):
            if not self.mesh_motion:
                return None
            first = ufl.derivative(self.potential(self.mesh_motion), w, ufl.TestFunction(W))
        else:
            first = self.coupling.residual(self, ufl.TestFunction(W))
        if name.endswith("residual"):
            return compat.form(first)
        return compat.form(ufl.derivative(first, w, ufl.TrialFunction(W)))

    def locked(self, share: float = 0.99) -> bool:
        """Whether a law is somewhere stretched to a share of its limit (see `Law.extension`).

        At 99 % it is dozens of times as stiff as at rest, and a body that is stretched on grows in
        volume instead; beyond 100 % the derivatives of its energy are finite but mean nothing.
        """
        if not any(part.law.locks for part in self._solids):
            return False
        self.locking.value = share
        return self.integrate("locked") > 0

    @property
    def _solids(self) -> list[Hyperelastic]:
        parts = [getattr(part, "solid", part) for part in self.elastic]
        return [part for part in parts if isinstance(part, Hyperelastic)]

    def _locked_volume(self) -> Any:
        """Mesh area in which a law is stretched to the share `locking` of its limit."""
        F, _ = self.fields()
        terms = [
            ufl.conditional(ufl.ge(part.extension(F), self.locking), 1.0, 0.0)
            * self.measure(part.kind)
            for part in self._solids
            if part.law.locks
        ]
        return sum(terms[1:], terms[0])

    def set_prestretch(self, fraction: float) -> None:
        """Pre-stretch the film by a fraction (0: none, 1: all) of the config's pre-stretch."""
        film = self.config.materials.film
        radial, hoop = (1 + fraction * (s - 1) for s in film.prestretch)
        self.prestretch.value[:] = (radial, thickness_stretch(film, radial, hoop), hoop)

    def integrate(self, name: str) -> float:
        """Energy of the current state, mJ, summed over ranks."""
        local = fem.assemble_scalar(self.form(name))
        return float(self.device.mesh.comm.allreduce(local, op=MPI.SUM))

    @property
    def force_scale(self) -> float:
        """Characteristic force, N: film modulus times the film's inner cross-section."""
        g, film = self.config.geometry, self.config.materials.film
        modulus = film.shear_modulus_at_rest
        return float(2 * np.pi * g.inner_radius * g.film_thickness * modulus)

    @property
    def charge_scale(self) -> float:
        """Characteristic charge, uC: of the flat film at 1 kV."""
        g, film = self.config.geometry, self.config.materials.film
        area = np.pi * (g.outer_radius**2 - g.inner_radius**2)
        stretch = math.sqrt(math.prod(film.prestretch))
        return float(EPSILON_0 * film.permittivity.at(stretch) * area / g.film_thickness)


def quadrature_degree(order: int) -> int:
    """Of integrals: 3 x 3 Gauss points on second-order cells, 2 x 2 on first-order."""
    return 2 * order


def build_problem(config: Config, comm: MPI.Comm, mesh_file: Path | None = None) -> Problem:
    """Mesh, spaces, constraints and energies of a config (collective).

    Args:
        config: The config.
        comm: MPI communicator.
        mesh_file: Where to write the mesh, if anywhere.
    """
    return problem_on(build_device(config, comm, mesh_file), config, supports(config.geometry))


def problem_on(device: Device, config: Config, held: list[Support]) -> Problem:
    """The same on any device, with supports of its own (collective).

    Args:
        device: A mesh with the names of dealib's regions; it need not be the config's geometry,
            which then only gives the sizes that residuals are compared with.
        config: Materials, order and solver.
        held: What is held and driven; where two meet, the later one holds.
    """
    mixed = config.physics.formulation == "mixed"
    spaces = build_spaces(device, config.mesh.order, mixed)
    mesh, m, g = device.mesh, config.materials, config.geometry
    prestretch = constant(mesh, [1.0, 1.0, 1.0])

    def permittivity(relative: float) -> Any:
        return constant(mesh, EPSILON_0 * relative)

    electrode = m.electrode if names.TOP_ELECTRODE in device.groups else None
    count = max(len(law.branches) for law in (m.film, electrode) if law is not None)
    terms = step_terms(device, quadrature_degree(spaces.order), count) if count else None
    branches: list[Energy] = []

    def solid(kind: str, law: Any, prestretch: Any = None) -> Energy:
        part = Hyperelastic(kind, law, parameters(mesh, law), prestretch)
        if law.branches:
            branches.extend(maxwell_branches(part, law.branches, terms))
        return MixedHyperelastic(part, ufl.split(spaces.w)[2]) if mixed else part

    elastic = [solid("film", m.film, prestretch)]
    by_stretch = m.film.permittivity
    film = IdealDielectric("film", permittivity(by_stretch.intercept))
    if by_stretch.slope:
        film = StretchedDielectric(
            "film", film.permittivity, permittivity(by_stretch.slope), prestretch
        )
    electric: list[Energy] = [film]
    motion: list[Energy] = []
    if electrode is not None:
        elastic.append(solid("electrodes", electrode))
    if names.MOUNT_BLOCK in device.groups and g.clamps is not None:
        electric.append(IdealDielectric("blocks", permittivity(g.clamps.relative_permittivity)))
    if names.AIR in device.groups:
        electric.append(IdealDielectric("air", permittivity(1.0)))
        motion.append(MeshElasticity("air", constant(mesh, config.physics.air_stiffness)))
    return Problem(
        config=config,
        device=device,
        spaces=spaces,
        constraints=build(device, spaces, held),
        kinematics=Axisymmetric(mesh),
        elastic=elastic,
        electric=electric,
        mesh_motion=motion,
        prestretch=prestretch,
        coupling=COUPLINGS[config.physics.coupling],
        locking=constant(mesh, 1.0),
        branches=branches,
        terms=terms,
    )
