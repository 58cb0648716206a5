"""Motion in time: forces of inertia and damping, and their energies.

`fem.generalised_alpha` has the equations of a step. Inertia has the potential
k/2 (u' - u*) . M (u' - u*) over a step from u to u', with k and u* fixed at its start, so that the
tangent stays symmetric.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.arrays import Array
from dealib.fem.generalised_alpha import GeneralisedAlpha, Rates
from dealib.fem.layout import Layout
from dealib.fem.pattern import add_form
from dealib.fem.potential import Problem

_TONNES = 1e-3  # of a kg


class Inertia:
    """Inertia and damping of a device in motion.

    Attributes:
        now: The last accepted state.
        stiffness_time: Rayleigh's factor of the stiffness, s.
        damped: Energy lost to Rayleigh damping so far, mJ.
        numerical: Energy lost to the time integration so far, mJ.

    Args:
        problem: The problem.
        laws: The equation of each port, with the mass that hangs on it.
    """

    def __init__(self, problem: Problem, laws: Mapping[str, Any]) -> None:
        config, self._laws = problem.config, laws
        self._problem, self._map = problem, problem.constraints
        self._mass_rate, self.stiffness_time = config.damping.mass, config.damping.stiffness
        self._alpha = GeneralisedAlpha(config.solver.rho)
        self._own = {port.name: _TONNES * port.mass for port in problem.device.ports}
        self._ports = list(self._map.ports)
        self._least = problem.domain.sizes.thickness
        self.now = Rates.rest(self._position(dict.fromkeys(self._ports, 0.0)))
        self._start, self._largest = self.now.u, 0.0
        self.damped = self.numerical = 0.0
        self._matrix: Any = None
        self._stiffness: Any = None
        self._mass = self._total_mass()

    # --- matrices --------------------------------------------------------------------------------

    def matrix(self, like: Any) -> Any:
        """Mass matrix of the reduced unknowns that have degrees of freedom, t.

        Args:
            like: A matrix with the tangent's pattern.
        """
        matrix = like.duplicate(copy=False)
        matrix.setOption(PETSc.Mat.Option.NEW_NONZERO_ALLOCATION_ERR, False)
        add_form(self._problem, "mass", matrix)
        matrix.assemble()
        return matrix

    def own_mass(self, port: str) -> float:
        """Mass of a mount and of the weight that hangs on it, t."""
        return self._own[port] + _TONNES * float(self._laws[port].mass)

    # --- steps -----------------------------------------------------------------------------------

    def rest(self, values: dict[str, float]) -> None:
        """Set the state to rest at the problem's state and these port values (collective).

        Kinetic energy that is lost so counts as numerical loss.
        """
        self.numerical += self.kinetic
        self.now, self._alpha.step = Rates.rest(self._position(values)), 0.0

    def enter(self) -> None:
        """Begin a stage, in which the largest motion is measured anew."""
        self._start, self._largest = self.now.u, 0.0

    def begin(self, duration: float) -> None:
        """Prepare a step of a duration in s from the last accepted state."""
        self.now = self._alpha.begin(self.now, duration)
        self._factor = self._alpha.stiffness + self._mass_rate * self._alpha.speed
        self._problem.rate_factor.value = self._factor

    def predict(self) -> dict[str, float]:
        """Set the problem's state to a linear extrapolation; returns the values of the ports."""
        at, count = self.now.u + self._alpha.step * self.now.v, len(self._ports)
        self._set(self._problem.spaces.w, at)
        return dict(zip(self._ports, at[len(at) - count :].tolist(), strict=True))

    def damp(self, stiffness: Any) -> None:
        """Set the reduced stiffness, of displacements only, for the damping of the step."""
        self._stiffness = stiffness

    def accelerate(self, values: dict[str, float]) -> list[str]:
        """Set the accelerations of the problem's state.

        Args:
            values: Values of the ports.

        Returns:
            Names of the linear forms to be added to the residual.
        """
        self._u = self._position(values)
        alpha = self._alpha
        self._forced = self._factor * self._u + alpha.r0 + self._mass_rate * alpha.v0
        self._set(self._problem.rate, self._forced)
        return ["inertia"]

    def add_damping(self, out: Any) -> None:
        """Add the reduced forces of stiffness-proportional damping after `accelerate`."""
        if self._stiffness is not None:
            force = out.duplicate()
            self._stiffness.mult(self._reduced(self._alpha.velocity(self._u)), force)
            out.axpy(self.stiffness_time, force)

    def push(self, port: str) -> float:
        """Force of inertia of a mount's own mass after `accelerate`, N."""
        return self.own_mass(port) * self._of(self._forced, port)

    def push_rate(self, port: str) -> float:
        """Derivative of `push` by the port's value, N/mm."""
        return self.own_mass(port) * self._factor

    def add_tangent(self, matrix: Any) -> None:
        """Add the derivative of the forces of inertia and damping, except those of `push`."""
        if self._matrix is None:
            self._matrix = self.matrix(matrix)
        same = PETSc.Mat.Structure.SUBSET_NONZERO_PATTERN
        matrix.axpy(self._factor, self._matrix, structure=same)
        if self._stiffness is not None:
            factor = self.stiffness_time * self._alpha.speed
            matrix.axpy(factor, self._stiffness, structure=same)

    def error(self) -> float:
        """Error of the last step over the largest motion of the stage (collective).

        Both are root mean squares over the mass. The motion is the displacement since the stage
        began, or at least the film's thickness.
        """
        end = self._reached()
        missed = self._size(self._alpha.error(self.now, end))
        return missed / max(self._motion(end), self._least)

    def commit(self) -> None:
        """Accept the current state as the end of the step (collective).

        The work of the forces of inertia along the step, by the trapezoidal rule as for the ports,
        is the change of the kinetic energy and the numerical loss.
        """
        end, n = self._reached(), self.now
        moved = end.u - n.u
        work = self._product(n.r + end.r, moved) / 2
        self.numerical += work - self._kinetic(end.v) + self._kinetic(n.v)
        self.damped += self._mass_rate * self._product(n.v + end.v, moved) / 2
        if self._stiffness is not None:
            speed, force = self._reduced((n.v + end.v) / 2), self._reduced(moved)
            self._stiffness.mult(speed, force)
            self.damped += self.stiffness_time * force.dot(self._reduced(moved))
        self.now, self._largest = end, self._motion(end)

    @contextmanager
    def tentative(self) -> Iterator[None]:
        """A context in which the current state is accepted tentatively (collective)."""
        kept = self.now, self._largest, self.damped, self.numerical
        self.commit()
        try:
            yield
        finally:
            self.now, self._largest, self.damped, self.numerical = kept

    # --- results ---------------------------------------------------------------------------------

    @property
    def kinetic(self) -> float:
        """Kinetic energy, mJ (collective)."""
        return self._kinetic(self.now.v)

    def velocity(self, port: str) -> float:
        """Rate of a port's value, mm/s."""
        return self._of(self.now.v, port)

    # --- checkpoints -----------------------------------------------------------------------------

    def gather(self, layout: Layout) -> Array | None:
        """Nodal v, a, r, and u at the stage's start, (4, nodes, axes), on rank 0 (collective).

        It overwrites the problem's state.
        """
        found = []
        for rates in (self.now.v, self.now.a, self.now.r, self._start):
            self._set(self._problem.spaces.w, rates)
            nodal = layout.gather()
            if nodal is not None:
                found.append(nodal[:, : self._problem.kinematics.dim])
        return np.array(found) if found else None

    def plain(self) -> dict[str, Any]:
        """Plain values for a checkpoint."""
        n, count = self.now, len(self._ports)
        ports = [x[len(x) - count :].tolist() for x in (n.v, n.a, n.r, self._start)]
        return {"ports": ports, "step": self._alpha.step, "largest": self._largest}

    def restore(
        self, layout: Layout, gathered: Array | None, plain: dict[str, Any], at: dict[str, float]
    ) -> None:
        """Inverse of `gather` and `plain` (collective). It overwrites the problem's state.

        Args:
            layout: Layout of the mesh.
            gathered: From `gather`, on rank 0.
            plain: From `plain`.
            at: Values of the ports in the problem's state.
        """
        found = [self._position(at)]
        for k, ports in enumerate(plain["ports"]):
            nodal = None
            if gathered is not None:
                size = layout.columns - gathered.shape[2]
                nodal = np.pad(gathered[k], ((0, 0), (0, size)))
            layout.scatter(nodal)
            found.append(np.concatenate([self._problem.spaces.w.x.array, ports]))
        *now, self._start = found
        self.now = Rates(*now)
        self._alpha.step, self._largest = plain["step"], plain["largest"]

    # --- parts -----------------------------------------------------------------------------------

    def _of(self, rates: Array, port: str) -> float:
        return float(rates[len(rates) - len(self._ports) + self._ports.index(port)])

    def _position(self, values: dict[str, float]) -> Array:
        return np.concatenate(
            [self._problem.spaces.w.x.array, [values[port] for port in self._ports]]
        )

    def _set(self, function: Any, rates: Array) -> None:
        function.x.array[:] = rates[: len(rates) - len(self._ports)]

    def _reached(self) -> Rates:
        return self._alpha.end(self.now, self._u)

    def _product(self, x: Array, y: Array) -> float:
        """Product x . M y, with the masses of the mounts (collective)."""
        self._set(self._problem.rate, x)
        self._set(self._problem.direction, y)
        mounts = sum(self.own_mass(p) * self._of(x, p) * self._of(y, p) for p in self._ports)
        return self._problem.integrate("inertia work") + mounts

    def _total_mass(self) -> float:
        """Mass of the body and of the mounts, t (collective)."""
        ones = np.ones_like(self.now.u)
        ones[len(ones) - len(self._ports) :] = 0.0
        body = self._product(ones, ones) / self._problem.kinematics.dim
        return body + sum(self._own.values())

    def _reduced(self, rates: Array) -> Any:
        """The rates of the reduced unknowns, as a vector."""
        map_, found = self._map, self._map.create_vector()
        found.array[: len(map_.free)] = rates[map_.free]
        for port in self._ports:
            map_.set_port(found, port, self._of(rates, port))
        found.assemble()
        return found

    def _kinetic(self, v: Array) -> float:
        return self._product(v, v) / 2

    def _size(self, x: Array) -> float:
        """Root mean square over the mass, mm."""
        return float(np.sqrt(self._product(x, x) / self._mass))

    def _motion(self, end: Rates) -> float:
        return max(self._largest, self._size(end.u - self._start))
