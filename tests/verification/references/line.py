"""Two resistive electrodes with the film between them: a distributed RC line.

Sheet resistances R1 and R2 (a square), Rs = R1 + R2, capacitance c a unit of area, exp(+i omega t):
the voltage obeys div grad V = q^2 V, q^2 = i omega c Rs. Units are any consistent ones: Gohm, nF,
mm and s, or SI. Impedances are those between the two terminals.

A driver of the series resistance Rd makes V(0) = Vs Z/(Z + Rd). After a step of its voltage a strip
that is fed at x = 0 charges as

    V/Vs = 1 - sum A cos(b (1 - x/L)) exp(-b^2 t/tau),  b tan b = Rs L/(W Rd),
    A = 4 sin b/(2 b + sin 2b),  tau = Rs c L^2.

Carslaw and Jaeger, Conduction of Heat in Solids, 1959, 3.11 (the same equations for heat).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq
from scipy.special import ive, kve


@dataclass(frozen=True)
class Sheets:
    """Sheet resistances of both electrodes and the capacitance a unit of area."""

    first: float
    second: float
    capacitance: float

    @property
    def resistance(self) -> float:
        """Rs = R1 + R2."""
        return self.first + self.second

    def q(self, omega: Any) -> Any:
        """sqrt(i omega c Rs)."""
        return np.sqrt(1j * omega * self.capacitance * self.resistance)


def strip(sheets: Sheets, omega: Any, length: float, width: float) -> Any:
    """Impedance of a strip fed at x = 0 on both electrodes, open at x = L."""
    q = sheets.q(omega)
    return sheets.resistance / (width * q) / np.tanh(q * length)


def opposite_ends(sheets: Sheets, omega: Any, length: float, width: float) -> Any:
    """Impedance of a strip with electrode 1 fed at x = 0 and electrode 2 at x = L."""
    R1, R2, Rs, q = sheets.first, sheets.second, sheets.resistance, sheets.q(omega)
    series = R1 * R2 * length / Rs
    ends = (R1**2 + R2**2) / (Rs * q) / np.tanh(q * length)
    across = 2 * R1 * R2 / (Rs * q) / np.sinh(q * length)
    return (series + ends + across) / width


def annulus_from_outside(sheets: Sheets, omega: Any, a: float, b: float) -> Any:
    """Impedance of an annulus fed along r = b, open at r = a; of a disc where a = 0."""
    q = sheets.q(omega)
    ratio = ive(0, q * b) / ive(1, q * b) if a == 0 else _ratio(q, b, a)
    return sheets.resistance / (2 * np.pi * b * q) * ratio


def annulus_from_inside(sheets: Sheets, omega: Any, a: float, b: float) -> Any:
    """Impedance of an annulus fed along r = a, open at r = b."""
    q = sheets.q(omega)
    return -sheets.resistance / (2 * np.pi * a * q) * _ratio(q, a, b)


def driven(impedance: Any, driver: Any) -> Any:
    """V(0)/Vs: voltage at the terminals over the driver's, behind its series resistance."""
    return impedance / (impedance + driver)


def strip_voltage(
    sheets: Sheets, omega: Any, length: float, width: float, x: Any, driver: float = 0.0
) -> Any:
    """V(x)/Vs along a strip that is fed at x = 0."""
    q = sheets.q(omega)
    first = driven(strip(sheets, omega, length, width), driver)
    # cosh(q (L - x))/cosh(q L) without overflow
    decay = np.exp(-q * x) * (1 + np.exp(-2 * q * (length - x))) / (1 + np.exp(-2 * q * length))
    return first * decay


def strip_step(
    sheets: Sheets,
    t: Any,
    length: float,
    width: float,
    x: float | None = None,
    driver: float = 0.0,
    terms: int = 200,
) -> Any:
    """V(x)/Vs after a step of the driver's voltage; the mean over the strip where x is None.

    The mean is the charge over its final value.
    """
    tau = sheets.resistance * sheets.capacitance * length**2
    b = _rates(sheets.resistance * length / width, driver, terms)
    A = 4 * np.sin(b) / (2 * b + np.sin(2 * b))
    shape = np.sin(b) / b if x is None else np.cos(b * (1 - x / length))
    return 1 - np.exp(-np.multiply.outer(np.asarray(t), b**2) / tau) @ (A * shape)


def _rates(line: float, driver: float, terms: int) -> np.ndarray:
    """The roots of b tan b = line/driver."""
    if driver == 0:
        return (np.arange(terms) + 0.5) * np.pi
    return np.array(
        [
            brentq(
                lambda b: driver * b * np.sin(b) - line * np.cos(b),
                n * np.pi,
                (n + 0.5) * np.pi,
                xtol=1e-14,
            )
            for n in range(terms)
        ]
    )


def _ratio(q: Any, r: float, other: float) -> Any:
    """[I0(qr) K1(qo) + K0(qr) I1(qo)] / [I1(qr) K1(qo) - K1(qr) I1(qo)], o the open end.

    Scaled functions: I = ive exp(Re x), K = kve exp(-x); a common factor cancels.
    """
    x, y = q * r, q * other
    shift = np.exp(-x + y - x.real + y.real) if r > other else 1.0
    lead = 1.0 if r > other else np.exp(-y + x - y.real + x.real)
    top = lead * ive(0, x) * kve(1, y) + shift * kve(0, x) * ive(1, y)
    bottom = lead * ive(1, x) * kve(1, y) - shift * kve(1, x) * ive(1, y)
    return top / bottom
