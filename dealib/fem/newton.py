"""Newton's method by PETSc SNES, with a convergence test for each field and reused tangents."""

from __future__ import annotations

import math
import weakref
from collections.abc import Callable
from functools import cached_property
from typing import Any

from petsc4py import PETSc

from dealib.config.schema import Config
from dealib.errors import NotConverged
from dealib.fem.compat import DIVERGED_NAN, free
from dealib.fem.electrostatics import Electrostatics
from dealib.fem.linear import (
    Factor,
    factorisation_seconds,
    fixed_tangent,
    set_linear_solver,
    set_options,
)
from dealib.fem.modes import Eigenmodes, averaged, lowest
from dealib.fem.problem import Problem
from dealib.fem.system import System
from dealib.fem.timings import Timings
from dealib.fem.tolerances import Judge

_OPTIONS: dict[str, Any] = {"snes_type": "newtonls", "snes_linesearch_type": "basic"}
_FITS = 0.1  # largest correction of a rate over the rate, for a tangent that fits
_SURE = 0.01  # residual over tolerance below which no correction is needed
_REUSE = 0.1  # largest ratio of residuals of an iteration whose tangent is used again
_EXACT = 1e-12  # tolerance of a linear solution that is not corrected afterwards
_FOLDING = 5  # times as many iterations in tension fields, whose tangent is discontinuous
_MANY = 10_000  # limit for SNES, which `_test` never reaches
_EXTERNAL = 76  # PETSc's code for errors of MUMPS, as where whole rows of the tangent are zero
_SINGULAR = (
    "the tangent is singular: a part is not held, or a slack film does not hold it yet; a flat "
    "membrane needs a pre-stretch, or a hold across it"
)
_STALLED = "the iterative linear solver did not converge; try solver.linear: direct"
Reason = PETSc.SNES.ConvergedReason


class Singular(NotConverged):
    """The tangent cannot be factorised; PETSc's solver is unusable afterwards."""


class Newton:
    """Solves the reduced system for the current port equations.

    Attributes:
        system: The system.
        iterations: Iterations of the last solve, without corrections (see `solve`).
        linear_solves: Linear systems of the last solve, corrections included.
        linear_iterations: Linear iterations of the last solve; one for each direct solution.
        total: Iterations of all solves.
        iterative: Whether the linear solver is iterative.
        usable: Whether PETSc's solver can go on, as it cannot after `Singular`.
        linear_solver: Description of the linear solver and its memory.

    Args:
        problem: The problem.
        timings: Timings to which times are added.
        symmetric: False if a port's equation sums the values of several ports.
    """

    def __init__(self, problem: Problem, timings: Timings, symmetric: bool = True) -> None:
        free(problem.domain.comm)  # objects of earlier simulations
        self.system = System(problem, timings)
        self._snes = PETSc.SNES().create(problem.domain.comm)
        self._snes.setFunction(_weak(self._residual), self.system.residual_vector)
        self._snes.setJacobian(_weak(self._tangent), self.system.matrix)
        self._snes.setConvergenceTest(_weak(self._test))
        # `_test` alone decides; PETSc 3.25 would take a failed line search for convergence
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
        self._judge = Judge(self.system)
        self._most = _iterations(problem.config)
        self._logged = factorisation_seconds()
        self._size, self._again, self._known = math.inf, False, False

    def restart(self) -> None:
        """Start anew with the current numbers of the problem (see `Reuse`)."""
        free(self.system.map.comm)
        timings = Timings()
        self.system.restart(timings)
        self._start(timings)

    def solve(self, known: bool = False) -> int:
        """Solve from the current q; returns the number of iterations.

        If an iteration reduces the residual strongly, its tangent is used again for corrections, at
        a sixth of the cost, as long as they converge. Corrections are not counted.

        Args:
            known: Whether q was found before under the same equations (see `Judge.met`).

        Raises:
            NotConverged: With the reason; q is then meaningless.
        """
        free(self.system.map.comm)
        self.iterations, self._size, self._again, self._known = 0, math.inf, False, known
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
            reasons = {
                Reason.DIVERGED_MAX_IT: "no convergence within the iterations allowed",
                DIVERGED_NAN: "an element is inverted, or a law has no energy there",
                Reason.DIVERGED_LINEAR_SOLVE: _STALLED if self.iterative else _SINGULAR,
            }
            raise NotConverged(self._judge.told(reasons.get(reason, f"SNES reason {reason}")))
        if self.system.problem.locked():
            raise NotConverged("a law locks: it is stretched to 99 % of its limit")
        return self.iterations

    def answer(self) -> Any:
        """Linear change of q after a small change of the inputs; None if the tangent does not fit.

        It takes two back-substitutions with the last tangent. The second one corrects the first,
        and is small if that tangent is the one of this state and of these equations of the ports.
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
        """Assemble the tangent at the last residual; PETSc factorises it when it is needed."""
        self.system.tangent(self.system.matrix)

    @cached_property
    def electrostatics(self) -> Electrostatics:
        """Solves for the field with the body fixed."""
        return Electrostatics(self.system, self.iterative)

    @property
    def factorisation_seconds(self) -> float:
        """Time in symbolic and numeric factorisations and back-substitutions since the start."""
        return factorisation_seconds() - self._logged

    def responses(self, *ports: str) -> list[Any]:
        """Derivatives of q by the right-hand sides of ports' equations (collective).

        They take one tangent at the current q, and one back-substitution for each port.

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
        """Number of unstable modes under the ports' equations (collective)."""
        return self.inertia()[0] - self.concave

    def softest_modes(self, count: int) -> Eigenmodes:
        """Modes of least stiffness at the current q under the ports' equations (collective)."""
        tangent = fixed_tangent(self.system)
        return lowest(tangent, averaged(self.system), self.concave, count)

    @property
    def concave(self) -> int:
        """Number of unknowns in which the potential is concave (collective).

        They are phi, the pressure, and free ports of negative sign. Each accounts for one negative
        eigenvalue of the tangent; the others are those of the condensed mechanical tangent
        (Haynsworth, Linear Algebra Appl. 1 (1968) 73).
        """
        system = self.system
        mine = sum(len(system.map.numbers(field)) for field in ("potential", "pressure"))
        free = (p for p in system.problem.device.ports if system.ports[p.name].value is None)
        return int(system.map.comm.allreduce(mine) + sum(p.kind.sign < 0 for p in free))

    def linearise(self) -> None:
        """Assemble the tangent at the current q (collective)."""
        self.system.residual(self.system.q, self.system.residual_vector)
        self.assemble()

    def step_from(self, q: Any) -> None:
        """Set q to one Newton step from another state (collective).

        The tangent is that of the last `linearise`.
        """
        system, found = self.system, q.duplicate()
        system.residual(q, system.residual_vector)
        system.eliminate(system.residual_vector)
        self.solve_linear(system.residual_vector, found)
        q.copy(system.q)
        system.q.axpy(-1.0, found)
        system.residual(system.q, system.residual_vector)

    def polish(self) -> None:
        """Correct q by one more Newton step if that reduces the residual (collective)."""
        system, kept = self.system, self.system.q.copy()
        self.linearise()
        before = system.residual_vector.norm()
        self.step_from(kept)
        if not system.residual_vector.norm() < before:
            kept.copy(system.q)
            system.residual(system.q, system.residual_vector)

    def solve_linear(self, right: Any, found: Any) -> None:
        """Solve with the last tangent to rounding, since no iteration corrects the solution.

        Raises:
            NotConverged: If an iterative solver does not converge so far.
        """
        solver, coarse = self._ksp, self._ksp.getTolerances()[0]
        solver.setTolerances(rtol=_EXACT)
        solver.solve(right, found)
        solver.setTolerances(rtol=coarse)
        if solver.getConvergedReason() < 0 and self.iterative:
            raise NotConverged(_STALLED)

    # --- SNES callbacks --------------------------------------------------------------------------

    def _residual(self, _snes: Any, q: Any, out: Any) -> None:
        self.system.residual(q, out)

    def _tangent(self, _snes: Any, _q: Any, _matrix: Any, _preconditioner: Any) -> None:
        if not self._again:  # otherwise the matrix is unchanged, and PETSc keeps its factors
            self.assemble()
            self.iterations += 1
        # SNES evaluates the residual anew after the step
        self.system.eliminate(self.system.residual_vector)

    def _test(self, _snes: Any, iteration: int, _norms: tuple[float, float, float]) -> Any:
        """Test convergence, and decide whether the tangent is used again.

        A correction that makes the residual grow is taken back. A residual that is just within its
        tolerance is corrected once more, since works and energies are compared in the balance.
        """
        before, corrected = self._size, self._again
        size = self._judge.size(self.iterations)
        if size == math.inf:
            return DIVERGED_NAN
        if corrected and size > before > 1:
            self.system.q.axpy(1.0, self._snes.getSolutionUpdate())
            self._residual(None, self.system.q, self.system.residual_vector)
            size = self._judge.size(self.iterations)
        step = self._snes.getSolutionUpdate() if iteration > 0 else None
        met = self._judge.met(step, self._known and step is None)
        self._size, self._again = size, iteration > 0 and size <= _REUSE * before
        if met and not (self._again and size > _SURE and before > 1):
            return Reason.CONVERGED_FNORM_ABS
        if self.iterations == self._most and not self._again:
            return Reason.DIVERGED_MAX_IT
        return Reason.ITERATING


def _iterations(config: Config) -> int:
    """Largest number of iterations; tension fields need more."""
    folding = config.physics.wrinkling == "tension_field"
    return config.solver.max_iterations * (_FOLDING if folding else 1)


def _weak(method: Callable[..., Any]) -> Callable[..., Any]:
    """A callback that does not keep its object alive, nor the mesh and its communicator with it.

    PETSc holds callbacks where Python's garbage collector does not see them, so that bound methods
    would make a cycle that is never freed.
    """
    found = weakref.WeakMethod(method)

    def call(*arguments: Any) -> Any:
        alive = found()
        assert alive is not None
        return alive(*arguments)

    return call
