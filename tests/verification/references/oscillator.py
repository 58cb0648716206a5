"""One degree of freedom: m u'' + c u' + k u + k1 (u - ui) = F, Maxwell branch u - ui = tau ui'.

Closed forms, and what the generalised-alpha method makes of it. Chung and Hulbert, J. Appl. Mech.
60 (1993) 371: with r the spectral radius at high frequency

    am = (2 r - 1)/(r + 1), af = r/(r + 1), gamma = 1/2 - am + af, beta = (1 - am + af)^2/4,
    (1 - am) m a' + am m a + (1 - af)(c v' + k u') + af (c v + k u) = (1 - af) F' + af F,
    u' = u + h v + h^2 ((1/2 - beta) a + beta a'),    v' = v + h ((1 - gamma) a + gamma a').
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True)
class Oscillator:
    """Mass (t), stiffness (N/mm), damper c (N s/mm), branch's stiffness (N/mm) and time tau (s)."""

    mass: float = 1.0
    stiffness: float = 1.0
    damper: float = 0.0
    branch: float = 0.0
    tau: float = 1.0


def harmonic(o: Oscillator, omega: Any) -> Any:
    """u/F for F exp(i omega t), mm/N."""
    z = 1j * omega * o.tau
    stiffness = o.stiffness + 1j * omega * o.damper + o.branch * z / (1 + z)
    return 1 / (stiffness - o.mass * omega**2)


def voltage_driven(o: Oscillator, gain: float, mean: float, amplitude: float, omega: float) -> Any:
    """Harmonics 0, 1 and 2 of u (mm) where F = gain V^2 and V = mean + amplitude cos(omega t)."""
    parts = np.array([mean**2 + amplitude**2 / 2, 2 * mean * amplitude, amplitude**2 / 2]) * gain
    return np.array([p * harmonic(o, n * omega) for n, p in enumerate(parts)])


def creep(o: Oscillator, t: Any) -> Any:
    """u/F after a step of F without mass and damper, mm/N."""
    total = o.stiffness + o.branch
    share = o.branch / total * np.exp(-np.asarray(t) * o.stiffness / (o.tau * total))
    return (1 - share) / o.stiffness


def step(o: Oscillator, t: Any) -> Any:
    """u/F after a step of F from rest, mm/N: the sum of the residues of its transfer function.

    Its poles must differ: no critical damping.
    """
    t = np.asarray(t, dtype=float)
    m, c, k = o.mass, o.damper, o.stiffness
    poles: Any
    numerator: Any = 1.0
    if o.branch:
        poles = np.roots([m * o.tau, m + c * o.tau, c + (k + o.branch) * o.tau, k])
        numerator = 1 + o.tau * poles
        slope = 3 * m * o.tau * poles**2 + 2 * (m + c * o.tau) * poles + c + (k + o.branch) * o.tau
    else:
        poles = np.roots([m, c, k])
        slope = 2 * m * poles + c
    terms = numerator / (slope * poles) * np.exp(np.multiply.outer(t, poles))
    return 1 / k + np.real(terms.sum(-1))


def free(o: Oscillator, t: Any, start: float = 1.0, speed: float = 0.0) -> Any:
    """u (mm) of the free, underdamped motion without a branch."""
    rate = o.damper / (2 * o.mass)
    omega = np.sqrt(o.stiffness / o.mass - rate**2)
    swing = np.cos(omega * t) * start + np.sin(omega * t) * (speed + rate * start) / omega
    return np.exp(-rate * t) * swing


def amplification(o: Oscillator, h: float, r: float = 0.8) -> tuple[np.ndarray, np.ndarray]:
    """A and b of x' = A x + b F, x = (u, v, a), for a time step h at a force that is constant."""
    m, c, k = o.mass, o.damper, o.stiffness
    am, af = (2 * r - 1) / (r + 1), r / (r + 1)
    gamma, beta = 0.5 - am + af, (1 - am + af) ** 2 / 4
    new = np.array(
        [[(1 - af) * k, (1 - af) * c, (1 - am) * m], [1, 0, -beta * h * h], [0, 1, -gamma * h]]
    )
    old = np.array(
        [[-af * k, -af * c, -am * m], [1, h, (0.5 - beta) * h * h], [0, 1, (1 - gamma) * h]]
    )
    return np.linalg.solve(new, old), np.linalg.solve(new, [1.0, 0.0, 0.0])


def generalised_alpha(
    o: Oscillator, h: float, steps: int, r: float = 0.8, *, start: float = 0.0, force: float = 0.0
) -> np.ndarray:
    """(u, v, a) after 0 .. `steps` steps from rest at `start` (mm) under a constant force (N)."""
    A, b = amplification(o, h, r)
    x = np.array([start, 0.0, (force - o.stiffness * start) / o.mass])
    rows = [x]
    for _ in range(steps):
        x = A @ x + b * force
        rows.append(x)
    return np.array(rows)


def numerical_motion(o: Oscillator, h: float, r: float = 0.8) -> tuple[float, float]:
    """(omega, decay) in 1/s that the method makes of free vibration: exp(-decay t) cos(omega t)."""
    values = np.linalg.eigvals(amplification(o, h, r)[0])
    principal = values[np.argmax(values.imag)]
    return float(np.angle(principal) / h), float(-np.log(abs(principal)) / h)
