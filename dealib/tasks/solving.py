"""Modes, spectra, bias charts, tables and meshes of a config."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dealib.config.size import refuse_full_disk
from dealib.errors import ConfigError, by_caller, in_the_way
from dealib.results import circuit, spectra
from dealib.results.reader import Run
from dealib.tasks.arguments import Given, as_case, exclude, silent, value

if TYPE_CHECKING:
    from dealib.results.bias import BiasChart
    from dealib.results.circuit import Circuit
    from dealib.results.tables import DeviceTables


def modes(
    case: Given,
    stages: Sequence[str] = (),
    along: str | None = None,
    count: int = 8,
    directory: str | Path | None = None,
    **options: Any,
) -> Run:
    """Natural frequencies and mode shapes about the states at the ends of stages (collective).

    Args:
        case: The case, or its config's path.
        stages: Names of stages; default the last one.
        along: Stage at each state of which frequencies are computed too.
        count: Number of modes, from the lowest.
        directory: Run directory; default the config's with '-modes'.
        options: Further arguments of `simulate`: overwrite, observers, comm, ...

    Returns:
        A run: `run.table("modes")` and, with `along`, `run.table("frequencies")`; the shapes are
        `run.modes(index)` of its stored steps.

    Raises:
        ConfigError: If a stage or a density is missing, or the directory exists.
        NotConverged: If a step failed; earlier results are kept.
    """
    from mpi4py import MPI

    from dealib.program.modes import ModesWatch, at_rest
    from dealib.program.run import simulate

    case = as_case(case)
    watch = ModesWatch(stages, along, count)
    still = at_rest(case, stages, along)
    directory = Path(directory or f"{case.config.directory}-modes")
    refuse_full_disk(still.config, directory)
    first = options.get("comm", MPI.COMM_WORLD).rank == 0
    try:
        run = simulate(still, directory, look=watch, **options)
    finally:
        if first and watch.rows:
            spectra.write(directory / spectra.MODES, watch.rows)
        if first and watch.curve:
            spectra.write(directory / spectra.FREQUENCIES, watch.curve)
    watch.check()
    if first:
        spectra.write_shapes(run)
    return run


def respond(
    case: Given,
    low: str | float,
    high: str | float,
    points: int = 100,
    refine: bool = True,
    of: str | None = None,
    at: str | None = None,
    series_resistance: str | float = 0.0,
    series_inductance: str | float = 0.0,
    sound_at: str | float | None = None,
    directory: str | Path | None = None,
    **options: Any,
) -> Run:
    """Small-signal spectrum of a terminal about a state, with an equivalent circuit (collective).

    Args:
        case: The case, or its config's path.
        low: Lowest frequency, Hz or with a unit.
        high: Highest frequency, Hz or with a unit.
        points: Number of frequencies, logarithmically spaced.
        refine: Add points where the response varies quickly.
        of: The driven terminal; default the first.
        at: Stage at whose end the spectrum is computed; default the last.
        series_resistance: Resistance of the driver, Gohm or with a unit.
        series_inductance: Inductance of the driver, GH or with a unit.
        sound_at: Distance on the axis at which sound is computed, mm or with a unit.
        directory: Run directory; default the config's with '-response'.
        options: Further arguments of `simulate`: overwrite, observers, comm, ...

    Returns:
        A run with `run.table("response")` and `run.table("circuit")`.

    Raises:
        ConfigError: If an argument is wrong, or the directory exists.
        NotConverged: If a step failed.
    """
    from mpi4py import MPI

    from dealib.program.modes import at_rest
    from dealib.program.response import Driver, SpectrumWatch, frequencies, terminal_of
    from dealib.program.run import simulate

    case = as_case(case)
    names = (by_caller("from", "low"), by_caller("to", "high"))
    first, last = (value(n, f, "frequency") for n, f in zip(names, (low, high), strict=True))
    if not 0 < first < last:
        both = by_caller("--from and --to", "low and high")
        raise ConfigError(f"{both}: expected two frequencies above zero, the lower first")
    driver = Driver(
        value("series_resistance", series_resistance, "resistance"),
        value("series_inductance", series_inductance, "inductance"),
    )
    terminal = terminal_of(case.config, of)
    still = at_rest(case, [at] if at is not None else [])
    distance = None if sound_at is None else value("sound_at", sound_at, "length")
    directory = Path(directory or f"{case.config.directory}-response")
    path, more = directory / spectra.RESPONSE, points if refine else 0
    hertz = frequencies(first, last, points)
    spectrum = SpectrumWatch(at, terminal.name, hertz, driver, distance, path, more)
    refuse_full_disk(still.config, directory)
    with case.blamed():
        run = simulate(still, directory, look=spectrum, **options)
    spectrum.check()
    if options.get("comm", MPI.COMM_WORLD).rank == 0:
        write_circuit(run)
    return run


def write_circuit(run: Run) -> Circuit:
    """Fit the equivalent circuit to the spectrum of a run, and write it to the run directory."""
    from dealib.plots.response import impedance

    table = run.table("response")
    found = circuit.fit(table["frequency_Hz"].to_numpy(), 1e6 * impedance(table))
    rows = [
        {"part": v.name, "value": v.value, "low": v.low, "high": v.high,
         "unit": circuit.UNITS[v.name]}
        for v in found.values
    ]  # fmt: skip
    spectra.write(run.directory / spectra.CIRCUIT, rows)
    return found


def bias(
    case: Given,
    voltage: str | float | None = None,
    reach: Sequence[str | float] | None = None,
) -> BiasChart:
    """Forces of film and bias over displacement, and where they are in equilibrium.

    Args:
        case: The case, or its config's path.
        voltage: Full voltage, kV or with a unit; default that of the program.
        reach: First and last displacement of the chart, mm or with a unit; default the range in
            which equilibria are possible.

    Raises:
        ConfigError: If there is no bias or no voltage, or the range has to be given.
        NotConverged: If the film cannot be displaced so far.
    """
    from dealib.program.bias_chart import chart

    volts = None if voltage is None else value("voltage", voltage, "voltage")
    ends = None
    if reach is not None:
        found = sorted(value("reach", end, "length") for end in reach)
        if len(found) != 2 or found[0] == found[1]:
            example = by_caller("'-4 mm, 0 mm'", "(-4.0, 0.0)")
            name = by_caller("--reach", "reach")
            raise ConfigError(f"{name}: expected two displacements, such as {example}")
        ends = (found[0], found[1])
    return chart(as_case(case), volts, ends)


def export_tables(
    case: Given,
    directory: str | Path | None = None,
    *,
    fmu: bool = False,
    overwrite: bool = False,
    resume: bool = False,
    tell: Callable[[str], None] = silent,
    **options: Any,
) -> DeviceTables:
    """Tables F(u, V), Q(u, V), C(u, V) over the grid of a config, for system simulation.

    They are written as CSV, HDF5 and MAT.

    Args:
        case: The case, or its config's path.
        directory: Directory of the files; default the config's run directory with '-tables'.
        fmu: Write an FMU too, which needs a C compiler.
        overwrite: Replace earlier tables.
        resume: Continue unfinished tables.
        tell: Called with a line about each file.
        options: Further arguments of `simulate`: observers, comm, ...

    Raises:
        ConfigError: If the config has no `tables`, or the directory exists.
        NotConverged: If a state failed; the others are kept.
        PlatformError: If an FMU cannot be compiled.
    """
    from dealib.export.fmu import compiler, write_fmu
    from dealib.program.run import simulate
    from dealib.program.tables import tables_case
    from dealib.results.tables import collect

    exclude(overwrite, resume)
    case = as_case(case)
    walk = tables_case(case, fmu)
    if fmu:
        compiler()  # a missing compiler is reported before anything is solved
    directory = Path(directory or f"{case.config.directory}-tables")
    refuse_full_disk(walk.config, directory)
    run = simulate(walk, directory, overwrite=overwrite, resume=resume, **options)
    tables = collect(run)
    for path in tables.save(directory):
        tell(str(path))
    if fmu:
        path = directory / f"{case.config.name}.fmu"
        tell(f"{path}: {write_fmu(path, run, tables, case.config)}")
    return tables


def write_mesh(
    case: Given, path: str | Path, view: str | Path | None = None, *, overwrite: bool = False
) -> dict[str, int]:
    """Write the mesh of a config in Gmsh's format, and a picture of it.

    Args:
        case: The case, or its config's path.
        path: The Gmsh file, which ends in .msh.
        view: The picture; None: no picture.
        overwrite: Replace the files.

    Returns:
        Number of cells of each region.

    Raises:
        ConfigError: If a file exists already, or a folder is missing.
    """
    from dealib.device import gmsh_model

    case, path = as_case(case), Path(path)
    if path.suffix != ".msh":
        raise ConfigError(f"{by_caller('--out ', '')}{path}: the name must end in .msh")
    picture = None if view is None else Path(view)
    if picture is not None:
        from dealib.plots.style import FORMATS

        if picture.suffix.lower() not in FORMATS:
            ends = f"the name must end in {', '.join(FORMATS)}"
            raise ConfigError(f"{by_caller('--view ', '')}{picture}: {ends}")
    for target in filter(None, (path, picture)):
        if target.exists() and not overwrite:
            raise ConfigError(in_the_way(target))
        if not target.parent.is_dir():
            raise ConfigError(f"{target}: there is no folder {target.parent}")
    counts = gmsh_model.write(case.config, path)
    if picture is not None:
        from dealib.plots.mesh import draw_mesh
        from dealib.plots.style import save, theme

        with theme():
            save(draw_mesh(path, case.config), picture)
    return dict(counts)
