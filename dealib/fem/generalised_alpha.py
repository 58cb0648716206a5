"""Integration in time by the generalised alpha method.

J. Chung and G. M. Hulbert, J. Appl. Mech. 60 (1993) 371, in the form of M. Arnold and O. Bruels,
Multibody Syst. Dyn. 18 (2007) 185. All equations hold at the end of a step, those of motion with
the true acceleration r there. (Averaged over the step, they would let potentials, pressures and
ports oscillate from step to step.) Displacement u, velocity v and auxiliary acceleration a follow

    (1 - am) a' + am a = (1 - af) r' + af r,
    u' = u + h v + h^2 ((1/2 - beta) a + beta a'),  v' = v + h ((1 - gamma) a + gamma a').

So r' = k (u' - u*), with k and u* fixed at the start of the step.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dealib.arrays import Array


@dataclass(frozen=True)
class Rates:
    """A state in motion: arrays of this rank's degrees of freedom and the values of all ports.

    Attributes:
        u: Displacement, mm.
        v: Velocity, mm/s.
        a: Auxiliary acceleration, mm/s^2.
        r: True acceleration, mm/s^2.
    """

    u: Array
    v: Array
    a: Array
    r: Array

    @classmethod
    def rest(cls, u: Array) -> Rates:
        """At rest, in equilibrium."""
        return cls(u, *np.zeros((3, *u.shape)))


class GeneralisedAlpha:
    """The equations of one step.

    Attributes:
        step: Duration of the step, s; 0 at rest.
        stiffness: k, derivative of the acceleration by the displacement, 1/s^2.
        speed: Derivative of the velocity by the displacement, 1/s.
        r0: Acceleration without displacement, r' - k u', mm/s^2.
        v0: Velocity without displacement, mm/s.

    Args:
        rho: Spectral radius at infinite frequency, from 0 to 1.
    """

    stiffness: float
    speed: float
    r0: Array
    v0: Array

    def __init__(self, rho: float) -> None:
        am, af = (2 * rho - 1) / (rho + 1), rho / (rho + 1)
        self._am, self._af = am, af
        self._beta, self._gamma = (1 - am + af) ** 2 / 4, 0.5 - am + af
        self.step = 0.0

    def begin(self, n: Rates, duration: float) -> Rates:
        """Prepare a step of a duration in s from a state.

        Returns:
            The state, with the auxiliary acceleration that belongs to this step.
        """
        am, af, h = self._am, self._af, duration
        if self.step and self.step != h:  # the time to which a belongs depends on the step
            n = replace(n, a=n.r + (n.a - n.r) * h / self.step)
        self.step = h
        self.stiffness = (1 - am) / ((1 - af) * self._beta * h**2)
        free = n.u + h * n.v + h**2 * (0.5 - self._beta) * n.a
        self.r0 = (am * n.a - af * n.r) / (1 - af) - self.stiffness * free
        self.speed = self._gamma / (self._beta * h)
        self.v0 = n.v + h * (1 - self._gamma) * n.a - self.speed * free
        return n

    def velocity(self, u: Array) -> Array:
        """Velocity at a displacement at the end of the step."""
        return self.speed * u + self.v0

    def end(self, n: Rates, u: Array) -> Rates:
        """State at the end of the step from n, at a displacement."""
        h = self.step
        a = (u - n.u - h * n.v - h**2 * (0.5 - self._beta) * n.a) / (self._beta * h**2)
        return Rates(u, self.velocity(u), a, self.stiffness * u + self.r0)

    def error(self, n: Rates, end: Rates) -> Array:
        """Error of the displacement in a step: (beta - 1/6) h^2 (r' - r).

        O. C. Zienkiewicz, Y. M. Xie, Earthq. Eng. Struct. Dyn. 20 (1991) 871.
        """
        return (self._beta - 1 / 6) * self.step**2 * (end.r - n.r)
