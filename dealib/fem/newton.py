"""Newton's method by PETSc SNES, with convergence judged field by field."""

from __future__ import annotations

import logging
import math
import weakref
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.config.schema import Config
from dealib.device.records import CHAMBER, MOUNT, TERMINAL, TURN
from dealib.errors import NotConverged
from dealib.fem.compat import DIVERGED_NAN, free
from dealib.fem.constraints import FIELDS
from dealib.fem.linear import (
    Factor,
    factorisation_seconds,
    fixed_tangent,
    set_linear_solver,
    set_options,
)
from dealib.fem.modes import Modes, averaged, lowest
from dealib.fem.problem import Problem
from dealib.fem.system import System, Timings

log = logging.getLogger(__name__)

_OPTIONS: dict[str, Any] = {"snes_type": "newtonls", "snes_linesearch_type": "basic"}
_EXACT = 1e-12  # of a linear solution that nothing corrects afterwards
_STEP = 1e-7  # negligible step: of the film's thickness, of 1 kV, of its shear modulus
_FOLDING = 5  # times as many iterations in tension fields, whose tangent jumps
_ROUNDING = 1e4  # how far above the tolerance rounding may keep the residual
_EXTERNAL = 76  # PETSc's error of a library: MUMPS, where whole rows of the tangent are zero
_SINGULAR = "the tangent is singular: a part is held by nothing, or not yet by any tension"
_STALLED = "the iterative linear solver did not converge; solver.linear: direct may"
Reason = PETSc.SNES.ConvergedReason


class Singular(NotConverged):
    """The tangent cannot be factored at all; PETSc's solver is of no use any more."""


@dataclass(frozen=True)
class Scales:
    """Sizes that residuals are compared with.

    Attributes:
        displacement: Force, N.
        potential: Charge, uC.
        air_mesh: The air's fictitious force, N.
        pressure: The film's volume, mm^3.
    """

    displacement: float
    potential: float
    air_mesh: float
    pressure: float

    @classmethod
    def of(cls, problem: Problem) -> Scales:
        """Characteristic sizes of a problem."""
        sizes, stiffness = problem.domain.sizes, problem.config.physics.air_stiffness
        air = sizes.around * max(sizes.height, 1.0) * stiffness
        return cls(problem.force_scale, problem.charge_scale, air, sizes.volume)

    def array(self) -> Any:
        """In the order of `FIELDS`."""
        return np.array([self.displacement, self.potential, self.air_mesh, self.pressure])


class Newton:
    """Solves the reduced system for the current port equations.

    Attributes:
        system: The system.
        iterations: Iterations of the last solve.
        linear_iterations: Iterations of its linear solver, one each where it factorises.
        total: Iterations of all solves.
        linear_solver: What it is, and its memory.

    Args:
        problem: The problem.
        timings: Where times are added.
        symmetric: Whether no port's equation sums the values of several ports.
    """

    def __init__(self, problem: Problem, timings: Timings, symmetric: bool = True) -> None:
        free(problem.domain.comm)  # what earlier simulations left
        self.system = System(problem, timings)
        self.timings = timings
        self.iterations = self.linear_iterations = self.total = 0
        solver = problem.config.solver
        self._tolerance = solver.tolerance * Scales.of(problem).array()
        self._port_tolerance = solver.tolerance
        scale = dict(zip((MOUNT, TERMINAL, CHAMBER), self._tolerance[[0, 1, 3]], strict=True))
        scale[TURN] = scale[MOUNT] * problem.domain.sizes.span
        self._dual_tolerance = {p.name: scale[p.kind] for p in problem.device.ports}
        thickness = problem.domain.sizes.thickness
        modulus = problem.config.film.shear_modulus_at_rest
        # mm, kV, mm, MPa
        self._step_tolerance = _STEP * np.array([thickness, 1.0, thickness, modulus])
        self._snes = PETSc.SNES().create(problem.domain.comm)
        self._snes.setFunction(_weak(self._residual), self.system.residual_vector)
        self._snes.setJacobian(_weak(self._tangent), self.system.matrix)
        self._snes.setConvergenceTest(_weak(self._test))
        # `_test` alone decides; PETSc 3.25 would take a failed line search for a small step
        self._snes.setTolerances(stol=0.0, max_it=_iterations(problem.config))
        self.linear_solver = set_linear_solver(self._snes, self.system, symmetric)
        set_options(self._snes.getOptionsPrefix(), _OPTIONS)
        self._snes.setFromOptions()
        self._iterative = self._snes.getKSP().getType() == "fgmres"
        self._factored = False
        self._logged = factorisation_seconds()
        self._norms = np.zeros(len(FIELDS))

    def solve(self) -> int:
        """Solve from the current q; returns the number of iterations.

        Raises:
            NotConverged: With the reason; q is then meaningless.
        """
        free(self.system.map.comm)
        try:
            self._snes.solve(None, self.system.q)
        except PETSc.Error as error:
            if error.ierr != _EXTERNAL:
                raise
            raise Singular(_SINGULAR) from None
        self.iterations = self._snes.getIterationNumber()
        self.linear_iterations = self._snes.getLinearSolveIterations()
        self.total += self.iterations
        reason = self._snes.getConvergedReason()
        if reason < 0:
            worst = ", ".join(
                f"{name} {norm / limit:.1e}"
                for name, norm, limit in zip(FIELDS, self._norms, self._tolerance, strict=True)
                if not norm <= limit
            )
            known = {
                Reason.DIVERGED_MAX_IT: "no convergence within the iterations allowed",
                DIVERGED_NAN: "an element turned inside out",
                Reason.DIVERGED_LINEAR_SOLVE: _STALLED if self._iterative else _SINGULAR,
            }
            what = known.get(reason, f"SNES reason {reason}")
            raise NotConverged(f"{what} (residual over tolerance: {worst or 'ports'})")
        if self.system.problem.locked():
            raise NotConverged("a law locks: it is stretched to 99 % of its limit")
        return int(self.iterations)

    @property
    def factorisation_seconds(self) -> float:
        """Time in symbolic and numeric factorisations and back-substitutions since the start."""
        return factorisation_seconds() - self._logged

    def capacitance(self, port: str) -> float:
        """Small-signal capacitance of the one terminal at 0 V with the body frozen, nF.

        One back-substitution with the last tangent gives a trial potential for a unit test
        voltage; the electric energy is stationary in it, so its error enters squared. Of a sheet,
        whose layers have no potential of their own, it is the derivative of its charge.
        """
        system, problem = self.system, self.system.problem
        if problem.sheet is not None:
            return -problem.integrate(f"corner {port} {port}")
        q = system.q
        if not self._factored or system.charging is not None:
            with nullcontext() if system.charging is None else system.charging.at_once():
                system.residual(q, system.residual_vector)
                self._tangent(self._snes, q, system.matrix, system.matrix)
                self._snes.getKSP().setOperators(system.matrix)
        unit, response = q.duplicate(), q.duplicate()
        unit.set(0.0)
        system.map.set_port(unit, port, 1.0)
        system.eliminate(unit)
        self._solve_linear(unit, response, exactly=self._iterative)
        volts = system.map.port_values(response)[port]
        trial = q.copy()
        fields = system.map.field == FIELDS.index("potential")
        trial.array[: len(fields)][fields] = response.array_r[: len(fields)][fields] / volts
        system.map.set_port(trial, port, 1.0)
        system.expand(trial)
        energy = problem.integrate("electric")
        system.expand(q)
        if system.charging is not None:
            system.residual(q, system.residual_vector)
        return -2 * energy

    def responses(self) -> list[Any]:
        """How the state follows each port, at unit rate and the others held (collective).

        All ports must have prescribed values. One tangent, one back-substitution a port.
        """
        system = self.system
        self.linearise()
        found = []
        for port in system.ports:
            unit, response = system.q.duplicate(), system.q.duplicate()
            unit.set(0.0)
            system.map.set_port(unit, port, 1.0)
            system.eliminate(unit)
            self._solve_linear(unit, response, exactly=self._iterative)
            found.append(response)
        return found

    def inertia(self) -> tuple[int, int, int]:
        """Numbers of negative, zero and positive eigenvalues of the tangent at the current q."""
        return Factor(fixed_tangent(self.system)).inertia

    def unstable_modes(self) -> int:
        """Number of independent motions that lower the potential, under the ports' equations."""
        return self.inertia()[0] - self.concave

    def softest_modes(self, count: int) -> Modes:
        """Modes of the least energy at the current q, under the ports' equations (collective)."""
        tangent = fixed_tangent(self.system)
        return lowest(tangent, averaged(self.system), self.concave, count)

    @property
    def concave(self) -> int:
        """Number of unknowns in which the potential is concave: phi, pressure (collective).

        Of the tangent's negative eigenvalues each free one accounts for one, and the rest are those
        of the condensed mechanical tangent (Haynsworth, Linear Algebra Appl. 1 (1968) 73).
        """
        system = self.system
        mine = sum(len(system.map.numbers(field)) for field in ("potential", "pressure"))
        free = (p for p in system.problem.device.ports if system.ports[p.name].value is None)
        return int(system.map.comm.allreduce(mine) + sum(p.kind.sign < 0 for p in free))

    def response(self, port: str) -> Any:
        """Rate of q as the right-hand side of a port's equation grows, at the current state."""
        system = self.system
        system.residual(system.q, system.residual_vector)
        self._tangent(self._snes, system.q, system.matrix, system.matrix)
        unit, found = system.q.duplicate(), system.q.duplicate()
        unit.set(0.0)
        system.map.set_port(unit, port, 1.0)
        system.eliminate(unit)
        self._snes.getKSP().setOperators(system.matrix)
        self._solve_linear(unit, found, exactly=True)
        return found

    def linearise(self) -> None:
        """Make the tangent at the current state ready for steps from it (collective)."""
        system = self.system
        system.residual(system.q, system.residual_vector)
        system.tangent(system.matrix)
        self._factored = True
        self._snes.getKSP().setOperators(system.matrix)

    def step_from(self, q: Any) -> None:
        """Take the state one step of Newton's method from another one (collective).

        The tangent is that of `linearise`, of the problem as it was then.
        """
        system, found = self.system, q.duplicate()
        system.residual(q, system.residual_vector)
        system.eliminate(system.residual_vector)
        self._solve_linear(system.residual_vector, found, exactly=True)
        q.copy(system.q)
        system.q.axpy(-1.0, found)
        system.residual(system.q, system.residual_vector)

    def _solve_linear(self, right: Any, found: Any, exactly: bool) -> None:
        """Solve with the last tangent; Newton corrects a coarse solution, nothing corrects this.

        Raises:
            NotConverged: If an iterative solver does not come so far.
        """
        solver = self._snes.getKSP()
        coarse = solver.getTolerances()[0]
        solver.setTolerances(rtol=_EXACT if exactly else coarse)
        solver.solve(right, found)
        solver.setTolerances(rtol=coarse)
        if solver.getConvergedReason() < 0 and self._iterative:
            raise NotConverged(_STALLED)

    # --- SNES callbacks --------------------------------------------------------------------------

    def _residual(self, _snes: Any, q: Any, out: Any) -> None:
        self.system.residual(q, out)

    def _tangent(self, _snes: Any, _q: Any, matrix: Any, _preconditioner: Any) -> None:
        self.system.tangent(matrix)
        self.system.eliminate(self.system.residual_vector)  # SNES evaluates it anew after the step
        self._factored = True

    def _test(self, _snes: Any, iteration: int, norms: tuple[float, float, float]) -> Any:
        """Every field, and every port, within its own tolerance."""
        residual = self.system.residual_vector
        if not math.isfinite(norms[2]):
            return DIVERGED_NAN
        self._norms = self.system.field_norms(residual)
        ports = self.system.map.port_values(residual)
        if log.isEnabledFor(logging.DEBUG):
            shown = [*zip(FIELDS, self._norms, strict=True), *ports.items()]
            log.debug("  %2d  %s", iteration, "  ".join(f"{k} {abs(v):.1e}" for k, v in shown))
        limits = {
            name: self._port_tolerance if law.value is not None else self._dual_tolerance[name]
            for name, law in self.system.ports.items()
        }
        if all(abs(ports[n]) <= limits[n] for n in ports):
            if (self._norms <= self._tolerance).all():
                return Reason.CONVERGED_FNORM_ABS
            near = (self._norms <= _ROUNDING * self._tolerance).all()
            if iteration > 0 and near and self._step_is_negligible():
                return Reason.CONVERGED_SNORM_RELATIVE
        return Reason.ITERATING

    def _step_is_negligible(self) -> bool:
        """Whether the last step was so small that the next one cannot matter.

        Near incompressibility the residual cannot fall below its own rounding error, of the order
        of the bulk modulus; Newton's step still shows that the state is exact.
        """
        step = self.system.field_norms(self._snes.getSolutionUpdate())
        return bool((step <= self._step_tolerance).all())


def _iterations(config: Config) -> int:
    """Most iterations; what wrinkles is found among them."""
    folding = config.physics.wrinkling == "tension_field"
    return config.solver.max_iterations * (_FOLDING if folding else 1)


def _weak(method: Callable[..., Any]) -> Callable[..., Any]:
    """A callback that does not keep its object, and with it the mesh and MPI's communicators.

    PETSc holds callbacks where Python's collector does not see them: bound methods would make a
    cycle that is never freed.
    """
    found = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        alive = found()
        assert alive is not None
        return alive(*arguments)

    return call
