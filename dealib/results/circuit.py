"""Equivalent circuits of an impedance spectrum.

    Z = Rs + 1/(1/Rp + i omega C + 1/(Rm + i omega Lm + 1/(i omega Cm)))

C is the capacitance, Rs the series resistance, Rp the leakage. The mechanical branch Rm, Lm, Cm
(Butterworth and van Dyke) stands for one resonance at the frequency 1/(2 pi sqrt(Lm Cm)), with the
quality factor sqrt(Lm/Cm)/Rm.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from dealib.arrays import Array, Complex

_GAIN = 10.0  # by which an added part must lower the information criterion
_PEAK = 0.5  # least prominence of a resonance in the logarithm of the losses
_BESIDE = 1.4  # ratio of frequencies at which the capacitance below and above it is taken
_WIDE = 1e12  # largest ratio of a value to its start
_QUANTILE = 0.975
UNITS = {"C": "F", "Rs": "ohm", "Rp": "ohm", "Cm": "F", "Lm": "H", "Rm": "ohm"}


@dataclass(frozen=True)
class Value:
    """A part of a circuit.

    Attributes:
        name: One of `UNITS`.
        value: In that unit, SI.
        low: Lower end of its 95 % interval.
        high: Upper end; both are NaN where the spectrum does not determine it.
    """

    name: str
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Circuit:
    """A fitted circuit.

    Attributes:
        values: Its parts.
        misfit: Root mean square of the relative differences of the impedances.
    """

    values: tuple[Value, ...]
    misfit: float

    def impedance(self, hertz: Array) -> Complex:
        """Complex impedance at frequencies, ohm."""
        return impedance({v.name: v.value for v in self.values}, hertz)


def read(table: Any, hertz: Array, measured: Complex) -> Circuit:
    """The circuit in a table of `circuit.csv`, and its misfit to given impedances (ohm)."""
    rows = zip(*(table[name] for name in ("part", "value", "low", "high")), strict=True)
    values = tuple(Value(str(name), *map(float, numbers)) for name, *numbers in rows)
    missed = np.log(impedance({v.name: v.value for v in values}, hertz) / measured)
    return Circuit(values, float(np.sqrt(np.mean(np.abs(missed) ** 2))))


def impedance(parts: dict[str, float], hertz: Array) -> Complex:
    """Impedance of a circuit, ohm.

    Args:
        parts: Values by name, SI; C at least.
        hertz: Frequencies.
    """
    s = 2j * np.pi * np.asarray(hertz)
    admittance = s * parts["C"]
    if "Rp" in parts:
        admittance = admittance + 1 / parts["Rp"]
    if "Cm" in parts:
        admittance = admittance + 1 / (parts["Rm"] + s * parts["Lm"] + 1 / (s * parts["Cm"]))
    return np.asarray(parts.get("Rs", 0.0) + 1 / admittance)


def fit(hertz: Array, measured: Complex) -> Circuit:
    """Fit a circuit with as few parts as the spectrum needs.

    Parts are added one at a time: the one that lowers Akaike's criterion most, as long as it lowers
    it by ten. The residual is the difference of the logarithms of the impedances, so that all
    frequencies count alike.

    Args:
        hertz: Frequencies.
        measured: Impedances there, ohm.
    """
    best = _fitted({"C": _capacitance(hertz, measured)}, hertz, measured)
    while True:
        start = {v.name: v.value for v in best[1].values}
        more = [added(start, hertz, measured) for added in (_series, _leak, _motion)]
        tried = [
            _fitted(start | m, hertz, measured) for m in more if m and not m.keys() <= start.keys()
        ]
        found = min(tried, key=lambda one: one[0], default=best)
        if not found[0] < best[0] - _GAIN:
            return best[1]
        best = found


def _capacitance(hertz: Array, measured: Complex) -> float:
    seen = (1 / measured).imag / (2 * np.pi * hertz)
    return float(np.median(seen[seen > 0])) if (seen > 0).any() else 1e-12


def _series(start: dict[str, float], hertz: Array, measured: Complex) -> dict[str, float]:
    return {"Rs": max(float(np.abs(measured.real[-1])), 1e-6)}


def _leak(start: dict[str, float], hertz: Array, measured: Complex) -> dict[str, float]:
    conductance = float(np.abs((1 / measured).real[0]))
    return {"Rp": 1 / max(conductance, 1e-18)}


def _motion(start: dict[str, float], hertz: Array, measured: Complex) -> dict[str, float]:
    """A mechanical branch at the most prominent peak of the losses per period."""
    from scipy.signal import find_peaks

    omega, admittance = 2 * np.pi * hertz, 1 / (measured - start.get("Rs", 0.0))
    losses = np.maximum(admittance.real / omega, 1e-6 * start["C"])
    peaks, found = find_peaks(np.log(losses), prominence=_PEAK)
    if not len(peaks):
        return {}
    k = int(peaks[np.argmax(found["prominences"])])
    beside = [np.abs(hertz / hertz[k] - share).argmin() for share in (1 / _BESIDE, _BESIDE)]
    low, high = (admittance.imag / omega)[beside]
    Cm = max(float(low - high) / 2, 1e-4 * start["C"])
    Lm, Rm = 1 / (omega[k] ** 2 * Cm), 1 / admittance.real[k]
    return {"C": max(float(high), 1e-3 * start["C"]), "Cm": Cm, "Lm": Lm, "Rm": Rm}


def _fitted(start: dict[str, float], hertz: Array, measured: Complex) -> tuple[float, Circuit]:
    """Akaike's criterion of a circuit, and the circuit."""
    import lmfit
    from scipy.stats import t as student

    parameters: Any = lmfit.Parameters()
    for name in start:
        parameters.add(name, value=0.0, min=-np.log(_WIDE), max=np.log(_WIDE))

    def values(found: Any) -> dict[str, float]:
        return {name: start[name] * float(np.exp(found[name].value)) for name in start}

    def residual(found: Any) -> Array:
        miss = np.log(impedance(values(found), hertz) / measured)
        return np.concatenate([miss.real, miss.imag])

    result = lmfit.minimize(residual, parameters, xtol=1e-12, ftol=1e-12, max_nfev=4000)
    wide = float(student.ppf(_QUANTILE, max(result.nfree, 1)))
    found = []
    for name, value in values(result.params).items():
        error = result.params[name].stderr
        known = error is not None and np.isfinite(error) and wide * error < np.log(1e3)
        ends = value * np.exp([-wide * error, wide * error]) if known else (np.nan, np.nan)
        found.append(Value(name, value, float(ends[0]), float(ends[1])))
    misfit = float(np.sqrt(np.mean(np.square(result.residual)) * 2))
    return float(result.aic), Circuit(tuple(found), misfit)
