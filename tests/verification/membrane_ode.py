"""The thin limit of the device: an annular membrane with a rigid disc, by ordinary differential
equations and scipy, independent of everything in dealib.

The flat mounted membrane, radius X in [a, b], is stretched by lp in its plane. Its meridian
(r(X), z(X)) gives the stretches since mounting g1 = |(r', z')| and g2 = r/X, and since the
unstretched state l1 = lp g1, l2 = lp g2. Each layer of unstretched thickness H has the energy

    W = C10 (I1 - 3) + C01 (I2 - 3) + kappa/2 (J - 1)^2 - (eps/2) (V/H)^2 l1 l2 / l3,

I1, I2 isochoric, l3 without thickness stress; or incompressible, l3 = 1/(l1 l2). With T1, T2 the
derivatives of the energy per mounted area by g1 and g2, and t the angle of the meridian,

    (X T1 cos t)' = T2,    X T1 sin t = F / (2 pi).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import root


@dataclass(frozen=True)
class Layer:
    """One layer.

    Attributes:
        thickness: Unstretched, mm.
        c10: MPa.
        c01: MPa.
        kappa: Bulk modulus, MPa; infinite: incompressible.
        mounted: In-plane stretch when mounted.
        permittivity: N/kV^2; 0 for a conductor.
    """

    thickness: float
    c10: float
    c01: float = 0.0
    kappa: float = np.inf
    mounted: float = 1.0
    permittivity: float = 0.0

    def across(self, l1: Any, l2: Any, voltage: float) -> Any:
        """The stretch l3 (numbers real or complex)."""
        m, s = l1 * l2, l1 * l1 + l2 * l2
        t = 1 / m
        if np.isinf(self.kappa):
            return t
        for _ in range(30):  # the volumetric term dominates: converges by a factor mu/kappa
            J = m * t
            stress = self.c10 * J ** (-2 / 3) * (4 / 3 * t - 2 / 3 * s / t)
            stress += self.c01 * J ** (-4 / 3) * (2 / 3 * s * t - 4 / 3 * m * m / t)
            stress += self.kappa * (J - 1) * m + self._charge(voltage) * m / t**2
            change = stress / (self.kappa * m * m + 4 * (self.c10 + self.c01) / abs(t) ** 2)
            t = t - change
            if abs(change) < 1e-15 * abs(t):
                break
        return t

    def tension(self, g: Any, other: Any, voltage: float) -> Any:
        """Derivative of the energy per mounted area by the stretch g since mounting, N/mm."""
        l, m = self.mounted * g, self.mounted * other
        t = self.across(l, m, voltage)
        J = l * m * t
        stress = self.c10 * J ** (-2 / 3) * (4 * l * l - 2 * m * m - 2 * t * t) / (3 * l)
        stress += (
            self.c01 * J ** (-4 / 3) * (2 * l * l * (m * m + t * t) - 4 * (m * t) ** 2) / (3 * l)
        )
        if np.isinf(self.kappa):
            # the pressure that keeps the volume makes the thickness stress vanish
            across = self.c10 * (4 * t * t - 2 * l * l - 2 * m * m) / 3
            across += self.c01 * (2 * t * t * (l * l + m * m) - 4 * (l * m) ** 2) / 3
            stress = stress - (across + self._charge(voltage) * l * m / t) / l
        else:
            stress = stress + self.kappa * (J - 1) * m * t
        stress = stress - self._charge(voltage) * m / t
        return self.thickness / self.mounted * stress

    def capacitance(self, g: Any, other: Any, voltage: float) -> Any:
        """Per mounted area, nF/mm^2."""
        l, m = self.mounted * g, self.mounted * other
        across = self.thickness * self.across(l, m, voltage)
        return self.permittivity * g * other / across

    def _charge(self, voltage: float) -> float:
        return self.permittivity / 2 * (voltage / self.thickness) ** 2

    @cached_property
    def mounted_thickness(self) -> float:
        """Thickness when mounted, mm."""
        return float(self.thickness * self.across(self.mounted, self.mounted, 0.0))


@dataclass(frozen=True)
class Membrane:
    """Layers between a rigid disc of radius a and a frame of radius b, mm."""

    a: float
    b: float
    layers: tuple[Layer, ...]

    def push(self, displacement: float, voltage: float) -> tuple[float, float]:
        """Axial force (N) and capacitance (nF) with the disc displaced (mm) at a voltage (kV)."""
        unit = self._tension(1.0, 1.0, 0.0) * self.a
        steps = int(np.ceil(4 * displacement / (self.b - self.a)))
        x = np.array([1.0, displacement / steps / (self.a * np.log(self.b / self.a))])
        for target in displacement * np.arange(1, steps + 1) / steps:

            def miss(x: Any, target: float = target) -> Any:
                r, z = self._integrate(*x * unit, voltage)[:2]
                return np.array([r - self.b, z - target]) / self.a

            found = root(miss, x, tol=1e-11)
            x = found.x
        assert np.abs(found.fun).max() < 1e-8, found.message
        return float(2 * np.pi * x[1] * unit), float(self._integrate(*x * unit, voltage)[3])

    def _integrate(self, radial: float, axial: float, voltage: float) -> Any:
        """(r, z, X T1 cos t, capacitance) at the frame, from X T1 (cos t, sin t) at the disc."""

        def slope(X: float, state: Any) -> list[float]:
            r, _, p, _ = state
            tension = np.hypot(p, axial) / X
            hoop = r / X
            g = self._stretch(tension, hoop, voltage)
            capacitance = sum(layer.capacitance(g, hoop, voltage) for layer in self.layers)
            return [
                g * p / (X * tension),
                g * axial / (X * tension),
                self._tension(hoop, g, voltage),
                2 * np.pi * X * capacitance,
            ]

        start = [self.a, 0.0, radial, 0.0]
        done = solve_ivp(slope, (self.a, self.b), start, "DOP853", rtol=1e-10, atol=1e-12)
        return done.y[:, -1]

    def _tension(self, g: Any, other: Any, voltage: float) -> Any:
        return sum(layer.tension(g, other, voltage) for layer in self.layers)

    def _stretch(self, tension: float, hoop: float, voltage: float) -> float:
        """The meridional stretch at a tension, by Newton's method with complex steps."""
        g, h = 1.0, 1e-30
        for _ in range(60):
            value = self._tension(g + 1j * h, hoop, voltage)
            change = (value.real - tension) / (value.imag / h)
            g = max(g - change, 0.5 * g)
            if abs(change) < 1e-13 * g:
                break
        return g
