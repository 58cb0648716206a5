"""Margins of a film: the used share of each of its limits, 1 being the limit.

In the plane of the film, direction 1 is that of F a, the deformed first tangent of its frame, and
direction 2 is perpendicular to it. Maxwell branches add to the tension. Stability is judged by the
law alone, since branches relax.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.arrays import Array
from dealib.config.schema import Config
from dealib.materials.branches import Branch
from dealib.materials.evolution import identity
from dealib.materials.laws import Law, invariants_of_stretches
from dealib.materials.prestretch import bracket
from dealib.materials.response import curvature, softens, stiffness
from dealib.results import local, stress
from dealib.results.elements import cross, dot
from dealib.results.mesh import ResultMesh
from dealib.results.thickness import Columns, edges

# Compression over the shear modulus G that a film without tension bears. An incompressible one
# buckles at pi^2/3 G (thickness/span)^2: this is for a 57th of the span (Timoshenko and Gere,
# Theory of Elastic Stability, 1961, wide plate with hinged ends). Rounding is far below it.
_BORNE = 1e-3


@dataclass(frozen=True)
class Film:
    """A film, as the margins need it.

    Attributes:
        material: Law, permittivity and pre-stretch.
        tension: Tension of the mounted film, MPa; with its branches if they are mounted fresh.
        stiffness: Stiffness of the law at rest against changes of shape, MPa.
        softens: Whether the law can lose this stiffness.
        frame: Normal and tangents in the mesh.
    """

    material: stress.RegionMaterial
    tension: float
    stiffness: float
    softens: bool
    frame: local.Frame

    @classmethod
    def of(
        cls, material: stress.RegionMaterial, fresh: bool, frame: local.Frame | None = None
    ) -> Film:
        """The film of a material.

        Args:
            material: The material.
            fresh: Whether its branches carry the pre-stretch at the start.
            frame: Normal and tangents; by default those of the material.
        """
        law = material.law
        assert law is not None
        rest = float(stiffness(law, 1.0, 1.0))
        tension = _mounted_tension(material, material.branches if fresh else ())
        frame = local.Frame.across(material.normal) if frame is None else frame
        return cls(material, tension, rest, softens(law), frame)

    @property
    def law(self) -> Law:
        """Its law."""
        assert self.material.law is not None
        return self.material.law

    def stretches(self, F: Array) -> tuple[Array, Array]:
        """In-plane principal stretches since the unstretched state, with F from the mesh."""
        rest = [v / self.material.stretch for v in (self.frame.a, self.frame.b)]  # unstretched
        a, b = (
            local.deformed(F, v) / np.sqrt(dot(r, r))[..., None]
            for v, r in zip((self.frame.a, self.frame.b), rest, strict=True)
        )
        A, B, C = dot(a, a), dot(b, b), dot(a, b)
        if not C.any():
            return np.sqrt(A), np.sqrt(B)
        half, mean = np.hypot((A - B) / 2, C), (A + B) / 2
        return np.sqrt(mean + half), np.sqrt(mean - half)

    def tensions(
        self, k: stress.Deformation, pressure: Array | None = None, internal: Array | None = None
    ) -> Array:
        """In-plane true stresses of the material plus Maxwell's, (..., 3): 11, 22 and 12, MPa.

        Args:
            k: Deformation and field.
            pressure: The mixed form's p, (...), MPa.
            internal: Internal variables, packed, (..., entries, 4).
        """
        one = _unit(local.deformed(k.F, self.frame.a))
        normal = np.einsum("...ji,...j", k.inverse, self.frame.n)
        two = cross(_unit(normal), one)
        return self.material.in_plane(k, one, two, pressure, internal)

    def thickness_stretch(self, k: stress.Deformation) -> Array:
        """Thickness over unstretched thickness: 1 / |F^-T n| since the unstretched state."""
        n = np.einsum("...ji,...j", k.inverse, self.frame.n)
        rest = np.linalg.norm(self.frame.n * self.material.stretch, axis=-1)
        return np.asarray(rest / np.sqrt(dot(n, n)))

    def wrinkling(self, tensions: Array) -> Array:
        """Lost share of the mounted tension, from tensions (..., 3) averaged over the thickness.

        A membrane wrinkles where it has no tension left in some direction of its plane (for
        dielectric elastomers: J.-S. Plante and S. Dubowsky, Int. J. Solids Struct. 43 (2006)
        7727). The average is taken because bending at the clamped ends compresses one face only.
        A film with little or no pre-stretch has no tension to lose, and bears some compression
        before it buckles. Its limit is a compression of `_BORNE` of its modulus at rest (half of
        `stiffness`), and tension that it gains is a share of that modulus.
        """
        loss, modulus = self.tension - smallest(tensions), self.stiffness / 2
        if self.tension >= _BORNE * modulus:
            return np.asarray(loss / self.tension)
        return np.asarray(loss / np.where(loss > 0, _BORNE, 1.0) / modulus)

    def pull_in(self, k: stress.Deformation) -> Array:
        """Field over the critical field at the present stretches of the film.

        The free energy of an incompressible film in terms of its in-plane stretches and electric
        displacement must be convex for the film to be stable under dead loads and a voltage
        (X. Zhao and Z. Suo, Appl. Phys. Lett. 91 (2007) 061921). At a given voltage that is

            A - eps e.e [[1, 2], [2, 1]] positive definite,  A_ij = l_i l_j d2W / dl_i dl_j,

        and with eps = a + b sqrt(l1 l2) the same with the second derivatives of eps (l1 l2)^2 / 2.
        The result is infinite where A itself is not positive definite: under dead loads that film
        fails without a field. A film whose edges are held is more stable, so that the margin is on
        the safe side.
        """
        gradient, hessian = curvature(self.law, *self.stretches(k.F))
        a, c = hessian[0] - gradient[0], hessian[1] - gradient[1]
        b = hessian[2]
        det, sound = a * c - b * b, a + c > 0
        if not k.e.any():
            return np.where((det > 0) & sound, 0.0, np.inf)
        rising = self.material.slope * self.material.area_stretch(k)
        own, cross = (
            n * self.material.permittivity + f * rising for n, f in ((1, 1.875), (2, 3.125))
        )
        m = own * (a + c) - 2 * cross * b
        with np.errstate(all="ignore"):
            # the smaller root of (cross^2 - own^2) q^2 + m q - det = 0, q = e.e
            root = np.sqrt(m * m + 4 * (cross**2 - own**2) * det)
            used = dot(k.e, k.e) * (m + root) / (2 * det)
            used = np.where(used > 0, np.sqrt(used), 0.0)  # no positive root: never lost
        return np.where((det > 0) & sound, used, np.inf)

    def softening(self, F: Array) -> Array:
        """Lost share of the law's stiffness at rest (see `response.stiffness`)."""
        left = stiffness(self.law, *self.stretches(F)) / self.stiffness
        return np.asarray(np.maximum(1 - left, 0.0))

    def extension(self, F: Array) -> Array:
        """Used share of the extensibility of a law that locks."""
        l1, l2 = self.stretches(F)
        i = invariants_of_stretches(l1, l2, 1 / (l1 * l2))
        return np.asarray(self.law.extension(i, self.law.values))


def _mounted_tension(material: stress.RegionMaterial, fresh: tuple[Branch, ...]) -> float:
    """Smaller in-plane stress of the mounted film, MPa.

    Args:
        material: Material of the film.
        fresh: Branches that carry the pre-stretch. They change the thickness stretch a little,
            since the total stress across the film must vanish.
    """
    law, internal = material.law, np.tile(identity(), (len(fresh), 1))
    assert law is not None

    def principal(across: float) -> Array:
        F = np.diag(np.insert(np.ones(2), material.normal, across))
        S = stress.second_pk(law, F, material.prestretch)
        S = S + stress.networks_pk(fresh, F, internal, material.prestretch)
        return np.diag(stress.cauchy(F, S))

    def free(across: float) -> float:
        return float(principal(across)[material.normal])

    across = 1.0
    if fresh:
        from scipy.optimize import brentq

        ends = bracket(free, 1.0, 10.0)  # found always: the change of volume gives both signs
        assert ends is not None
        across = float(brentq(free, *ends, xtol=1e-14))
    return float(principal(across)[list(material.plane)].min())


def _unit(v: Array) -> Array:
    return np.asarray(v / np.sqrt(dot(v, v))[..., None])


def smallest(tensions: Array) -> Array:
    """Smaller principal value of in-plane stresses (..., 3)."""
    a, b, c = np.moveaxis(tensions, -1, 0)
    return np.asarray(np.minimum(a, b) if not c.any() else (a + b) / 2 - np.hypot((a - b) / 2, c))


def principal_stretch(C: Array) -> Array:
    """Largest principal stretch, shape C.shape[:-2], at C = F^T F."""
    if not (C[..., 0, 2].any() or C[..., 1, 2].any()):
        half, mean = (C[..., 0, 0] - C[..., 1, 1]) / 2, (C[..., 0, 0] + C[..., 1, 1]) / 2
        plane = mean + np.hypot(half, C[..., 0, 1])
        return np.asarray(np.sqrt(np.maximum(plane, C[..., 2, 2])))
    return np.asarray(np.sqrt(np.linalg.eigvalsh(C)[..., -1]))


# --- fields --------------------------------------------------------------------------------------


def fields(
    config: Config, mesh: ResultMesh, state: Array, internal: Array | None = None
) -> dict[str, Array]:
    """Nodal margins of the films, (nodes,) each; 0 outside the films.

    `wrinkling_use` is constant over the thickness of a layer, because it uses the averaged stress.
    `tension`, the smallest in-plane true stress (MPa), is not averaged.

    Args:
        config: The config of the run.
        mesh: Mesh of the results.
        state: Nodal values, (nodes, columns).
        internal: As for `dealib.results.fields`.
    """
    out: dict[str, Array] = {}
    viscous = local.cells_with_memory(config, mesh)
    for material, regions in local.film_groups(config).values():
        cells = mesh.in_region(*regions)
        frame = None
        if mesh.normals is not None:
            plane = config.device.kinematics.dim == 2
            frame = local.Frame.of_normals(mesh.normals[cells], plane)
        film = Film.of(material, mounted_fresh(config, regions[0]), frame)
        nodes, nodal = mesh.nodes[cells], state[mesh.cells[cells]]
        kinematics, cell = config.device.kinematics, mesh.cell
        points = local.CellPoints.of(kinematics, material, cell, nodes, cell.gauss)
        mine = None
        if internal is not None and material.remembers:
            mine = internal[np.searchsorted(viscous, cells)]
        k = points.deformation(nodal, mine)
        tensions = film.tensions(k, points.pressure(nodal), mine)
        averaged = tensions
        if layered(config, regions):
            normal, position = material.normal, points.position
            along = position[..., 1 - normal]
            bounds = edges(mesh.cell, nodes, along, normal)
            columns = Columns.of(bounds, along, nodes, mesh.cell.corners)
            averaged = columns.average(tensions, k)[columns.column]
        found = {
            "tension": smallest(tensions),
            "wrinkling_use": film.wrinkling(averaged),
            "pull_in_use": np.minimum(film.pull_in(k), 2.0),  # bounded, to be drawn
        }
        if film.softens:
            found["stability_use"] = film.softening(k.F)
        if film.law.locks:
            found["locking_use"] = film.extension(k.F)
        if config.limits.breakdown is not None:
            found["breakdown_use"] = np.linalg.norm(k.e, axis=-1) / config.limits.breakdown
        if config.limits.stretch_max is not None:
            stretch = principal_stretch(k.C * np.outer(material.stretch, material.stretch))
            found["stretch_use"] = stretch / config.limits.stretch_max
        for name in found:
            out.setdefault(name, np.zeros(len(mesh.points)))
        at_nodes = {n: values @ mesh.cell.from_gauss.T for n, values in found.items()}
        mesh.average(at_nodes, cells, out)
    return out


def mounted_fresh(config: Config, region: str) -> bool:
    """Whether the branches of a region carry its pre-stretch at the start."""
    material = config.device.region(region).material
    return material is not None and config.materials[material].mounted == "fresh"


def layered(config: Config, regions: tuple[str, ...]) -> bool:
    """Whether regions are layers of a plane problem, whose stresses are averaged over thickness."""
    device = config.device
    solid = device.kinematics.dim == 2 and not device.kinematics.sheet
    return solid and device.region(regions[0]).normal is not None
