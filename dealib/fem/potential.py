"""The total potential: energies on regions and faces, and the forms made of them."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mpi4py import MPI

import numpy as np
import ufl
from dolfinx import fem
from ufl.algorithms.analysis import extract_coefficients, extract_constants

from dealib.config.schema import Config
from dealib.device.device import Device
from dealib.device.kinematics import Kinematics
from dealib.fem import compat
from dealib.fem.chambers import ChamberPressure
from dealib.fem.constraints import ConstraintMap
from dealib.fem.couplings import Coupling
from dealib.fem.domain import Domain, Spaces
from dealib.fem.energies import (
    Energy,
    Hyperelastic,
    density,
    first_variation,
    in_plane,
    second_variation,
)
from dealib.fem.forms import ufl_form
from dealib.fem.groups import Group, Sheet
from dealib.fem.integrals import Integrals
from dealib.fem.sheet import SheetModel
from dealib.materials import thickness_stretch
from dealib.units import EPSILON_0


@dataclass
class Problem:
    """The discrete problem: mesh, spaces, constraints and energies, which last for a run.

    Attributes:
        config: The config.
        domain: Mesh and names.
        spaces: Spaces and current state.
        constraints: Map to the reduced unknowns.
        groups: Regions that share energies.
        elastic: Elastic energies.
        electric: Electric energies.
        loads: Port name and energy for ports without degrees of freedom, such as pressures.
        values: Values of ports without degrees of freedom, as UFL variables of constants.
        mesh_motion: Fictitious energies that only move the air's mesh.
        coupling: How the electric field loads the body.
        density: Density of each material, t/mm^3, as a constant.
        rate_factor: Derivative of acceleration by displacement over a step, 1/s^2, a constant.
        locking: Share of a law's extensibility that `locked` asks for, a constant.
        charging: Whether the electrodes charge through their resistance, in time.
        branches: Potentials of the networks over a step.
        terms: Function of the networks' terms, set by `Viscosity`; None without networks.
        peaks: Function of the largest energy densities, set by `Viscosity`; None without softening.
        reform: Updates the networks of permanent sets to the current state, set by `Viscosity`.
        sheet: Energies of a sheet; None for solids.
    """

    config: Config
    domain: Domain
    spaces: Spaces
    constraints: ConstraintMap
    groups: tuple[Group, ...]
    elastic: list[Energy]
    electric: list[Energy]
    loads: list[tuple[str, ChamberPressure]]
    values: dict[str, Any]
    mesh_motion: list[Energy]
    coupling: Coupling
    locking: Any
    density: dict[str, Any]
    rate_factor: Any
    charging: bool = False
    branches: list[Energy] = field(default_factory=list)
    terms: Any = None
    peaks: Any = None
    reform: Callable[[], None] | None = None
    sheet: SheetModel | None = None
    _forms: dict[str, Any] = field(default_factory=dict)

    @property
    def device(self) -> Device:
        """The device."""
        return self.domain.device

    @property
    def kinematics(self) -> Kinematics:
        """Its space."""
        return self.device.kinematics

    @cached_property
    def integrals(self) -> Integrals:
        """Makes its integrals."""
        return Integrals(self.domain, self.spaces, self.groups)

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
        """Whether the tangent is symmetric: one potential, and no air with a moving mesh."""
        return self.coupling.symmetric and not self.mesh_motion

    @cached_property
    def direction(self) -> Any:
        """Direction in which forms such as 'along' are evaluated."""
        return fem.Function(self.spaces.W)

    @cached_property
    def rate(self) -> Any:
        """Velocities or accelerations, for the forms of inertia."""
        return fem.Function(self.spaces.W)

    @property
    def sheets(self) -> list[tuple[Group, Sheet]]:
        """The layers of a sheet."""
        return [(group, group.sheet) for group in self.groups if group.sheet is not None]

    @cached_property
    def data(self) -> tuple[list[Any], list[Any]]:
        """Constants and functions in its equations, in the order of their creation."""
        x = ufl.SpatialCoordinate(self.domain.mesh)
        equations = [self.densities(group)[2] for group in self.groups]
        equations += [density(e, self.integrals.point_of(e.on)) for e in self.mesh_motion]
        equations += [self.load_of(port) for port, _ in self.loads]
        equations += [self.domain.symbolic.volume(x), ufl_form(self, "residual")]
        constants = {c.count(): c for e in equations for c in extract_constants(e)}
        functions = {f.count(): f for e in equations for f in extract_coefficients(e)}
        one, two = ([found[k] for k in sorted(found)] for found in (constants, functions))
        return one, two

    def restart(self, config: Config, thicknesses: Iterable[float]) -> None:
        """Continue with another config, whose numbers its constants and its mesh already have.

        Args:
            config: The config.
            thicknesses: Thicknesses of the layers of a sheet, mm.
        """
        self.config, self.domain.device, self.reform = config, config.device, None
        for (_, sheet), thickness in zip(self.sheets, thicknesses, strict=True):
            sheet.thickness, sheet.field.value = thickness, 0.0
        for known in ("force_scale", "charge_scale"):
            self.__dict__.pop(known, None)
        self.domain.__dict__.pop("sizes", None)
        # others may have been compiled for a thickness
        self._forms = {n: f for n, f in self._forms.items() if n.split(" ")[0] in _OF_CONSTANTS}

    def potential(self, energies: list[Energy]) -> Any:
        """Sum of energies over their regions, in mJ."""
        return self.integrals.total(energies, density)

    def load_of(self, port: str, derive: bool = False) -> Any:
        """Energies of the faces that a port loads, or their derivative by its value; 0 if none."""
        found = []
        for energy in (e for name, e in self.loads if name == port):
            for place, point in self.integrals.faces(energy.on):
                work = energy.density(point)
                found.append(place(ufl.diff(work, self.values[port]) if derive else work))
        return sum(found)

    # --- forms -----------------------------------------------------------------------------------

    def form(self, name: str) -> Any:
        """A compiled form by name, or None where the device has no such part.

        Args:
            name: 'elastic', 'electric' (energies); 'locked' (area near a law's limit);
                'along' (the tangent's product with `direction`);
                'mass', 'mass along' (product of `rate_factor` times the mass with `direction`),
                'inertia' (mass times `rate`), 'inertia work' (its product with `direction`);
                'conductance' (of the electrodes); 'mounted' (volume of all materials),
                'product' (of displacements over it); 'field' (second variation by the potential);
                'residual', 'tangent' (of the potential or the coupling); 'mesh_residual',
                'mesh_tangent' (of the air's fictitious elasticity); 'dual PORT', 'column PORT',
                'corner PORT PORT' (first and second derivatives of the potential by the values of
                ports in `values`).
        """
        if name not in self._forms:
            found = ufl_form(self, name)
            self._forms[name] = compat.form(found) if found else None
        return self._forms[name]

    def first(self, energies: list[Energy], test: Any) -> Any:
        """First variation of the sum of energies."""
        if self.sheet is not None:
            return self.sheet.first(test)
        return self.integrals.total(
            energies, lambda e, point: first_variation(e, point, self.state, test)
        )

    def second(self, energies: list[Energy], test: Any, trial: Any) -> Any:
        """Second variation of the sum of energies."""
        if self.sheet is not None:
            return self.sheet.second(test, trial)
        return self.integrals.total(
            energies, lambda e, point: second_variation(e, point, self.state, test, trial)
        )

    def densities(self, group: Group) -> tuple[Any, Any, Any]:
        """Energy densities of a group: elastic without branches, electric, and the sum of all."""
        point = self.integrals.point_of(group.name)
        parts = [
            [density(e, point) for e in energies if e.on == group.name]
            for energies in (self.elastic, self.electric, self.branches)
        ]
        elastic, electric, branches = (
            sum(found) if found else 0 * point.F[0, 0] for found in parts
        )
        return elastic, electric, elastic + electric + branches

    def settle(self) -> None:
        """Update internal variables of sheets and permanent sets to the current state."""
        if self.reform is not None:
            if self.sheet is not None:
                self.sheet.settle()
            self.reform()
        if self.sheet is not None:
            self.sheet.settle()

    def locked(self, share: float = 0.99) -> bool:
        """Whether a law is somewhere stretched to a share of its limit (see `Law.extension`).

        At 99 % a law is dozens of times as stiff as at rest, and further stretching changes the
        volume instead. Beyond 100 % the derivatives of its energy are finite but meaningless.
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

    def set_prestretch(self, fraction: float) -> None:
        """Set the pre-stretch to a fraction, from 0 to 1, of the config's pre-stretches."""
        for group in self.groups:
            if group.prestretch is None:
                continue
            material = self.config.materials[group.material]
            a, b = (1 + fraction * (s - 1) for s in material.prestretch)
            stretches = np.empty(3)
            stretches[list(in_plane(group.normal))] = a, b
            stretches[group.normal] = thickness_stretch(material, a, b)
            group.prestretch.value[:] = stretches

    def value(self, port: str) -> float:
        """Value of a port without degrees of freedom."""
        return float(self.values[port].ufl_operands[0].value)

    def set_values(self, ports: dict[str, float]) -> None:
        """Set the values of the ports without degrees of freedom."""
        for name, value in self.values.items():
            value.ufl_operands[0].value = ports[name]

    def wrinkled_area(self) -> float:
        """Wrinkled area of a tension field, as mounted, mm^2 (collective)."""
        assert self.sheet is not None
        self.sheet.flag_wrinkles()
        return self.integrate("wrinkled")

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
        """Characteristic charge, uC: that of the flat film at 1 kV."""
        sizes, film = self.domain.sizes, self.config.film
        stretch = math.sqrt(math.prod(film.prestretch))
        return float(EPSILON_0 * film.permittivity.at(stretch) * sizes.area / sizes.thickness)


_OF_CONSTANTS = (
    *("elastic", "electric", "residual", "tangent", "along", "field", "mesh_residual"),
    *("mesh_tangent", "dual", "column", "corner"),
)  # forms whose numbers are all constants
