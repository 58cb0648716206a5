"""How near a film is to its limits, as utilisations: 1 is the limit, and above it is beyond.

In the plane of the film, direction 1 is that of its meridian, F e_R, and 2 is the hoop. Maxwell
branches add to the tension; stability is judged by the law alone, since branches relax.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.config.schema import Config
from dealib.materials.branches import Branch
from dealib.materials.evolution import IDENTITY
from dealib.materials.laws import Law, invariants_of_stretches
from dealib.materials.prestretch import bracket
from dealib.materials.response import curvature, softens, stiffness
from dealib.results import local
from dealib.results.elements import Array
from dealib.results.mesh import ResultMesh
from dealib.results.thickness import Columns, edges


@dataclass(frozen=True)
class Film:
    """What the margins need to know of a film.

    Attributes:
        material: Law, permittivity and pre-stretch.
        tension: That `wrinkling_use` counts from, MPa; with branches if these are mounted fresh.
        stiffness: Of the law at rest, for changes of shape, MPa.
        softens: Whether the law can lose it.
    """

    material: local.RegionMaterial
    tension: float
    stiffness: float
    softens: bool

    @classmethod
    def of(cls, config: Config) -> Film:
        """The film of a config."""
        material = local.region_materials(config)["film"]
        law = material.law
        assert law is not None
        rest = float(stiffness(law, 1.0, 1.0))
        fresh = config.materials.film.mounted == "fresh"
        mounted = _mounted_tension(material, material.branches if fresh else ())
        return cls(material, mounted if mounted > 1e-9 * rest else rest / 2, rest, softens(law))

    @property
    def law(self) -> Law:
        """Its law."""
        assert self.material.law is not None
        return self.material.law

    @property
    def prestretch(self) -> Array:
        """Its stretches (radial, thickness, hoop) in the mesh."""
        assert self.material.prestretch is not None
        return self.material.prestretch

    def stretches(self, F: Array) -> tuple[Array, Array]:
        """Stretches in the plane since the unstretched state, at deformations from the mesh."""
        p = self.prestretch
        return np.hypot(F[..., 0, 0], F[..., 1, 0]) * p[0], F[..., 2, 2] * p[2]

    def tensions(
        self, k: local.Kinematics, pressure: Array | None = None, internal: Array | None = None
    ) -> Array:
        """In-plane true stresses of the material plus Maxwell's, (..., 2), MPa.

        Args:
            k: Deformation and field.
            pressure: The mixed form's p, (...).
            internal: C_i of its Maxwell branches, (..., branches, 4), if it has some.
        """
        m = self.material
        S = local.second_pk(self.law, k.F, m.prestretch, pressure)
        if internal is not None:
            S += local.branches_pk(m.branches, k.F, internal, m.prestretch)
        # t = F e_R / |F e_R| of the meridian, and F^T t
        x, y = k.F[..., 0, 0], k.F[..., 1, 0]
        length = np.hypot(x, y)
        turned = (x * k.F[..., 0, 1] + y * k.F[..., 1, 1]) / length
        radial = length * length * S[..., 0, 0] + turned * turned * S[..., 1, 1]
        radial = radial + 2 * length * turned * S[..., 0, 1]
        hoop = k.F[..., 2, 2] ** 2 * S[..., 2, 2]
        # Maxwell's eps (e.t)^2 - eps e.e / 2, and electrostriction: alike in both directions
        more = m.slope * m.area_stretch(k.F) if m.slope else 0.0
        eps, square = m.permittivity + more, k.e[..., 0] ** 2 + k.e[..., 1] ** 2
        electric = -(eps + more / 2) * square / 2
        radial = radial / k.J + eps * ((x * k.e[..., 0] + y * k.e[..., 1]) / length) ** 2
        return np.stack([radial + electric, hoop / k.J + electric], axis=-1)

    def wrinkling(self, tensions: Array) -> Array:
        """Share of the mounted tension that is lost, from tensions (..., 2) averaged across.

        A membrane wrinkles where it has no tension left in some direction of its plane (for
        dielectric elastomers: J.-S. Plante and S. Dubowsky, Int. J. Solids Struct. 43 (2006)
        7727). Bending at the clamped ends compresses one face only; hence the average through the
        thickness. A film mounted without pre-stretch has no tension to lose: then it counts from
        its shear modulus, and is at its limit at rest.
        """
        return np.asarray(1 - tensions.min(axis=-1) / self.tension)

    def pull_in(self, k: local.Kinematics) -> Array:
        """Field over the one at which the film at its present stretches loses stability.

        The free energy of an incompressible film in terms of its in-plane stretches and electric
        displacement must be convex for the film to be stable under dead loads and a voltage
        (X. Zhao and Z. Suo, Appl. Phys. Lett. 91 (2007) 061921). At a given voltage that is

            A - eps e.e [[1, 2], [2, 1]] positive definite,  A_ij = l_i l_j d2W / dl_i dl_j,

        and with eps = a + b sqrt(l1 l2) the same with the second derivatives of eps (l1 l2)^2 / 2.
        Infinite where A itself is not: under dead loads that film fails without a field. A film
        whose edges are held is more stable than that, so that the margin is on the safe side.
        """
        gradient, hessian = curvature(self.law, *self.stretches(k.F))
        a, c = hessian[0] - gradient[0], hessian[1] - gradient[1]
        b = hessian[2]
        rising = self.material.slope * self.material.area_stretch(k.F)
        own, cross = (
            n * self.material.permittivity + f * rising for n, f in ((1, 1.875), (2, 3.125))
        )
        det, m = a * c - b * b, own * (a + c) - 2 * cross * b
        with np.errstate(all="ignore"):
            # the smaller root of (cross^2 - own^2) q^2 + m q - det = 0, q = e.e
            root = np.sqrt(m * m + 4 * (cross**2 - own**2) * det)
            used = np.einsum("...i,...i", k.e, k.e) * (m + root) / (2 * det)
            used = np.where(used > 0, np.sqrt(used), 0.0)  # no positive root: never lost
        return np.where((det > 0) & (a + c > 0), used, np.inf)

    def softening(self, F: Array) -> Array:
        """Share of the law's stiffness at rest that is lost (see `response.stiffness`)."""
        left = stiffness(self.law, *self.stretches(F)) / self.stiffness
        return np.asarray(np.maximum(1 - left, 0.0))

    def extension(self, F: Array) -> Array:
        """Share of the law's extensibility that is used, of a law that locks."""
        l1, l2 = self.stretches(F)
        i = invariants_of_stretches(l1, l2, 1 / (l1 * l2))
        return np.asarray(self.law.extension(i, self.law.values))


def _mounted_tension(material: local.RegionMaterial, fresh: tuple[Branch, ...]) -> float:
    """Smaller in-plane stress of the film as it is mounted, MPa.

    Args:
        material: The film's.
        fresh: Branches that carry the pre-stretch. Their stress across moves its faces a little,
            to where the film is free of stress across again.
    """
    from scipy.optimize import brentq

    law, internal = material.law, np.tile(IDENTITY, (len(fresh), 1))
    assert law is not None

    def stress(across: float) -> Array:
        F = np.diag([1.0, across, 1.0])
        S = local.second_pk(law, F, material.prestretch)
        S += local.branches_pk(fresh, F, internal, material.prestretch)
        return np.diag(local.cauchy(F, S))

    def free(across: float) -> float:
        return float(stress(across)[1])

    across = 1.0
    if fresh:
        ends = bracket(free, 1.0, 10.0)  # the volume alone sees to both signs
        assert ends is not None
        across = float(brentq(free, *ends, xtol=1e-14))
    radial, _, hoop = stress(across)
    return float(min(radial, hoop))


def meridional_stretch(F: Array) -> Array:
    """Larger principal stretch in the R-Z plane, shape F.shape[:-2]."""
    a, b = F[..., 0, 0] ** 2 + F[..., 1, 0] ** 2, F[..., 0, 1] ** 2 + F[..., 1, 1] ** 2
    c = F[..., 0, 0] * F[..., 0, 1] + F[..., 1, 0] * F[..., 1, 1]
    return np.asarray(np.sqrt((a + b) / 2 + np.hypot((a - b) / 2, c)))


def principal_stretch(F: Array) -> Array:
    """Largest principal stretch, shape F.shape[:-2]."""
    return np.maximum(meridional_stretch(F), F[..., 2, 2])


# --- fields --------------------------------------------------------------------------------------


def fields(
    config: Config, mesh: ResultMesh, state: Array, internal: Array | None = None
) -> dict[str, Array]:
    """Nodal margins of the film, 0 elsewhere: those of the history, pointwise.

    `wrinkling_use` is constant through the thickness, as its stress is; `tension`, the smallest
    in-plane true stress (MPa), is that of each point.

    Args:
        config: The config of the run.
        mesh: Mesh of the results.
        state: Nodal values, (nodes, 3 or 4).
        internal: As for `dealib.results.fields`.
    """
    film, cells = Film.of(config), mesh.in_region("film")
    points = local.Points.of(mesh.cell, mesh.corners[cells], mesh.cell.gauss)
    nodal = state[mesh.cells[cells]]
    k = points.kinematics(nodal[..., :2], nodal[..., 2])
    pressure = nodal[..., 3] @ points.N.T if state.shape[1] > 3 else None
    if internal is not None and film.material.branches:
        internal = internal[np.searchsorted(local.branch_cells(config, mesh), cells)]
    else:
        internal = None
    tensions = film.tensions(k, pressure, internal)
    corners = mesh.corners[cells]
    columns = Columns.of(edges(corners, points.position), corners, points.position)
    wrinkling = film.wrinkling(columns.average(tensions, k))
    found = {
        "tension": tensions.min(axis=-1),
        "wrinkling_use": wrinkling[columns.column],
        "pull_in_use": np.minimum(film.pull_in(k), 2.0),  # bounded, to be drawn
    }
    if film.softens:
        found["stability_use"] = film.softening(k.F)
    if film.law.locks:
        found["locking_use"] = film.extension(k.F)
    if config.limits.breakdown is not None:
        found["breakdown_use"] = np.linalg.norm(k.e, axis=-1) / config.limits.breakdown
    if config.limits.stretch_max is not None:
        stretch = principal_stretch(k.F * film.prestretch)
        found["stretch_use"] = stretch / config.limits.stretch_max
    out = {name: np.zeros(len(mesh.points)) for name in found}
    mesh.average({n: values @ mesh.cell.from_gauss.T for n, values in found.items()}, cells, out)
    return out
