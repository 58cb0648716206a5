"""`dealib respond`: the small-signal spectrum of a terminal about a state of a program."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from mpi4py import MPI

import typer

from dealib.cli.plot import default
from dealib.cli.run import solve
from dealib.config.case import Case
from dealib.config.size import refuse_full_disk
from dealib.errors import ConfigError
from dealib.program.modes import at_rest
from dealib.program.response import Driver, Spectrum, frequencies, terminal_of
from dealib.results import circuit, spectra
from dealib.results.reader import Run
from dealib.units import neat, sensible


def respond(
    case: Case,
    band: tuple[str, str],
    points: tuple[int, bool],
    of: str | None,
    at: str | None,
    in_series: tuple[str, str],
    sound_at: str | None,
    out: Path | None,
    overwrite: bool,
) -> None:
    """Run a case, find the spectrum, write and draw it, fit a circuit to it.

    Args:
        case: The case.
        band: Lowest and highest frequency.
        points: Number of frequencies, and whether there are more where the response turns.
        of: Terminal that is driven.
        at: Stage at the end of which.
        in_series: Resistance and inductance of the driver.
        sound_at: Distance at which sound is heard.
        out: Run directory.
        overwrite: Whether to replace an earlier one.

    Raises:
        ConfigError: If an option is wrong, or the directory exists.
        NotConverged: If a step failed.
    """
    low, high = (_quantity(option, text, "frequency") for option, text in
                 zip(("--from", "--to"), band, strict=True))  # fmt: skip
    if not 0 < low < high:
        raise ConfigError("--from and --to: expected two frequencies above zero, the lower first")
    driver = Driver(
        _quantity("--series-resistance", in_series[0], "resistance"),
        _quantity("--series-inductance", in_series[1], "inductance"),
    )
    terminal = terminal_of(case.config, of)
    still = at_rest(case, [at] if at is not None else [])
    distance = None if sound_at is None else _quantity("--sound-at", sound_at, "length")
    directory = out or Path(f"{case.config.directory}-response")
    path, hertz = directory / spectra.RESPONSE, frequencies(low, high, points[0])
    more = points[0] if points[1] else 0
    spectrum = Spectrum(at, terminal.name, hertz, driver, distance, path, more)
    refuse_full_disk(still.config, directory)
    with case.blamed():
        run = solve(still, directory, overwrite=overwrite, look=spectrum)
    spectrum.check()
    if MPI.COMM_WORLD.rank == 0:
        typer.echo("\n".join([*_look_at(run, path), str(path)]))


def _quantity(option: str, text: str, dimension: str) -> float:
    try:
        return sensible(text, dimension)
    except ValueError as error:
        raise ConfigError(f"{option}: {error}") from None


def _look_at(run: Run, path: Path) -> list[str]:
    """Fit the circuit, draw the pictures; what to tell, and the files."""
    from dealib.plots import response, style

    table = spectra.read(path)
    found = circuit.fit(table["frequency_Hz"].to_numpy(), 1e6 * response.impedance(table))
    rows = [
        {"part": v.name, "value": v.value, "low": v.low, "high": v.high,
         "unit": circuit.UNITS[v.name]}
        for v in found.values
    ]  # fmt: skip
    files = [run.directory / spectra.CIRCUIT, default([run], "bode"), default([run], "nyquist")]
    spectra.write(files[0], rows)
    with style.theme() as look:
        style.save(response.draw_bode(table, run.title, look), files[1])
        style.save(response.draw_nyquist(table, found, run.title, look), files[2])
    return [*told_peaks(table), *told_circuit(found), *map(str, files)]


def told_circuit(found: circuit.Circuit) -> list[str]:
    """The circuit, a line a part."""
    lines = [f"equivalent circuit, off by {100 * found.misfit:.2g} % on average:"]
    for v in found.values:
        between = "not determined" if v.low != v.low else f"{v.low:.5g} .. {v.high:.5g}"
        lines.append(f"  {v.name:<3}{v.value:12.5g} {circuit.UNITS[v.name]:<4} ({between})")
    return lines


def told_peaks(table: Any) -> list[str]:
    """Where displacements are largest, a line each."""
    lines = []
    for name in (n for n in map(str, table) if "_mm_per_kV" in n):
        k = int(table[name].argmax())
        largest, at = float(table[name][k]), float(table["frequency_Hz"][k])
        lines.append(f"{name}: largest {neat(largest)} at {neat(at)} Hz")
    return lines
