"""Newton's method by PETSc SNES: judged field by field, with tangents that serve again."""

from __future__ import annotations

import logging
import math
import weakref
from collections.abc import Callable
from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.config.schema import Config
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
from dealib.fem.tolerances import Tolerances

log = logging.getLogger(__name__)

_OPTIONS: dict[str, Any] = {"snes_type": "newtonls", "snes_linesearch_type": "basic"}
_FITS = 0.1  # of an answer, at most, may its correction be
_SURE = 0.01  # of the tolerance: nothing is left to correct
_REUSE = 0.1  # of the residual, at most, may an iteration leave for its tangent to serve again
_EXACT = 1e-12  # of a linear solution that nothing corrects afterwards
_FOLDING = 5  # times as many iterations in tension fields, whose tangent jumps
_ROUNDING = 1e4  # how far above the tolerance rounding may keep the residual
_MANY = 10_000  # steps of SNES, of which `_test` allows some
_EXTERNAL = 76  # PETSc's error of a library: MUMPS, where whole rows of the tangent are zero
_SINGULAR = "the tangent is singular: a part is held by nothing, or not yet by any tension"
_STALLED = "the iterative linear solver did not converge; solver.linear: direct may"
Reason = PETSc.SNES.ConvergedReason


class Singular(NotConverged):
    """The tangent cannot be factored at all; PETSc's solver is of no use any more."""


class Newton:
    """Solves the reduced system for the current port equations.

    Attributes:
        system: The system.
        iterations: Iterations of the last solve, without corrections (see `solve`).
        linear_solves: Linear systems that it solved, corrections included.
        linear_iterations: Iterations in these, one each where it factorises.
        total: Iterations of all solves.
        factored: Whether there is a tangent, of some state.
        iterative: Whether linear systems are solved by iterations.
        usable: Whether PETSc's solver can go on; not after a tangent without a factorisation.
        linear_solver: What it is, and its memory.

    Args:
        problem: The problem.
        timings: Where times are added.
        symmetric: Whether no port's equation sums the values of several ports.
    """

    def __init__(self, problem: Problem, timings: Timings, symmetric: bool = True) -> None:
        free(problem.domain.comm)  # what earlier simulations left
        self.system = System(problem, timings)
        self._snes = PETSc.SNES().create(problem.domain.comm)
        self._snes.setFunction(_weak(self._residual), self.system.residual_vector)
        self._snes.setJacobian(_weak(self._tangent), self.system.matrix)
        self._snes.setConvergenceTest(_weak(self._test))
        # `_test` alone decides; PETSc 3.25 would take a failed line search for a small step
        self._snes.setTolerances(stol=0.0, max_it=_MANY)
        self._ksp = self._snes.getKSP()
        self._ksp.setOperators(self.system.matrix)
        self.linear_solver = set_linear_solver(self._ksp, self.system, symmetric)
        set_options(self._ksp.getOptionsPrefix(), _OPTIONS)
        self._snes.setOptionsPrefix(self._ksp.getOptionsPrefix())
        self._snes.setFromOptions()
        self.iterative = self._ksp.getType() == "fgmres"
        self.usable = True
        self._start(timings)

    def _start(self, timings: Timings) -> None:
        self.timings, problem = timings, self.system.problem
        self.iterations = self.linear_solves = self.linear_iterations = self.total = 0
        self._tolerances = Tolerances.of(problem)
        self._most = _iterations(problem.config)
        self.factored = False
        self._logged = factorisation_seconds()
        self._norms, self._worst_port = np.zeros(len(FIELDS)), 0.0
        self._size, self._again = math.inf, False

    def restart(self) -> None:
        """Start as a new one with the numbers that the problem has now (see `Reuse`)."""
        free(self.system.map.comm)
        timings = Timings()
        self.system.restart(timings)
        self._start(timings)

    def solve(self) -> int:
        """Solve from the current q; returns the number of iterations.

        Where a new tangent leaves little of the residual, it serves again for corrections, at a
        sixth of the cost, as long as they converge; these are not counted.

        Raises:
            NotConverged: With the reason; q is then meaningless.
        """
        free(self.system.map.comm)
        self.iterations, self._size, self._again = 0, math.inf, False
        try:
            self._snes.solve(None, self.system.q)
        except PETSc.Error as error:
            if error.ierr != _EXTERNAL:
                raise
            self.usable = False
            raise Singular(_SINGULAR) from None
        self.linear_solves = self._snes.getIterationNumber()
        self.linear_iterations = self._snes.getLinearSolveIterations()
        self.total += self.iterations
        reason = self._snes.getConvergedReason()
        if reason < 0:
            known = {
                Reason.DIVERGED_MAX_IT: "no convergence within the iterations allowed",
                DIVERGED_NAN: "an element turned inside out",
                Reason.DIVERGED_LINEAR_SOLVE: _STALLED if self.iterative else _SINGULAR,
            }
            raise NotConverged(self._told(known.get(reason, f"SNES reason {reason}")))
        if self.system.problem.locked():
            raise NotConverged("a law locks: it is stretched to 99 % of its limit")
        return self.iterations

    def answer(self) -> Any:
        """How q answers to inputs that have changed a little; None if the tangent at hand is other.

        Of two back-substitutions the second one corrects the first, and tells whether the tangent
        is that of this state and of these equations of the ports.
        """
        system, sizes = self.system, []
        at, part, right = system.q.copy(), system.q.duplicate(), system.q.duplicate()
        with system.elsewhere():
            for _ in range(2):
                system.residual(at, right)
                system.eliminate(right)
                self._ksp.solve(right, part)
                at.axpy(-1.0, part)
                sizes.append(part.norm())
        if not sizes[1] <= _FITS * sizes[0]:
            return None
        at.axpy(-1.0, system.q)
        return at

    def assemble(self) -> None:
        """The tangent at the state of the last residual; PETSc factorises it when it is needed."""
        self.system.tangent(self.system.matrix)
        self.factored = True

    @property
    def factorisation_seconds(self) -> float:
        """Time in symbolic and numeric factorisations and back-substitutions since the start."""
        return factorisation_seconds() - self._logged

    def responses(self, *ports: str) -> list[Any]:
        """Rates of q as the right-hand side of a port's equation grows (collective).

        One tangent at the current q, one back-substitution a port.

        Args:
            ports: The ports; default all.
        """
        system = self.system
        self.linearise()
        found = []
        for port in ports or system.ports:
            unit, response = system.q.duplicate(), system.q.duplicate()
            unit.set(0.0)
            system.map.set_port(unit, port, 1.0)
            system.eliminate(unit)
            self.solve_linear(unit, response)
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

    def linearise(self) -> None:
        """Make the tangent at the current state ready for steps from it (collective)."""
        self.system.residual(self.system.q, self.system.residual_vector)
        self.assemble()

    def step_from(self, q: Any) -> None:
        """Take the state one step of Newton's method from another one (collective).

        The tangent is that of `linearise`, of the problem as it was then.
        """
        system, found = self.system, q.duplicate()
        system.residual(q, system.residual_vector)
        system.eliminate(system.residual_vector)
        self.solve_linear(system.residual_vector, found)
        q.copy(system.q)
        system.q.axpy(-1.0, found)
        system.residual(system.q, system.residual_vector)

    def polish(self) -> None:
        """Correct the state once more, beyond the tolerance; rounding may stop it (collective)."""
        system, kept = self.system, self.system.q.copy()
        self.linearise()
        before = system.residual_vector.norm()
        self.step_from(kept)
        if not system.residual_vector.norm() < before:
            kept.copy(system.q)
            system.residual(system.q, system.residual_vector)

    def solve_linear(self, right: Any, found: Any) -> None:
        """Solve with the last tangent; Newton corrects a coarse solution, nothing corrects this.

        Raises:
            NotConverged: If an iterative solver does not come so far.
        """
        solver, kind, coarse = self._ksp, self._ksp.getType(), self._ksp.getTolerances()[0]
        if solver.getPC().getType() == "fieldsplit":  # one sweep over them is nearly exact
            solver.setType("gmres")
        solver.setTolerances(rtol=_EXACT)
        solver.solve(right, found)
        solver.setTolerances(rtol=coarse)
        solver.setType(kind)
        if solver.getConvergedReason() < 0 and self.iterative:
            raise NotConverged(_STALLED)

    # --- SNES callbacks --------------------------------------------------------------------------

    def _residual(self, _snes: Any, q: Any, out: Any) -> None:
        self.system.residual(q, out)

    def _tangent(self, _snes: Any, _q: Any, _matrix: Any, _preconditioner: Any) -> None:
        if not self._again:  # else PETSc keeps the factors, as the matrix is what it was
            self.assemble()
            self.iterations += 1
        self.system.eliminate(self.system.residual_vector)  # SNES evaluates it anew after the step

    def _test(self, _snes: Any, iteration: int, _norms: tuple[float, float, float]) -> Any:
        """Every field and every port within its own tolerance; if not, may the tangent serve again?

        A correction that makes the residual grow is taken back. A residual just within its
        tolerance is corrected once more, for works and energies that are compared.
        """
        before, corrected, size = self._size, self._again, self._judge()
        if size == math.inf:
            return DIVERGED_NAN
        if corrected and size > before > 1:
            self.system.q.axpy(1.0, self._snes.getSolutionUpdate())
            self._residual(None, self.system.q, self.system.residual_vector)
            size = self._judge()
        met = self._met(moved=iteration > 0)
        self._size, self._again = size, iteration > 0 and size <= _REUSE * before
        if met and not (self._again and size > _SURE and before > 1):
            return Reason.CONVERGED_FNORM_ABS
        if self.iterations == self._most and not self._again:
            return Reason.DIVERGED_MAX_IT
        return Reason.ITERATING

    def _judge(self) -> float:
        """The residual's largest part over what is tolerated, infinite if undefined."""
        system, residual = self.system, self.system.residual_vector
        self._norms = system.field_norms(residual)
        ports = system.map.port_values(residual)
        if log.isEnabledFor(logging.DEBUG):
            shown = [*zip(FIELDS, self._norms, strict=True), *ports.items()]
            log.debug(
                "  %2d  %s", self.iterations, "  ".join(f"{k} {abs(v):.1e}" for k, v in shown)
            )
        limits = self._tolerances.of_ports(system.ports)
        self._worst_port = max((abs(ports[n]) / limit for n, limit in limits.items()), default=0.0)
        size = max(self._worst_field, self._worst_port)
        return size if math.isfinite(size) else math.inf

    @property
    def _worst_field(self) -> float:
        return float((self._norms / self._tolerances.fields).max())

    def _met(self, moved: bool = True) -> bool:
        """Whether every field and every port is within its own tolerance.

        Args:
            moved: Whether there was a step, that could have been negligible.
        """
        if not self._worst_port <= 1:
            return False
        near = moved and self._worst_field <= _ROUNDING
        return self._worst_field <= 1 or (near and self._step_is_negligible())

    def _told(self, what: str) -> str:
        """A failure, and where it is worst."""
        worst = ", ".join(
            f"{name} {norm / limit:.1e}"
            for name, norm, limit in zip(FIELDS, self._norms, self._tolerances.fields, strict=True)
            if not norm <= limit
        )
        return f"{what} (residual over tolerance: {worst or 'ports'})"

    def _step_is_negligible(self) -> bool:
        """Whether the last step was so small that the next one cannot matter.

        Near incompressibility the residual cannot fall below its own rounding error, of the order
        of the bulk modulus; Newton's step still shows that the state is exact.
        """
        step = self.system.field_norms(self._snes.getSolutionUpdate())
        return bool((step <= self._tolerances.steps).all())


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
