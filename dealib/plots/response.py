"""Bode and Nyquist pictures of a spectrum."""

from __future__ import annotations

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import MaxNLocator

from dealib.plots.labels import label, plain
from dealib.plots.style import DASHES, Theme
from dealib.results.circuit import Circuit


def draw_bode(table: Any, title: str, look: Theme) -> Any:
    """Draw magnitudes and phases over the frequency: of the motion, the impedance and the sound.

    Args:
        table: Table of `response.csv`.
        title: Title of the picture.
        look: Colours.
    """
    f, columns = table["frequency_Hz"], list(map(str, table))
    stems = [
        ("_mm_per_kV", "_N_per_kV", "_Nmm_per_kV", "_deg_per_kV", "_mm3_per_kV", "charge_uC"),
        ("impedance_Mohm",),
        ("sound_pressure",),
    ]
    panels = [
        next((k for k in ([j for j, n in enumerate(columns) if s in n] for s in of) if k), [])
        for of in stems
    ]
    panels = [chosen for chosen in panels if chosen]
    figure, axes = plt.subplots(
        2,
        len(panels),
        figsize=(5.5 * len(panels), 6.6),
        sharex=True,
        squeeze=False,
        layout="constrained",
    )
    for (upper, lower), chosen in zip(axes.T, panels, strict=True):
        for n, k in enumerate(chosen):  # its phase is the next column
            style = {"color": f"C{n % len(look.lines)}", "ls": DASHES[n // len(look.lines) % 4]}
            upper.loglog(f, table[columns[k]], label=label(columns[k]), **style)
            lower.semilogx(*_broken(f, table[columns[k + 1]]), **style)
        upper.set_ylabel(label(columns[chosen[0]]) if len(chosen) == 1 else "")
        if len(chosen) > 1:
            upper.legend(fontsize="small")
        lower.set(xlabel="Frequency (Hz)", ylabel="Phase (deg)")
        if np.ptp(lower.get_ylim()) > 20:  # parts of a right angle
            lower.yaxis.set_major_locator(MaxNLocator(5, steps=[1, 1.5, 3, 4.5, 9, 10]))
    figure.suptitle(plain(title), fontsize="medium")
    return figure


def _broken(f: Any, phase: Any) -> tuple[Any, Any]:
    """A phase in degrees over the frequency, with a gap where it jumps across 180 degrees.

    To add turns instead would show turns that are wrong where the points are far apart.
    """
    jumps = 1 + np.flatnonzero(np.abs(np.diff(phase)) > 180)
    return np.insert(np.asarray(f, float), jumps, np.nan), np.insert(phase, jumps, np.nan)


def draw_nyquist(table: Any, circuit: Circuit, title: str) -> Any:
    """Draw capacitance and motion as curves in the complex plane, circles at a resonance.

    The capacitance is Y/(i omega) = C' - i C''; that of the equivalent circuit is drawn over it.

    Args:
        table: Table of `response.csv`.
        circuit: The fitted circuit.
        title: Title of the picture.
    """
    f, columns = table["frequency_Hz"].to_numpy(), list(map(str, table))
    capacitances = (
        1e6 / (2j * np.pi * f * Z) for Z in (impedance(table), circuit.impedance(f) / 1e6)
    )
    moved = [k for k, name in enumerate(columns) if "_mm_per_kV" in name]
    figure, axes = plt.subplots(1, 1 + bool(moved), figsize=(11, 4.8), layout="constrained")
    axis, *others = np.ravel(axes)
    for C, style, told in zip(capacitances, (".-", "--"), ("computed", "circuit"), strict=True):
        axis.plot(C.real, -C.imag, style, ms=4, label=told)
    axis.set(xlabel="Capacitance C' (pF)", ylabel="Loss C'' (pF)")
    axis.legend()
    for other in others:
        for n, k in enumerate(moved):
            size, phase = (table[columns[j]].to_numpy() for j in (k, k + 1))
            value = size * np.exp(1j * np.radians(phase))
            other.plot(value.real, value.imag, ".-", ms=4, color=f"C{n}", label=label(columns[k]))
        other.set(xlabel="in phase (mm/kV)", ylabel="in quadrature (mm/kV)")
        other.set_aspect("equal", adjustable="datalim")
        if len(moved) > 1:
            other.legend(fontsize="small")
        else:
            other.set_title(label(columns[moved[0]]), loc="left", fontsize="medium")
    figure.suptitle(plain(title), fontsize="medium")
    return figure


def impedance(table: Any) -> Any:
    """Complex impedance in a table of `response.csv`, Mohm."""
    (name,) = (n for n in map(str, table) if n.startswith("impedance_Mohm"))
    phase = name.replace("impedance_Mohm", "impedance_phase_deg")
    return table[name].to_numpy() * np.exp(1j * np.radians(table[phase].to_numpy()))
