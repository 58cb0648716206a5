"""How near a film is to its limits, as utilisations: 0 is far away, 1 is the limit, above is beyond.

In the plane of the film, direction 1 is that of its meridian, F e_R, and 2 is the hoop.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dealib.config.schema import Config
from dealib.materials.laws import Law
from dealib.materials.response import MODES, curvature, stability_limit, stiffness
from dealib.results import local
from dealib.results.elements import Array

# column -> what is used up
MARGINS = {
    "breakdown_use": "Breakdown: largest true field over the strength left by the electrodes",
    "wrinkling_use": "Wrinkling: share of the mounted tension that is lost (thickness average)",
    "pull_in_use": "Pull-in: field over the one at which the film itself loses stability",
    "stability_use": "Material stability: share of the law's stiffness at rest that is lost",
    "stretch_use": "Stretch: largest stretch over the one allowed",
}


@dataclass(frozen=True)
class Film:
    """What the margins need to know of a film.

    Attributes:
        material: Law, permittivity and pre-stretch.
        tension: That `wrinkling_use` counts from, MPa.
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
        stress = np.diag(local.second_pk(law, np.eye(3), material.prestretch))  # mounted: F = I
        rest = float(stiffness(law, 1.0, 1.0))
        softens = any(np.isfinite(stability_limit(law, mode)) for mode in MODES)
        mounted = float(min(stress[0], stress[2]))
        return cls(material, mounted if mounted > 1e-9 * rest else rest / 2, rest, softens)

    @property
    def law(self) -> Law:
        """Its law."""
        assert self.material.law is not None
        return self.material.law

    def stretches(self, F: Array) -> tuple[Array, Array]:
        """Stretches in the plane since the unstretched state, at deformations from the mesh."""
        p = self.material.prestretch
        assert p is not None
        return np.hypot(F[..., 0, 0], F[..., 1, 0]) * p[0], F[..., 2, 2] * p[2]

    def tensions(self, k: local.Kinematics, pressure: Array | None = None) -> Array:
        """In-plane true stresses, elastic plus Maxwell, (..., 2), MPa.

        Args:
            k: Deformation and field.
            pressure: The mixed form's p, (...).
        """
        m = self.material
        S = local.second_pk(self.law, k.F, m.prestretch, pressure)
        total = local.cauchy(k.F, S) + local.maxwell(m.permittivity, k.e)
        t = k.F[..., :, 0] / np.linalg.norm(k.F[..., :, 0], axis=-1)[..., None]
        first = np.einsum("...i,...ij,...j", t, total, t)
        return np.stack([first, total[..., 2, 2]], axis=-1)

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

            A - eps e.e [[1, 2], [2, 1]] positive definite,  A_ij = l_i l_j d2W / dl_i dl_j.

        Infinite where A itself is not: under dead loads that film fails without a field. A film
        whose edges are held is more stable than that, so that the margin is on the safe side.
        """
        gradient, hessian = curvature(self.law, *self.stretches(k.F))
        a, c = hessian[0] - gradient[0], hessian[1] - gradient[1]
        b = hessian[2]
        d, m = a * c - b * b, a + c - 4 * b
        with np.errstate(all="ignore"):
            critical = 2 * d / (m + np.sqrt(m * m + 12 * d))  # of 3 q^2 + m q - d = 0
            stable = (d > 0) & (a + c > 0)
            load = self.material.permittivity * np.einsum("...i,...i", k.e, k.e)
            return np.where(stable, np.sqrt(load / np.where(stable, critical, 1.0)), np.inf)

    def softening(self, F: Array) -> Array:
        """Share of the law's stiffness at rest that is lost (see `response.stiffness`)."""
        left = stiffness(self.law, *self.stretches(F)) / self.stiffness
        return np.asarray(np.maximum(1 - left, 0.0))


def meridional_stretch(F: Array) -> Array:
    """Larger principal stretch in the R-Z plane, shape F.shape[:-2]."""
    a, b = F[..., 0, 0] ** 2 + F[..., 1, 0] ** 2, F[..., 0, 1] ** 2 + F[..., 1, 1] ** 2
    c = F[..., 0, 0] * F[..., 0, 1] + F[..., 1, 0] * F[..., 1, 1]
    return np.asarray(np.sqrt((a + b) / 2 + np.hypot((a - b) / 2, c)))


def principal_stretch(F: Array) -> Array:
    """Largest principal stretch, shape F.shape[:-2]."""
    return np.maximum(meridional_stretch(F), F[..., 2, 2])
