"""How the electric field loads the body: each coupling gives the residual of the whole problem.

`energy` is the derivative of one potential. The others are those of the thesis (section 3.2.3),
for comparison: phi still solves the electrostatic problem on the deformed body, but the load that
it puts on the body is written down, so that no potential stands behind it and the tangent is not
symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Protocol

from mpi4py import MPI

import ufl
from dolfinx import fem

from dealib.fem import compat
from dealib.fem.energies import IdealDielectric
from dealib.fem.kinematics import inverse_transpose, jacobian
from dealib.geometry import names

if TYPE_CHECKING:
    from dealib.fem.problem import Problem


class Coupling(Protocol):
    """One way to couple field and body.

    Attributes:
        symmetric: Whether the residual is a derivative of one potential, its tangent symmetric.
    """

    symmetric: ClassVar[bool]

    def residual(self, problem: Problem, test: Any) -> Any:
        """Linear form of the virtual work, internal minus external; zero in equilibrium.

        Args:
            problem: The problem.
            test: Test function of its mixed space.
        """


class Load(Protocol):
    """What the field does to the body where no energy says it."""

    def __call__(self, problem: Problem, v: Any) -> Any:
        """Its virtual work at a virtual displacement v = (v_R, v_Z)."""


@dataclass(frozen=True)
class OnePotential:
    """The energies of body and field are one potential."""

    symmetric: ClassVar[bool] = True

    def residual(self, problem: Problem, test: Any) -> Any:
        """See `Coupling`."""
        total = problem.potential(problem.body + problem.electric)
        return ufl.derivative(total, problem.spaces.w, test)


@dataclass(frozen=True)
class Loaded:
    """Body and field each have their energy, and the field loads the body.

    Attributes:
        load: The load.
    """

    symmetric: ClassVar[bool] = False
    load: Load

    def residual(self, problem: Problem, test: Any) -> Any:
        """See `Coupling`."""
        w, (v, psi, *rest) = problem.spaces.w, ufl.split(test)
        charges = ufl.as_vector([0, 0, psi, *(0 for _ in rest)])  # of the potential only
        body = ufl.derivative(problem.potential(problem.body), w, test)
        field = ufl.derivative(problem.potential(problem.electric), w, charges)
        return body + field - self.load(problem, v)


def maxwell_traction(problem: Problem, v: Any) -> Any:
    """Maxwell's traction on the electrodes where they touch the film.

    T n with T = eps (e (x) e - e.e I / 2) (thesis, eq. 5) at the field in the film; n points out
    of the electrode.
    """
    F, e, eps = _film_field(problem)
    N = ufl.FacetNormal(problem.device.mesh)  # out of the film
    n_da = -jacobian(F) * inverse_transpose(F) * ufl.as_vector([N[0], N[1], 0])  # Nanson, per dA
    traction = eps * (ufl.dot(e, n_da) * e - ufl.dot(e, e) / 2 * n_da)
    work = (traction[0] * v[0] + traction[1] * v[1]) * problem.kinematics.volume
    film = _indicator(problem, names.FILM)
    terms = []
    for face in (names.FILM_TOP, names.FILM_BOTTOM):
        if _inside(problem, face):  # one of its sides is the film
            both = film("+") * work("+") + film("-") * work("-")
            terms.append(both * problem.facets("dS", face))
        else:
            terms.append(work * problem.facets("ds", face))
    return terms[0] + terms[1]


def pelrine(problem: Problem, v: Any) -> Any:
    """Pelrine's pressure p = eps (V/d)^2 across the film (thesis, section 2.4.2).

    The stress -p along the field, -eps e (x) e with |e| = V/d: the pressure p on both faces, with
    equal and opposite forces on facing patches of the electrodes, as between charges. (A follower
    pressure on each face for itself does something else: on a bent film the outer patch is larger,
    and on an incompressible film between clamps it is hydrostatic and moves nothing.)
    """
    _, e, eps = _film_field(problem)
    return _stress_across(problem, v, eps, e)


def pelrine_undeformed(problem: Problem, v: Any) -> Any:
    """The same with the thickness at rest: p = eps (V/H)^2 however far the film is squeezed.

    No energy stands behind it: it lacks the growth of the pressure as the film thins.
    """
    F, _, eps = _film_field(problem)
    _, E = problem.fields()
    across = inverse_transpose(F) * ufl.as_vector([0, 1, 0])  # the film lies flat in the mesh
    normal = across / ufl.sqrt(ufl.dot(across, across))
    return _stress_across(problem, v, eps * ufl.dot(E, E), normal)


def _stress_across(problem: Problem, v: Any, factor: Any, e: Any) -> Any:
    """Virtual work of the true stress -factor e (x) e in the film."""
    F, _ = problem.fields()
    stress = -factor * jacobian(F) * ufl.outer(e, inverse_transpose(F).T * e)  # Piola, mesh area
    w = problem.spaces.w
    direction = ufl.as_vector([v[0], v[1], *(0 for _ in range(2, len(w)))])
    work = ufl.inner(stress, ufl.derivative(F, w, direction))
    return work * problem.kinematics.volume * problem.measure("film")


COUPLINGS: dict[str, Coupling] = {
    "energy": OnePotential(),
    "maxwell_traction": Loaded(maxwell_traction),
    "pelrine": Loaded(pelrine),
    "pelrine_undeformed": Loaded(pelrine_undeformed),
}


def _film_field(problem: Problem) -> tuple[Any, Any, Any]:
    """Deformation gradient, true field, and the film's permittivity."""
    F, E = problem.fields()
    dielectrics = (part for part in problem.electric if isinstance(part, IdealDielectric))
    (film,) = (part for part in dielectrics if part.kind == "film")
    return F, inverse_transpose(F) * E, film.at(F)


def _indicator(problem: Problem, region: str) -> Any:
    """1 in the cells of a region, 0 elsewhere."""
    mesh = problem.device.mesh
    V = compat.functionspace(mesh, compat.element(mesh, "DG", 0))
    chi = fem.Function(V, name="indicator")
    chi.x.array[compat.cell_dofs(V)[problem.device.entities(region), 0]] = 1.0
    return chi


def _inside(problem: Problem, boundary: str) -> bool:
    """Whether a boundary has cells on both sides (the same on every rank)."""
    mesh = problem.device.mesh
    cells = mesh.topology.connectivity(1, 2)
    found = [len(cells.links(f)) for f in problem.device.entities(boundary)]
    return bool(mesh.comm.allreduce(max(found, default=0), op=MPI.MAX) > 1)
