"""A thin-membrane model of the device: seconds of exploration for minutes of finite elements.

Film and electrodes are one composite membrane of revolution without bending stiffness. Its shape
r(R), z(R) is interpolated by quadratic elements and makes the potential stationary; each layer's
thickness stretch follows from its own thickness equilibrium, so that compressibility is kept.
Quantities in mm, N, MPa, kV, as everywhere in dealib.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
from scipy.linalg import solveh_banded

from dealib.units import EPSILON_0

Array = npt.NDArray[np.float64]
_RIGID = 1e9  # N/mm, holds what is prescribed
Coupling = Literal["energy", "pelrine_undeformed"]


@dataclass(frozen=True)
class Layer:
    """C10 (I1 - 3) + C01 (I2 - 3) + kappa/2 (J - 1)^2 with isochoric invariants; MPa and mm.

    Attributes:
        c10: First coefficient; G/2 of a neo-Hookean layer.
        c01: Second coefficient.
        bulk: Bulk modulus.
        thickness: As mounted, of all bodies of the layer together.
        prestretch: Equal-biaxial, before it was mounted.
    """

    c10: float
    c01: float
    bulk: float
    thickness: float
    prestretch: float = 1.0

    @classmethod
    def of(cls, law: str, modulus: float, thickness: float, prestretch: float = 1.0) -> Layer:
        """By Young's modulus with the rule of the thesis (Tables 1 and 2)."""
        c10, c01 = (modulus / 6, 0.0) if law == "nh" else (modulus / 4, -modulus / 12)
        return cls(c10, c01, 50 / 3 * modulus, thickness, prestretch)

    def derivatives(self, x: Array) -> tuple[Array, Array]:
        """Gradient and Hessian of the energy in the logarithmic principal stretches x, (n, 3)."""
        trace = x.sum(axis=1)
        squares = np.exp(2 * (x - trace[:, None] / 3))  # isochoric
        J = np.exp(trace)
        k1, k2 = self.c10 * squares, self.c01 / squares
        g = 2 * _deviator(k1 - k2) + (self.bulk * (J - 1) * J)[:, None]
        k = 4 * (k1 + k2)
        third = k / 3
        h = third.sum(axis=1)[:, None, None] / 3 - third[:, :, None] - third[:, None, :]
        h[:, [0, 1, 2], [0, 1, 2]] += k
        return g, h + (self.bulk * (2 * J - 1) * J)[:, None, None]

    def across(self, x: Array) -> tuple[Array, Array]:
        """The third component of the gradient and its derivative in the third stretch, (n,)."""
        trace = x.sum(axis=1)
        squares = np.exp(2 * (x - trace[:, None] / 3))
        J = np.exp(trace)
        k1, k2 = self.c10 * squares, self.c01 / squares
        d, s = k1 - k2, k1 + k2
        g = 2 * (d[:, 2] - d.sum(axis=1) / 3) + self.bulk * (J - 1) * J
        h = 4 * (s[:, 2] / 3 + s.sum(axis=1) / 9) + self.bulk * (2 * J - 1) * J
        return g, h


def _deviator(k: Array) -> Array:
    return np.asarray(k - k.sum(axis=1, keepdims=True) / 3)


@dataclass
class Membrane:
    """The device between its rigid centre (radius a) and its frame (radius b).

    Attributes:
        a, b: Radii, mm.
        film: The dielectric.
        electrodes: Both together; None where the film is alone.
        permittivity: Relative, of the film.
        coupling: `energy`: the electro-elastic potential; `pelrine_undeformed`: the pressure
            eps (V/H)^2 across the film, with its thickness H at rest.
        elements: Number of quadratic elements.
    """

    a: float
    b: float
    film: Layer
    electrodes: Layer | None
    permittivity: float
    coupling: Coupling = "energy"
    elements: int = 12
    q: Array = field(init=False)

    def __post_init__(self) -> None:
        n = 2 * self.elements + 1
        s = (1 - np.cos(np.linspace(0, np.pi, n))) / 2  # denser at both ends
        s = 0.5 * s + 0.5 * np.linspace(0, 1, n)
        s[1::2] = (s[:-2:2] + s[2::2]) / 2
        self.nodes = self.a + (self.b - self.a) * s
        g = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
        weight = np.array([5.0, 8, 5]) / 9
        N = np.stack([g * (g - 1) / 2, 1 - g**2, g * (g + 1) / 2], axis=1)
        dN = np.stack([g - 0.5, -2 * g, g + 0.5], axis=1)
        self.dofs = 2 * np.arange(self.elements)[:, None] + np.arange(3)
        half = np.diff(self.nodes[::2]) / 2
        self.N = np.broadcast_to(N, (self.elements, 3, 3)).reshape(-1, 3)
        self.dN = (dN[None] / half[:, None, None]).reshape(-1, 3)
        self.element = np.repeat(np.arange(self.elements), 3)
        self.R = np.einsum("pn,pn->p", self.N, self.nodes[self.dofs[self.element]])
        self.area = 2 * np.pi * self.R * (half[:, None] * weight).ravel()
        self.q = np.stack([self.nodes, np.zeros(n)], axis=1)  # r, z
        self.logs: list[Array] = [np.zeros(len(self.R)) for _ in self.layers]

    @property
    def layers(self) -> list[Layer]:
        """Film first."""
        return [self.film] if self.electrodes is None else [self.film, self.electrodes]

    def stretches(self) -> tuple[Array, Array, Array, Array]:
        """l1, l2 from the mounted state, and r', z', at the Gauss points."""
        nodal = self.q[self.dofs[self.element]]
        d = np.einsum("pn,pni->pi", self.dN, nodal)
        r = np.einsum("pn,pn->p", self.N, nodal[..., 0])
        return np.hypot(d[:, 0], d[:, 1]), r / self.R, d[:, 0], d[:, 1]

    def _layer(self, k: int, x: Array, y: Array, volts: float) -> tuple[Array, Array]:
        """Gradient (n, 2) and Hessian (n, 2, 2) in (ln l1, ln l2) per mounted area."""
        layer = self.layers[k]
        lp = np.log(layer.prestretch)
        pressure = 0.0
        if k == 0:
            pressure = EPSILON_0 * self.permittivity * (volts / layer.thickness) ** 2
        rest = self._mounted() if k == 0 else 0.0
        state = np.column_stack([x + lp, y + lp, self.logs[k]])
        for _ in range(30):
            g3, h3 = layer.across(state)
            if k == 0 and pressure:
                e = self._electric(x, y, state[:, 2] - rest, pressure)
                g3, h3 = g3 + e[0][:, 2], h3 + e[1][:, 2, 2]
            step = -g3 / h3
            state[:, 2] += np.clip(step, -0.2, 0.2)
            if np.abs(step).max() < 1e-10:
                break
        self.logs[k] = state[:, 2]
        g, h = layer.derivatives(state)
        if k == 0 and pressure:
            e = self._electric(x, y, state[:, 2] - rest, pressure)
            g, h = g + e[0], h + e[1]
        # energy per mounted volume: the law's is per unstretched volume
        mounted = np.exp(2 * lp + (self._mounted() if k == 0 else 0.0))
        factor = layer.thickness / mounted
        g2 = g[:, :2] * factor
        h2 = (h[:, :2, :2] - h[:, :2, 2:] * h[:, 2:, :2] / h[:, 2:, 2:]) * factor
        return g2, h2

    def _mounted(self) -> float:
        """Logarithmic thickness stretch of the film at rest."""
        if not hasattr(self, "_rest"):
            lp, z = np.log(self.film.prestretch), 0.0
            for _ in range(50):
                g, h = self.film.across(np.array([[lp, lp, z]]))
                z -= float(g[0] / h[0])
            self._rest = z
        return self._rest

    def _electric(self, x: Array, y: Array, z: Array, p: float) -> tuple[Array, Array]:
        """The electric part of gradient and Hessian, per unstretched volume."""
        volume = np.exp(2 * np.log(self.film.prestretch) + self._mounted())
        g, h = np.zeros((len(x), 3)), np.zeros((len(x), 3, 3))
        sign = np.array([1.0, 1, -1])
        half = p * volume / 2 * np.exp(x + y - z)
        if self.coupling == "energy":
            g -= half[:, None] * sign
            h -= half[:, None, None] * np.outer(sign, sign)
        else:  # no potential: the symmetric part of the tangent is only Newton's
            g[:, 2] = p * volume * np.exp(x + y + z)
            h[:, 2] = g[:, 2, None]
        return g, h

    def residual(self, volts: float) -> tuple[Array, Array]:
        """Nodal forces (nodes, 2) and the banded tangent."""
        l1, l2, dr, dz = self.stretches()
        x, y = np.log(l1), np.log(l2)
        g = np.zeros((len(l1), 2))
        h = np.zeros((len(l1), 2, 2))
        for k in range(len(self.layers)):
            gk, hk = self._layer(k, x, y, volts)
            g += gk
            h += hk
        # derivatives of ln l1 and ln l2 in the element's unknowns (r0, z0, r1, z1, r2, z2)
        n = len(l1)
        B = np.zeros((n, 2, 6))
        c, s = dr / l1, dz / l1
        B[:, 0, 0::2] = self.dN * (c / l1)[:, None]
        B[:, 0, 1::2] = self.dN * (s / l1)[:, None]
        B[:, 1, 0::2] = self.N / (l2 * self.R)[:, None]
        f = np.einsum("pa,pai->pi", g, B) * self.area[:, None]
        K = np.einsum("pai,pab,pbj->pij", B, h, B)
        second = np.zeros((n, 2, 2))  # Hessian of ln l1 in (r', z')
        second[:, 0, 0], second[:, 1, 1] = s**2 - c**2, c**2 - s**2
        second[:, 0, 1] = second[:, 1, 0] = -2 * c * s
        second *= (g[:, 0] / l1**2)[:, None, None]
        for i in range(2):
            for j in range(2):
                K[:, i::2, j::2] += np.einsum("p,pa,pb->pab", second[:, i, j], self.dN, self.dN)
        K[:, 0::2, 0::2] -= np.einsum("p,pa,pb->pab", g[:, 1] / (l2 * self.R) ** 2, self.N, self.N)
        K *= self.area[:, None, None]
        where = (2 * self.dofs[self.element][:, :, None] + np.arange(2)).reshape(n, 6)
        size = 2 * len(self.nodes)
        force = np.bincount(where.ravel(), weights=f.ravel(), minlength=size)
        band = np.zeros((6, size))
        i = np.repeat(where, 6, axis=1).ravel()
        j = np.tile(where, (1, 6)).ravel()
        upper = i <= j
        np.add.at(band, (5 - (j - i)[upper], j[upper]), K.ravel()[upper])
        return force.reshape(-1, 2), band

    def solve(
        self, volts: float, displacement: float | None = None, force: float | None = None
    ) -> float:
        """Equilibrium at a voltage with the mount's displacement (mm) or force (N) prescribed.

        Returns:
            The dual: force on the mount in N, or its displacement in mm; both positive downwards.

        Raises:
            ArithmeticError: If Newton does not converge.
        """
        held = [0, 2 * len(self.nodes) - 2, 2 * len(self.nodes) - 1]
        if displacement is not None:
            held.append(1)
        target = 0.0 if displacement is None else displacement - self.q[0, 1]
        for iteration in range(60):
            f, band = self.residual(volts)
            r = -f.ravel()
            if displacement is None:
                r[1] += force or 0.0
            band[5, held] += _RIGID
            r[held] = 0.0
            if displacement is not None:
                r[1] = _RIGID * target
            target = 0.0
            dq = _solve(band, r)
            largest = np.abs(dq).max()
            if not np.isfinite(largest):
                break
            self.q += (dq * min(1.0, 1.0 / max(largest, 1e-30))).reshape(-1, 2)
            if largest > 1.0 and displacement is not None:
                target = displacement - self.q[0, 1]
            if largest < 1e-9 and iteration:
                return float(f[0, 1]) if displacement is not None else float(self.q[0, 1])
        raise ArithmeticError("the membrane found no equilibrium")

    def capacitance(self) -> float:
        """Of the film in its present shape, pF."""
        l1, l2, _, _ = self.stretches()
        l3 = np.exp(self.logs[0] - self._mounted())
        per_area = EPSILON_0 * self.permittivity / self.film.thickness * l1 * l2 / l3
        return float(1e3 * (per_area * self.area).sum())

    def charge_density(self, volts: float) -> float:
        """True charge density eps V / h at the middle of the strip, uC/mm^2 (that is C/m^2)."""
        l3 = np.exp(self.logs[0] - self._mounted())
        h = self.film.thickness * l3[len(l3) // 2]
        return float(EPSILON_0 * self.permittivity * volts / h)

    def radial_stress(self, layer: int = 0) -> float:
        """Elastic second Piola-Kirchhoff stress S_rr of a layer at mid-strip, MPa."""
        l1, l2, _, _ = self.stretches()
        lp = np.log(self.layers[layer].prestretch)
        rest = 2 * lp + self._mounted() if layer == 0 else 0.0
        x = np.stack([np.log(l1) + lp, np.log(l2) + lp, self.logs[layer]], axis=1)
        g, _ = self.layers[layer].derivatives(x)
        return float((g[:, 0] / l1**2)[len(l1) // 2] / np.exp(rest))


def _solve(band: Array, r: Array) -> Array:
    """By Cholesky; by LU where the tangent is not positive definite."""
    try:
        return np.asarray(solveh_banded(band, r, check_finite=False))
    except np.linalg.LinAlgError:
        from scipy.linalg import solve_banded

        n = band.shape[1]
        full = np.zeros((11, n))
        full[:6] = band
        for k in range(1, 6):
            full[5 + k, : n - k] = band[5 - k, k:]
        return np.asarray(solve_banded((5, 5), full, r, check_finite=False))
