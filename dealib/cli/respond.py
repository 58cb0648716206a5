"""`dealib respond`: the small-signal spectrum of a terminal about a state of a program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import typer

from dealib.cli.run import explained, watched
from dealib.config.case import Case
from dealib.results import circuit, spectra
from dealib.results.reader import Run
from dealib.tasks.pictures import default
from dealib.tasks.solving import respond
from dealib.units import neat


def find_response(case: Case, out: Path | None, **given: Any) -> None:
    """Compute a spectrum, draw it, print its peaks and circuit (see `tasks.solving.respond`)."""
    directory = out or Path(f"{case.config.directory}-response")
    with explained(directory):
        run = respond(case, directory=directory, **given, **watched())
    if MPI.COMM_WORLD.rank == 0:
        path = directory / spectra.RESPONSE
        typer.echo("\n".join([*_draw(run, path), str(path)]))


def _draw(run: Run, path: Path) -> list[str]:
    """Draw the pictures; returns the lines to print, with the files."""
    from dealib.plots import response, style

    table = spectra.read(path)
    hertz, measured = table["frequency_Hz"].to_numpy(), 1e6 * response.impedance(table)
    found = circuit.read(run.table("circuit"), hertz, measured)
    files = [run.directory / spectra.CIRCUIT, default([run], "bode"), default([run], "nyquist")]
    with style.theme() as look:
        style.save(response.draw_bode(table, run.title, look), files[1])
        style.save(response.draw_nyquist(table, found, run.title), files[2])
    return [*told_peaks(table), *told_circuit(found), *map(str, files)]


def told_circuit(found: circuit.Circuit) -> list[str]:
    """One line for each part of the equivalent circuit, with its 95 % interval."""
    lines = [f"equivalent circuit, off by {100 * found.misfit:.2g} % on average:"]
    for v in found.values:
        between = "not determined" if v.low != v.low else f"{v.low:.5g} .. {v.high:.5g}"
        lines.append(f"  {v.name:<3}{v.value:12.5g} {circuit.UNITS[v.name]:<4} ({between})")
    return lines


def told_peaks(table: Any) -> list[str]:
    """One line for each displacement: its largest amplitude and the frequency of it."""
    lines = []
    for name in (n for n in map(str, table) if "_mm_per_kV" in n):
        k = int(table[name].argmax())
        largest, at = float(table[name][k]), float(table["frequency_Hz"][k])
        lines.append(f"{name}: largest {neat(largest)} at {neat(at)} Hz")
    return lines
