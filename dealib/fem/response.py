"""Small harmonic changes about a state: one solution of a symmetric system for each frequency.

With x = Re(X exp(i omega t)) about an equilibrium in which the Maxwell branches have relaxed,

    (A + iB) X = F,  A + iB = K + sum z K_v - omega^2 M + i omega (a M + b K_u) + i/omega G,

where K is the tangent of the relaxed state, and K_v the contribution of a branch whose internal
metric is held; z = i omega tau/(1 + i omega tau) is exact for small changes. M is the mass, a M +
b K_u Rayleigh's damping, and G the conductances of resistive electrodes and of the openings of
chambers. `fem.pairs` solves it in real numbers, `fem.reduction` finds many frequencies from a few.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass
from typing import Any

from petsc4py import PETSc

import numpy as np

from dealib.config.chamber import Filled
from dealib.fem import conduction
from dealib.fem.linear import fixed_tangent
from dealib.fem.newton import Newton
from dealib.fem.pairs import Pairs
from dealib.fem.reduction import Complex, Reduction
from dealib.fem.system import System
from dealib.fem.vibrations import switched
from dealib.fem.viscous import Viscosity

_STRAIGHT = 0.05  # relative deviation from a straight line above which a frequency is added
_APART, _AT_ONCE = 1.0001, 8  # least ratio of neighbouring frequencies; intervals refined at once


@dataclass(frozen=True)
class Change:
    """The response to a unit voltage at a terminal, 1 kV, at one frequency.

    Attributes:
        frequency: Hz.
        values: Complex value of each port.
        duals: dPi/dq of each port that is held; for the terminal it is minus the charge.
        vectors: Real and imaginary parts of the reduced unknowns; the next change overwrites them.
    """

    frequency: float
    values: dict[str, complex]
    duals: dict[str, complex]
    vectors: tuple[Any, Any]


class Response:
    """The linearised system at a state, for any frequency.

    Attributes:
        system: The system to whose reduced unknowns the changes belong.

    Args:
        newton: The solver; its state is an equilibrium.
        viscosity: State of the Maxwell branches, if there are some; they have relaxed.
        terminal: Name of the terminal that is driven.
    """

    def __init__(self, newton: Newton, viscosity: Viscosity | None, terminal: str) -> None:
        system, self._terminal = newton.system, terminal
        config = system.problem.config
        conducts = config.sensing.sheet_resistance is not None
        self.system = conduction.resolved(system) if conducts else system
        self.system.residual(self.system.q, self.system.residual_vector)
        with switched(self.system, terminal, opened=True):
            self._assemble(viscosity, conducts)

    def _assemble(self, viscosity: Viscosity | None, conducts: bool) -> None:
        system = self.system
        damping = system.problem.config.damping
        with _relaxed(viscosity):
            relaxed = fixed_tangent(system)
        fixed = [name for name, law in system.ports.items() if law.fixed]
        self._columns = {name: {"stiffness": system.column(name)} for name in fixed}
        self._parts = {"stiffness": relaxed}
        self._add("mass", system.mass())
        self._times = sorted(
            {b.relaxation_time for m in system.problem.config.solids.values() for b in m.branches}
        )
        for tau in self._times:
            assert viscosity is not None
            with viscosity.held(lambda b, tau=tau: b.relaxation_time == tau):  # type: ignore[misc]
                stiff = fixed_tangent(system)
            stiff.axpy(-1.0, relaxed)
            self._parts[f"branch {tau!r}"] = stiff
            for name in fixed:
                column = system.column(name)
                column.axpy(-1.0, self._columns[name]["stiffness"])
                self._columns[name][f"branch {tau!r}"] = column
        if damping.stiffness:
            with _relaxed(viscosity):
                system.expand(system.q)
                self._add("damping", system.stiffness())
                system.expand(system.q)
        if conducts:
            self._add("conductance", conduction.conductance(system))
        if (openings := _openings(system)) is not None:
            self._add("openings", openings)
        self._damping = damping
        self._pairs = Pairs(self._parts)

    def _add(self, name: str, part: Any) -> None:
        """Add a part; its columns of prescribed ports give their duals."""
        for port, column in self.system.take(part).items():
            self._columns[port][name] = column
        self._parts[name] = part

    def at(self, frequencies: Sequence[float], more: int = 0) -> Iterator[Change]:
        """The response at some frequencies in order, Hz (collective).

        Args:
            frequencies: The frequencies.
            more: Largest number of further ones, added where the response is curved.
        """
        system = self.system
        right = system.q.duplicate()
        right.set(0.0)
        system.map.set_port(right, self._terminal, 1.0)
        right.assemble()
        vectors = right.duplicate(), right.duplicate()

        def split(x: Complex) -> tuple[Any, Any]:
            for vector, part in zip(vectors, (x.real, x.imag), strict=True):
                vector.array[:] = part
            return vectors

        def ports(x: Complex) -> Complex:
            one, other = (system.map.port_values(part) for part in split(x))
            return np.array([complex(one[name], other[name]) for name in one])

        reduced = Reduction(
            *(self._parts, right, lambda f: self._pairs.solve(f, right), ports),
            apart=("conductance", "openings"),
        )
        place = list(system.map.ports).index(self._terminal)

        def looked_at(frequencies: Sequence[float]) -> list[_Found]:
            found = []
            for y in reduced.at([self._factors(2 * np.pi * hertz) for hertz in frequencies]):
                volts = ports(reduced.whole(y))[place]
                found.append(_Found(y / volts, 1 / volts))
            return found

        known = dict(zip(frequencies, looked_at(frequencies), strict=True))
        _refine(known, looked_at, lambda y: reduced.size(y, "mass"), more)
        for hertz, found in sorted(known.items()):
            factors = self._factors(2 * np.pi * hertz)
            parts = split(reduced.whole(found.y))
            one, other = (system.map.port_values(part) for part in parts)
            values = {name: complex(one[name], other[name]) for name in one}
            duals = {self._terminal: found.charge}
            for name, columns in self._columns.items():
                duals[name] = sum(
                    factors[key] * complex(*(column.dot(part) for part in parts))
                    for key, column in columns.items()
                )
            yield Change(hertz, values, duals, vectors)

    def _factors(self, omega: float) -> dict[str, complex]:
        """Factor of each part at an angular frequency."""
        found: dict[str, complex] = {
            "stiffness": 1.0,
            "mass": -(omega**2) + 1j * omega * self._damping.mass,
            "damping": 1j * omega * self._damping.stiffness,
            "conductance": 1j / omega,
            "openings": 1j / omega,
        }
        for tau in self._times:
            turn = 1j * omega * tau
            found[f"branch {tau!r}"] = turn / (1 + turn)
        return found


@dataclass(frozen=True)
class _Found:
    """The response to a unit voltage: coordinates of X, and the charge."""

    y: Complex
    charge: complex


def _refine(
    known: dict[float, _Found],
    look: Callable[[Sequence[float]], list[_Found]],
    size: Callable[[Complex], float],
    more: int,
) -> None:
    """Add frequencies in intervals in which the response is not straight, the worst first.

    Args:
        known: The response at each frequency; is extended.
        look: Finds the response at other frequencies.
        size: Norm of a motion.
        more: Largest number of frequencies to add.
    """
    # intervals that are not straight, with their middle: deviation there, and response
    bent: dict[tuple[float, float, float], tuple[float, _Found]] = {}

    def check(pairs: Iterable[tuple[float, float]]) -> None:
        places = [
            (low, float(np.sqrt(low * high)), high) for low, high in pairs if high / low > _APART
        ]
        for place, here in zip(places, look([middle for _, middle, _ in places]), strict=True):
            one, other = known[place[0]], known[place[-1]]
            off = here.y.copy()
            for end in (one, other):
                off[: len(end.y)] -= end.y / 2
            missed, most = size(off), max(size(found.y) for found in (one, here, other))
            charge = abs(here.charge - (one.charge + other.charge) / 2) / abs(here.charge)
            if max(missed / most, charge) > _STRAIGHT:
                bent[place] = missed, here

    if more:
        check(itertools.pairwise(sorted(known)))
    while bent and more:
        worst = sorted(bent, key=lambda place: -bent[place][0])[: min(_AT_ONCE, more)]
        more -= len(worst)
        known |= {place[1]: bent.pop(place)[1] for place in worst}
        check(pair for place in worst for pair in itertools.pairwise(place))


def _openings(system: System) -> Any:
    """Conductances of the chambers' openings as a diagonal matrix; None without openings."""
    found = system.q.duplicate()
    found.set(0.0)
    filled = False
    for name, law in system.ports.items():
        for inside in (e for e, _ in law.elements if isinstance(e, Filled)):
            filled = True
            system.map.set_port(found, name, inside.leak(system.values[name]))
    if not filled:
        return None
    found.assemble()
    (start, end), size = found.getOwnershipRange(), (found.getLocalSize(), found.getSize())
    rows, columns = np.arange(end - start + 1), np.arange(start, end)
    csr = rows.astype(PETSc.IntType), columns.astype(PETSc.IntType), found.array_r
    matrix = PETSc.Mat().createAIJ((size, size), csr=csr, comm=found.comm)
    matrix.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
    return matrix


def _relaxed(viscosity: Viscosity | None) -> AbstractContextManager[None]:
    """A context in which branches relax at once."""
    return nullcontext() if viscosity is None else viscosity.held(lambda branch: False)


@contextmanager
def relaxed_state(newton: Newton, viscosity: Viscosity | None) -> Iterator[None]:
    """A context at the equilibrium in which all branches have relaxed (collective)."""
    system, kept = newton.system, newton.system.q.copy()
    try:
        with _relaxed(viscosity):
            if viscosity is not None:
                newton.solve()
            newton.polish()
        system.expand(system.q)
        with nullcontext() if viscosity is None else viscosity.relaxed():
            yield
    finally:
        kept.copy(system.q)
        system.residual(system.q, system.residual_vector)
