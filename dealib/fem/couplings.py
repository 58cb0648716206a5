"""How the electric field loads the body: each coupling gives the residual of the whole problem.

`energy` is the derivative of one potential. The others are those of the thesis (section 3.2.3), for
comparison: phi solves the electrostatic problem on the deformed body, and the load on the body is
prescribed as a function of the field. It has no potential, so that the tangent is not symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import ufl

from dealib.fem.energies import Energy, IdealDielectric
from dealib.fem.integrals import Integrals

FILM, FACES = "film", ("film_top", "film_bottom")  # of annular strips; loads work for them only


class Body(Protocol):
    """The part of a problem that couplings use."""

    @property
    def integrals(self) -> Integrals:
        """Its integrals and points."""

    @property
    def state(self) -> Any:
        """The state's function."""

    @property
    def body(self) -> list[Energy]:
        """Energies of the solids."""

    @property
    def electric(self) -> list[Energy]:
        """Electric energies."""

    def first(self, energies: list[Energy], test: Any) -> Any:
        """First variation of a sum of energies."""


class Coupling(Protocol):
    """One way to couple field and body.

    Attributes:
        symmetric: Whether the residual is a derivative of one potential, its tangent symmetric.
    """

    symmetric: ClassVar[bool]

    def residual(self, problem: Body, test: Any) -> Any:
        """Linear form of the virtual work, internal minus external; zero in equilibrium.

        Args:
            problem: The problem.
            test: Test function of its mixed space.
        """


class FieldLoad(Protocol):
    """A load of the field on the body that is not derived from an energy."""

    def __call__(self, problem: Body, v: Any) -> Any:
        """Its virtual work at a virtual displacement v = (v_R, v_Z)."""


@dataclass(frozen=True)
class OnePotential:
    """The energies of body and field are one potential."""

    symmetric: ClassVar[bool] = True

    def residual(self, problem: Body, test: Any) -> Any:
        """See `Coupling`."""
        return problem.first(problem.body + problem.electric, test)


@dataclass(frozen=True)
class Loaded:
    """Body and field have separate energies, and the field loads the body.

    Attributes:
        load: The load.
    """

    symmetric: ClassVar[bool] = False
    load: FieldLoad

    def residual(self, problem: Body, test: Any) -> Any:
        """See `Coupling`."""
        v, psi, *rest = ufl.split(test)
        charges = ufl.as_vector([0, 0, psi, *(0 for _ in rest)])  # of the potential only
        body = problem.first(problem.body, test)
        field = problem.first(problem.electric, charges)
        return body + field - self.load(problem, v)


def maxwell_traction(problem: Body, v: Any) -> Any:
    """Maxwell's traction on the electrodes where they touch the film.

    T n with T = eps (e (x) e - e.e I / 2) (thesis, eq. 5) at the field in the film; n points out
    of the electrode.
    """
    F, e, eps = _film_field(problem)
    N = problem.integrals.face.N  # out of the film
    n_da = -ufl.det(F) * ufl.inv(F).T * N  # Nanson, per dA
    traction = eps * (ufl.dot(e, n_da) * e - ufl.dot(e, e) / 2 * n_da)
    work = traction[0] * v[0] + traction[1] * v[1]
    return sum(problem.integrals.over_face(face, work, FILM) for face in FACES)


def pelrine(problem: Body, v: Any) -> Any:
    """Pelrine's pressure p = eps (V/d)^2 across the film (thesis, section 2.4.2).

    It is the stress -eps e (x) e with |e| = V/d: the pressure p on both faces, with equal and
    opposite forces on opposite patches of the electrodes, as between charges. A follower pressure
    on each face would differ: on a bent film the outer patch is larger, and on an incompressible
    film between clamps the pressure is hydrostatic and deforms nothing.
    """
    _, e, eps = _film_field(problem)
    return _stress_across(problem, v, eps, e)


def pelrine_undeformed(problem: Body, v: Any) -> Any:
    """Pelrine's pressure with the undeformed thickness, p = eps (V/H)^2.

    It does not grow as the film thins, and has no potential.
    """
    F, _, eps = _film_field(problem)
    E = problem.integrals.point.E
    across = ufl.inv(F).T * ufl.as_vector([0, 1, 0])  # the film lies flat in the mesh
    normal = across / ufl.sqrt(ufl.dot(across, across))
    return _stress_across(problem, v, eps * ufl.dot(E, E), normal)


def _stress_across(problem: Body, v: Any, factor: Any, e: Any) -> Any:
    """Virtual work of the true stress -factor e (x) e in the film."""
    F, w = problem.integrals.point.F, problem.state
    stress = -factor * ufl.det(F) * ufl.outer(e, ufl.inv(F) * e)  # Piola, mesh area
    direction = ufl.as_vector([v[0], v[1], *(0 for _ in range(2, len(w)))])
    return problem.integrals.over(FILM, ufl.inner(stress, ufl.derivative(F, w, direction)))


def _film_field(problem: Body) -> tuple[Any, Any, Any]:
    """Deformation gradient, true field, and the film's permittivity."""
    point = problem.integrals.point
    F, E = point.F, point.E
    dielectrics = (part for part in problem.electric if isinstance(part, IdealDielectric))
    (film,) = (part for part in dielectrics if part.on == FILM)
    return F, ufl.inv(F).T * E, film.at(F)


COUPLINGS: dict[str, Coupling] = {
    "energy": OnePotential(),
    "maxwell_traction": Loaded(maxwell_traction),
    "pelrine": Loaded(pelrine),
    "pelrine_undeformed": Loaded(pelrine_undeformed),
}
