"""Identify what the thesis does not publish, from all its windows at once.

    python configs/thesis/identify.py            # about 15 minutes; writes identification.*

Least squares over the windows of `windows.py`: no misfit inside a window, outside the distance over
the window's width, ten times for bounds that are printed and a thousand times for the physics that
the thesis states. A weak pull to the windows' middles (2 %) makes the answer unique. The membrane
model compares couplings, leaves figures out and draws the maps; dealib's finite elements refine
the result, with derivatives from the membrane.
"""

from __future__ import annotations

import argparse
import csv
import json
import time
from dataclasses import replace
from pathlib import Path

import maps
from devices import Parameters, finite_elements, membranes
from fitting import FITTED, Fit, fit
from reporting import report
from windows import WINDOWS

HERE = Path(__file__).parent
START = {
    "film_thickness": 0.032, "prestretch": 1.14, "permittivity": 3.8, "inner_75": 3.0,
    "outer_75": 7.8, "inner_100": 5.6, "outer_100": 10.2, "inner_200": 12.6, "outer_200": 21.4,
    "preload_12": 0.145, "preload_23": 0.4, "preload_36": 0.07, "displacement_35": 1.15,
}  # fmt: skip
WITHOUT = {
    "without Fig. 31": ("31",),
    "without Fig. 34 (DEAP75's force)": ("34",),
    "without Fig. 36": ("36",),
    "without Fig. 26 (electrodes less stressed than the film)": ("26",),
    "without Fig. 38 (capacitances)": ("38",),
}


def write(final: Fit, fits: dict[str, Fit], tables: maps.Maps) -> None:
    """Write the report and the tables."""
    (HERE / "identification.md").write_text(report(final, fits, tables), encoding="utf-8")
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
    """Fit, refine, map, report."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--start", type=json.loads, default={}, help="parameters to start from")
    parser.add_argument("--evaluations", type=int, default=40, help="limit of each fit")
    parser.add_argument("-j", "--jobs", type=int, default=2, help="processes for the map")
    arguments = parser.parse_args()
    begin, start = time.perf_counter(), Parameters(**{**START, **arguments.start})
    fits: dict[str, Fit] = {}

    def tell(name: str, f: Fit) -> None:
        spent = time.perf_counter() - begin
        print(f"{spent:5.0f} s  {name}: misfit {f.misfit():.4g}  {f.parameters}", flush=True)

    limit = arguments.evaluations
    thinner = {k: 0.85 * getattr(start, k) for k in ("film_thickness", "permittivity")}
    starts = [start, replace(start, **thinner), replace(start, prestretch=1.12)]
    tried = [fit(membranes(), s, evaluations=limit) for s in starts]
    first = fits["all windows"] = min(tried, key=Fit.misfit)
    for f in tried:
        tell("all windows", f)
    cases = {n: [w for w in FITTED if w.figure not in without] for n, without in WITHOUT.items()}
    cases |= {f"Fig. 31 by {by} alone": windows for by, windows in maps.variants().items()}
    for name, windows in cases.items():
        fits[name] = fit(membranes(), first.parameters, windows=windows, evaluations=limit)
        tell(name, fits[name])
    final = fit(finite_elements(), first.parameters, slopes=membranes(), evaluations=limit)
    tell("finite elements", final)
    write(final, fits, maps.Maps.of(final.parameters, arguments.jobs))


if __name__ == "__main__":
    main()
