"""Builds the total potential of a config on a mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from mpi4py import MPI

import ufl
from dolfinx import fem

from dealib.config.schema import Config
from dealib.device.records import CHAMBER, TERMINAL, Region
from dealib.fem import compat
from dealib.fem.branches import network_steps, step_terms
from dealib.fem.chambers import ChamberPressure, chamber_energies
from dealib.fem.couplings import COUPLINGS
from dealib.fem.domain import Domain, Spaces, build_domain, build_spaces
from dealib.fem.electrodes import build_map
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
from dealib.fem.groups import Group, sheet_groups, solid_groups
from dealib.fem.potential import Problem
from dealib.fem.sheet import SheetModel
from dealib.fem.sheet_layer import equip
from dealib.units import EPSILON_0

__all__ = ["Problem", "build_problem", "problem_on"]


def build_problem(config: Config, comm: MPI.Comm, mesh_file: Path | None = None) -> Problem:
    """Mesh, spaces, constraints and energies of a config (collective).

    Args:
        config: The config.
        comm: MPI communicator.
        mesh_file: Where to write the mesh, if anywhere.
    """
    return problem_on(build_domain(config, comm, mesh_file), config)


def problem_on(domain: Domain, config: Config, spaces: Spaces | None = None) -> Problem:
    """The problem of a config on any mesh with the names of its device (collective).

    Args:
        domain: The mesh; it need not be that of the config's geometry.
        config: Materials, order and solver.
        spaces: Spaces of another problem on this mesh; default new ones.
    """
    mixed = config.physics.formulation == "mixed"
    spaces = spaces or build_spaces(domain, config.mesh.order, mixed)
    mesh, sheet = domain.mesh, domain.device.kinematics.sheet
    degree = spaces.degree
    groups = groups_of(domain, config)
    count = _networks(config)
    slots = 1 + max(group.slot for group in groups)
    terms, size = None, domain.device.kinematics.packed
    peaks: Any = None
    if count:
        terms = step_terms(mesh, degree, count * slots, size)
    if any(m.mullins for m in config.solids.values()):
        element = compat.quadrature_element(mesh, degree, slots)
        peaks = fem.Function(compat.functionspace(mesh, element), name="peaks")
    parts = EnergyTerms.of(domain, config, spaces, groups, terms, peaks)
    if sheet:
        equip(domain, spaces, groups, degree)
    problem = Problem(
        config=config,
        domain=domain,
        spaces=spaces,
        constraints=build_map(domain, spaces, config, config.sensing.charging),
        groups=groups,
        elastic=parts.elastic,
        electric=parts.electric,
        loads=parts.loads,
        values=parts.values,
        mesh_motion=parts.motion,
        coupling=COUPLINGS[config.physics.coupling],
        locking=constant(mesh, 1.0),
        density=parts.density,
        rate_factor=constant(mesh, 1.0),
        charging=config.sensing.charging,
        branches=parts.branches,
        terms=terms,
        peaks=peaks,
    )
    if sheet:
        volts = {port.name: parts.values[port.name] for port in domain.device.of(TERMINAL)}
        problem.sheet = SheetModel(
            *(domain, spaces, groups, problem.densities, volts, degree),
            problem.integrals.everywhere,
            _slack(config, groups),
        )
    return problem


def groups_of(domain: Domain, config: Config) -> tuple[Group, ...]:
    """Regions that share energies."""
    if domain.device.kinematics.sheet:
        return sheet_groups(domain)
    return solid_groups(config, domain)


def _networks(config: Config) -> int:
    """Largest number of networks of a material."""
    return max(len(m.networks) for m in config.solids.values())


@dataclass
class EnergyTerms:
    """The energies of a config, and its numbers in them as constants (see `Problem`)."""

    elastic: list[Energy]
    electric: list[Energy]
    motion: list[Energy]
    branches: list[Energy]
    loads: list[tuple[str, ChamberPressure]]
    values: dict[str, Any]
    density: dict[str, Any]

    @classmethod
    def of(
        cls,
        domain: Domain,
        config: Config,
        spaces: Spaces,
        groups: Sequence[Group],
        terms: Any,
        peaks: Any,
    ) -> EnergyTerms:
        """The energies of a config on a mesh (collective).

        Args:
            domain: The mesh.
            config: The config.
            spaces: The spaces.
            groups: Regions that share energies.
            terms: The function of `step_terms`; None without networks.
            peaks: Function of the largest energy densities; None without softening.
        """
        mixed = config.physics.formulation == "mixed"
        device, mesh, count = domain.device, domain.mesh, _networks(config)
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
            if material.mullins is not None:
                constants = {k: constant(mesh, v) for k, v in material.mullins}
                peak = peaks[group.slot]
                part = replace(part, mullins=SimpleNamespace(**constants), peak=peak)
            size, first = device.kinematics.packed, group.slot * count
            branches += network_steps(part, material.networks, terms, size, first)
            elastic.append(MixedHyperelastic(part, ufl.split(spaces.w)[2]) if mixed else part)
            if not config.conducts(group.material):
                electric.append(_dielectric(mesh, group, material))
        free = (
            *device.of(CHAMBER),
            *(device.of(TERMINAL) if device.kinematics.sheet else ()),
        )
        values = {port.name: ufl.variable(constant(mesh, 0.0)) for port in free}
        loads = [
            (p.name, energy)
            for p in device.of(CHAMBER)
            for energy in chamber_energies(domain, p, values[p.name])
        ]
        density = {k: constant(mesh, m.density or 0.0) for k, m in config.solids.items()}
        return cls(elastic, electric, motion, branches, loads, values, density)


def _slack(config: Config, groups: tuple[Group, ...]) -> dict[str, float] | None:
    """Stiffness that wrinkled parts of a sheet keep, N/mm; None if the sheet is taut."""
    if config.physics.wrinkling == "taut":
        return None
    found: dict[str, float] = {}
    for group in groups:
        assert group.sheet is not None
        whole = config.materials[group.material].shear_modulus_at_rest * group.sheet.thickness
        share = config.physics.slack_stiffness * whole
        found[group.sheet.area] = found.get(group.sheet.area, 0.0) + share
    return found


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
