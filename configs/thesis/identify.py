"""Identify what the thesis does not publish, from all its windows at once.

    python configs/thesis/identify.py            # about 15 minutes; writes identification.*

Least squares over the windows of `windows.py`: no misfit inside a window, outside the distance over
the window's width, ten times for bounds that are printed. A weak pull to the windows' middles
(5 %) makes the answer unique. The membrane model compares the couplings and leaves figures out;
dealib's finite elements refine the result, with derivatives from the membrane.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from devices import (
    MASSES,
    VOLTS,
    Device,
    Parameters,
    Target,
    by_finite_elements,
    by_membrane,
    cached,
)
from fitting import Fit, fit
from windows import WINDOWS, Window

from dealib.units import EPSILON_0, GRAVITY

HERE = Path(__file__).parent
COUPLINGS = {
    "energy": "energy: the electro-elastic potential (Pelrine's pressure with the current "
    "thickness is the same in a thin incompressible film)",
    "undeformed_pressure": "Pelrine's pressure with the thickness at rest, (V/H)^2, a dead load",
    "maxwell_traction": "the Maxwell traction on the electrode faces alone, half the pressure",
}
WITHOUT = {
    "all windows": (),
    "without Fig. 31": ("31",),
    "without Fig. 34 (DEAP75's force)": ("34",),
    "without Fig. 36": ("36",),
}


FALLING = """\
A flat film resists the mount only by its pre-stress (electrodes carry none): F = k u with k in
proportion to sigma - eps (V/H)^2. If the voltage takes nearly all of the pre-stress, a small mass
finds no resistance and sinks deep until stretching stops it, while a large mass already lives on
the stretching: the stroke falls with the mass. If most of the pre-stress is left, the stroke starts
at zero, in proportion to the mass, and rises. The ratio of Maxwell stress to pre-stress at rest
decides; other parameters of this table are the identified ones (membrane model)."""


def table(head: list[str], rows: list[list[str]]) -> str:
    """A Markdown table."""
    lines = ["| " + " | ".join(r) + " |" for r in [head, ["---"] * len(head), *rows]]
    return "\n".join(lines)


def report(fits: dict[str, Fit], final: Fit) -> str:
    """The report in Markdown."""
    names = Parameters.names()
    spread = dict(zip(names, final.uncertainties, strict=True))
    label = {"film_thickness": "mm", "preload_23": "N", "preload_36": "N"}
    unit = {
        n: label.get(n, "mm" if n.startswith(("inner", "outer", "disp")) else "") for n in names
    }
    bad = [w for w in final.windows if w not in final.held()]
    out = [
        "# Identified parameters",
        "Written by `python configs/thesis/identify.py`; every number below is computed. "
        "The thesis publishes none of these parameters. They are identified from all windows that "
        "its text and axes give (`windows.py`), by least squares with soft intervals, in which a "
        "bound that is printed counts ten times one that is inferred; uncertainty "
        "takes half a window's width as one standard deviation of each quantity.",
        "## Values (finite elements, energy coupling)",
        table(
            ["parameter", "value", "uncertainty", "unit"],
            [
                [n, f"{getattr(final.parameters, n):.4g}", f"{spread[n]:.2g}", unit[n]]
                for n in names
            ],
        ),
        f"Misfit (sum of squares) {final.misfit():.3g}; {len(final.held())} of "
        f"{len(final.windows)} windows hold.",
        "## Windows",
        window_table(final),
        "## Windows that do not hold together",
        "Each violated window, by how much of its width, and the violated window whose pull on the "
        "parameters is most opposed to it (cosine -1: they ask for exactly opposite changes).",
        table(
            ["window", "off by (widths)", "against", "cosine"],
            [
                [named(a), f"{a.misfit(final.values[a.quantity]):+.2f}", named(b), f"{c:.2f}"]
                for a, b, c in final.opposed()
            ],
        )
        if len(bad) > 1
        else "None.",
        "## What changes if figures are left out, and by the coupling (membrane model)",
        table(
            ["fit", "misfit", "held", "film (um)", "pre-stretch", "eps_r", "strokes NH (mm)"],
            [variant(name, f) for name, f in fits.items()],
        ),
        f"Strokes at {', '.join(f'{m:g}' for m in MASSES)} g.",
        "Couplings:\n\n" + "\n".join(f"- {text}" for text in COUPLINGS.values()),
        "## Fig. 31: why the stroke falls with the mass",
        FALLING,
        table(
            ["coupling", "pre-stretch", "Maxwell stress / pre-stress", "strokes NH (mm)", "stroke"],
            trend(final.parameters),
        ),
    ]
    return "\n\n".join(out) + "\n"


def trend(p: Parameters) -> list[list[str]]:
    """Fig. 31 around the identified parameters: what makes the stroke fall with the mass."""
    cases = [("energy", replace(p, prestretch=s)) for s in (1.05, 1.08, 1.10, 1.15, 1.20, 1.25)]
    cases += [(coupling, p) for coupling in COUPLINGS]
    rows = []
    for coupling, q in cases:
        pull = (q.prestretch**2 - q.prestretch**-4) / 3  # MPa, neo-Hookean 1 MPa
        maxwell = EPSILON_0 * q.permittivity * (VOLTS / q.film_thickness) ** 2
        targets = [Target(F=1e-3 * m * GRAVITY, V=v) for m in MASSES for v in (0, VOLTS, 0)]
        try:
            states = by_membrane(coupling)(Device.of(q), targets)  # type: ignore[arg-type]
        except ArithmeticError:
            strokes = "the flat film buckles"
            word = "-"
        else:
            found = np.array([states[k + 1].u - states[k].u for k in range(0, len(states), 3)])
            strokes = ", ".join(f"{s:.3f}" for s in found)
            fall = np.diff(found) < 0
            word = "falls" if fall.all() else "rises" if not fall.any() else "rises, then falls"
        rows.append([coupling, f"{q.prestretch:.3f}", f"{maxwell / pull:.2f}", strokes, word])
    return rows


def named(w: Window) -> str:
    """A window in a word."""
    return f"Fig. {w.figure} {w.quantity}" if w.figure[0].isdigit() else w.quantity


def window_table(f: Fit) -> str:
    """Every window with its computed value."""
    rows = []
    for w in WINDOWS:
        value = f.values[w.quantity]
        off = w.misfit(value)
        holds = ("holds" if off == 0 else f"**{off:+.2f}**") + ("" if w.fitted else " (not fitted)")
        span = f"{w.low:.4g} .. {w.high:.4g}"
        rows.append([w.figure, w.quantity, span, f"{value:.4g}", w.unit, w.kind, holds, w.note])
    return table(
        ["figure", "quantity", "window", "computed", "unit", "from", "misfit (widths)", "meaning"],
        rows,
    )


def variant(name: str, f: Fit) -> list[str]:
    """A row about one fit."""
    p = f.parameters
    strokes = ", ".join(f"{f.values[f'nh_stroke_{m:g}']:.3f}" for m in MASSES)
    held = f"{len(f.held())} of {len(f.windows)}"
    return [name, f"{f.misfit():.3g}", held, f"{1e3 * p.film_thickness:.1f}",
            f"{p.prestretch:.3f}", f"{p.permittivity:.2f}", strokes]  # fmt: skip


def write(final: Fit, fits: dict[str, Fit]) -> None:
    """Write the report and the tables."""
    (HERE / "identification.md").write_text(report(fits, final), encoding="utf-8")
    with (HERE / "identification.csv").open("w", newline="", encoding="utf-8") as file:
        out = csv.writer(file)
        out.writerow(["kind", "name", "low", "high", "value", "unit", "misfit_widths"])
        for n, s in zip(Parameters.names(), final.uncertainties, strict=True):
            v = getattr(final.parameters, n)
            out.writerow(["parameter", n, f"{v - s:.6g}", f"{v + s:.6g}", f"{v:.6g}", "", ""])
        for w in WINDOWS:
            v = final.values[w.quantity]
            out.writerow(["window", f"fig {w.figure} {w.quantity}", w.low, w.high, f"{v:.6g}",
                          w.unit, f"{w.misfit(v):.4f}"])  # fmt: skip


def main() -> None:
    """Fit, refine, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--start", type=json.loads, default={}, help="parameters to start from")
    parser.add_argument("--evaluations", type=int, default=50, help="limit of each fit")
    arguments = parser.parse_args()
    begin, start = time.perf_counter(), Parameters(**arguments.start)
    fits: dict[str, Fit] = {}

    def tell(name: str, f: Fit) -> None:
        spent = time.perf_counter() - begin
        print(f"{spent:5.0f} s  {name}: misfit {f.misfit():.4g}  {f.parameters}", flush=True)

    for coupling, text in COUPLINGS.items():
        solve = by_membrane(coupling)  # type: ignore[arg-type]
        for name, without in WITHOUT.items() if coupling == "energy" else [("", ())]:
            first = fits.get("energy, all windows")
            key = f"energy, {name}" if name else text
            begin_at = first.parameters if first else start
            fits[key] = fit(solve, begin_at, without=without, evaluations=arguments.evaluations)
            tell(key, fits[key])
    best = fits["energy, all windows"].parameters
    final = fit(
        cached(by_finite_elements), best, slopes=by_membrane(), evaluations=arguments.evaluations
    )
    tell("finite elements", final)
    write(final, fits)


if __name__ == "__main__":
    main()
