"""Bode and Nyquist pictures of a spectrum."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from dealib.plots.labels import label, plain
from dealib.plots.style import DASHES, Theme
from dealib.results.circuit import Circuit


def draw_bode(table: Any, title: str, look: Theme) -> Any:
    """Magnitudes and phases over the frequency: of what moves, and of the impedance.

    Args:
        table: Of `response.csv`.
        title: Of the picture.
        look: Colours.
    """
    f, columns = table["frequency_Hz"], list(map(str, table))
    moved = [k for k, name in enumerate(columns) if "_per_kV" in name and name[:7] != "current"]
    moved = [k for k in moved if not columns[k].startswith("charge")]
    moved = moved or [k for k, name in enumerate(columns) if name.startswith("charge_uC")]
    electric = [k for k, name in enumerate(columns) if name.startswith("impedance_Mohm")]
    figure, axes = plt.subplots(2, 2, figsize=(11, 6.6), sharex=True, layout="constrained")
    for (upper, lower), chosen in zip(axes.T, (moved, electric), strict=True):
        for n, k in enumerate(chosen):  # its phase is the next column
            style = {"color": f"C{n % len(look.lines)}", "ls": DASHES[n // len(look.lines) % 4]}
            upper.loglog(f, table[columns[k]], label=label(columns[k]), **style)
            lower.semilogx(f, table[columns[k + 1]], **style)
        upper.set_ylabel(label(columns[chosen[0]]) if len(chosen) == 1 else "")
        if len(chosen) > 1:
            upper.legend(fontsize="small")
        lower.set(xlabel="Frequency (Hz)", ylabel="Phase (deg)")
    figure.suptitle(plain(title), fontsize="medium")
    return figure


def draw_nyquist(table: Any, circuit: Circuit, title: str, look: Theme) -> Any:
    """What moves, and the impedance with that of its circuit, each in its complex plane.

    Args:
        table: Of `response.csv`.
        circuit: That was fitted.
        title: Of the picture.
        look: Colours.
    """
    f, columns = table["frequency_Hz"].to_numpy(), list(map(str, table))
    Z, fitted = impedance(table), circuit.impedance(f) / 1e6
    moved = [k for k, name in enumerate(columns) if "_mm_per_kV" in name]
    figure, axes = plt.subplots(1, 1 + bool(moved), figsize=(11, 4.8), layout="constrained")
    axis, *others = np.ravel(axes)
    axis.plot(Z.real, -Z.imag, ".-", ms=4, label="impedance")
    axis.plot(fitted.real, -fitted.imag, "--", label="circuit")
    wide = 1.1 * max(Z.real.max(), 0.02 * np.abs(Z.imag).min())
    axis.set(xlabel="Resistance (Mohm)", ylabel="−Reactance (Mohm)", xlim=(0, wide))
    axis.set_ylim(max(-wide, 1.1 * min(-Z.imag.max(), 0)), 2 * wide)
    axis.legend()
    for other in others:
        for n, k in enumerate(moved):
            size, phase = (table[columns[j]].to_numpy() for j in (k, k + 1))
            value = size * np.exp(1j * np.radians(phase))
            other.plot(value.real, value.imag, ".-", ms=4, color=f"C{n}", label=label(columns[k]))
        other.set(xlabel="in phase (mm/kV)", ylabel="in quadrature (mm/kV)", aspect="equal")
        other.legend(fontsize="small")
    figure.suptitle(plain(title), fontsize="medium")
    return figure


def impedance(table: Any) -> Any:
    """Complex impedance, Mohm, of a table of `response.csv`."""
    (name,) = (n for n in map(str, table) if n.startswith("impedance_Mohm"))
    phase = name.replace("impedance_Mohm", "impedance_phase_deg")
    return table[name].to_numpy() * np.exp(1j * np.radians(table[phase].to_numpy()))
