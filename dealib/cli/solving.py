"""Commands that take configs; each imports its modules when it runs, so that help is quick."""

from __future__ import annotations

import gc
from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

import typer

from dealib.cli.root import (
    FOLDER,
    CacheFolder,
    ConfigFile,
    Jobs,
    Ranks,
    Retry,
    Set,
    StudyFile,
    StudyOut,
    app,
    load_on_ranks,
)


@app.command()
def run(
    config: ConfigFile,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="run directory; default the config's")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an existing run")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="continue an unfinished run")] = False,
    dry_run: Annotated[
        bool, typer.Option("--dry-run", help="mesh and compile only, print the size of the run")
    ] = False,
    mpi: Ranks = 1,
) -> None:
    """Solve a config into a run directory; -v also shows increments and Newton residuals."""
    case = load_on_ranks(config, set, mpi)
    from dealib.results.beside import Beside

    with ExitStack() as stack:
        # started before the import of dolfinx, to be ready at the first state
        beside = stack.enter_context(Beside()) if Beside.useful() and not dry_run else None
        gc.disable()  # imported modules stay: collecting among them takes 0.1 s
        from dealib.cli.run import run_case

        gc.freeze()
        gc.set_threshold(20_000)  # a run makes little garbage
        gc.enable()
        run_case(case, out, overwrite=overwrite, resume=resume, dry_run=dry_run, beside=beside)


@app.command()
def modes(
    config: ConfigFile,
    count: Annotated[int, typer.Option(min=1, max=50, help="number of modes")] = 8,
    at: Annotated[
        list[str] | None,
        typer.Option(metavar="STAGE", help="stage at whose end; repeat for more; default the last"),
    ] = None,
    along: Annotated[
        str | None,
        typer.Option(metavar="STAGE", help="also compute frequencies at the solved states of it"),
    ] = None,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="directory; default RUN-modes")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace earlier results")] = False,
    mpi: Ranks = 1,
) -> None:
    """Compute natural frequencies and mode shapes about the states at the ends of stages.

    A port with a prescribed displacement, voltage or volume is held at it; a port under a load is
    free and moves with its mass; a terminal with a prescribed charge is open. A mode that grows has
    a negative frequency: minus its growth rate over 2 pi. `dealib animate RUN-modes --field mode2`
    animates a mode.
    """
    case = load_on_ranks(config, set, mpi)
    from dealib.cli.modes import find_modes

    find_modes(case, at or [], along, count, out, overwrite)


@app.command()
def respond(
    config: ConfigFile,
    low: Annotated[str, typer.Option("--from", metavar="FREQUENCY", help="such as 1 Hz")],
    high: Annotated[str, typer.Option("--to", metavar="FREQUENCY", help="such as 1 kHz")],
    points: Annotated[
        int, typer.Option(min=2, max=10_000, help="number of frequencies, logarithmically spaced")
    ] = 100,
    refine: Annotated[bool, typer.Option(help="add points where the response varies")] = True,
    of: Annotated[
        str | None, typer.Option(metavar="TERMINAL", help="the driven terminal; default the first")
    ] = None,
    at: Annotated[
        str | None, typer.Option(metavar="STAGE", help="stage at whose end; default the last")
    ] = None,
    series_resistance: Annotated[str, typer.Option(metavar="R", help="of the driver")] = "0 ohm",
    series_inductance: Annotated[str, typer.Option(metavar="L", help="of the driver")] = "0 H",
    sound_at: Annotated[
        str | None,
        typer.Option(metavar="DISTANCE", help="also compute the sound at a distance on the axis"),
    ] = None,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="directory; default RUN-response")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace earlier results")] = False,
    mpi: Ranks = 1,
) -> None:
    """Compute the small-signal spectrum of displacement, force, charge, current and impedance.

    A small alternating voltage is added at a terminal; the inputs of the other ports are constant.
    Maxwell branches are relaxed at the state. With sensing.sheet_resistance the electrodes have a
    resistance, and are contacted at sensing.contact. An equivalent circuit is fitted.
    """
    case = load_on_ranks(config, set, mpi)
    from dealib.cli.respond import find_response

    find_response(
        case, out, low=low, high=high, points=points, refine=refine, of=of, at=at,
        series_resistance=series_resistance, series_inductance=series_inductance,
        sound_at=sound_at, overwrite=overwrite,
    )  # fmt: skip


@app.command()
def check(config: ConfigFile, set: Set = None) -> None:
    """Validate a config, with an estimate of its size, or a design; nothing is solved."""
    from dealib.config import load
    from dealib.config.doubts import warn
    from dealib.config.size import refuse_full_disk, size
    from dealib.config.source import Source

    if not set and "variables" in Source(config).tree:
        from dealib.design.goals import goals
        from dealib.design.plan import DesignPlan

        plan = DesignPlan(config)
        if plan.design.maximise or plan.design.minimise:
            goals(plan)
        typer.echo(f"{config}: valid; {plan.name}: {', '.join(plan.design.variables)}")
        return
    case = load(config, set)
    if case.config.mesh_file is not None:
        from dealib.device.sound import sound_mesh

        sound_mesh(Path(case.config.mesh_file), case.config.device.kinematics.dim)
    refuse_full_disk(case.config, Path(case.config.directory))
    warn(case.config)
    stages = ", ".join(s.stage for s in case.config.program)
    typer.echo(f"{config}: valid; {case.config.name}: {stages}")
    typer.echo(str(size(case.config)))
    turns = "" if case.config.device.kinematics.revolved else "whether the device may turn, and "
    typer.echo(f"not seen here: {turns}whether terminals touch; `dealib run --dry-run` sees it")


@app.command()
def init(
    template: Annotated[
        str, typer.Option(help="deap, benchmark, membrane, disc or rectangle")
    ] = "deap",
    out: Annotated[Path | None, typer.Option(help="config file; default TEMPLATE.yaml")] = None,
) -> None:
    """Write a commented config to start from."""
    from dealib.cli.schema import write_template

    write_template(template, out)


@app.command()
def schema(
    out: Annotated[Path | None, typer.Option(help="file; default: print")] = None,
    reference: Annotated[
        bool, typer.Option("--reference", help="page of all keys, or of all columns")
    ] = False,
    of: Annotated[
        str, typer.Option(help="config, study, fit, coupon, design, benchmark or history")
    ] = "config",
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the file")] = False,
) -> None:
    """Print the JSON schema of one kind of file, for editors, or a page of all its keys.

    For history, --reference gives a page of all columns; there is no schema.
    """
    from dealib.cli.schema import write_schema

    write_schema(out, of=of, page=reference, overwrite=overwrite)


@app.command()
def mesh(
    config: ConfigFile,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="Gmsh file; default NAME.msh")] = None,
    view: Annotated[Path | None, typer.Option(help="picture of the mesh")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the files")] = False,
) -> None:
    """Write the mesh of a config in Gmsh's format, and a picture of it."""
    from dealib.config import load
    from dealib.tasks.solving import write_mesh

    case = load(config, set)
    path = out or Path(f"{case.config.name}.msh")
    counts = write_mesh(case, path, view, overwrite=overwrite)
    cells = ", ".join(f"{name} {n}" for name, n in counts.items())
    typer.echo(f"{path}: {sum(counts.values())} cells ({cells})")
    if view is not None:
        typer.echo(str(view))


@app.command()
def export(
    config: ConfigFile,
    set: Set = None,
    out: Annotated[Path | None, typer.Option(help="directory; default RUN-tables")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace earlier tables")] = False,
    resume: Annotated[bool, typer.Option("--resume", help="continue unfinished tables")] = False,
    fmu: Annotated[
        bool, typer.Option("--fmu", help="also write DIRECTORY/NAME.fmu (needs a C compiler)")
    ] = False,
) -> None:
    """Write tables F(u, V), Q(u, V), C(u, V) for system simulation: CSV, HDF5, MAT, FMU.

    `tables` of the config gives the grid. dealib.tables(DIRECTORY) reads the tables in Python, with
    an interpolant whose force and charge come from one energy. An FMU (FMI 2.0, co-simulation,
    Linux x86-64, with its C source) is that interpolant with Maxwell branches and a mass.
    """
    from dealib.cli.export import export as write
    from dealib.config import load

    write(load(config, set), out, fmu=fmu, overwrite=overwrite, resume=resume)


@app.command()
def calibrate(
    fit: Annotated[Path, typer.Argument(metavar="FIT", help="YAML file", readable=False)],
    out: Annotated[Path | None, typer.Option(help="directory; default the fit's")] = None,
    jobs: Jobs = None,
    cache: CacheFolder = FOLDER,
    resume: Annotated[bool, typer.Option("--resume", help="continue an earlier fit")] = False,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace an earlier fit")] = False,
) -> None:
    """Fit parameters of a config to measured curves, or a material to coupon tests.

    Cases solved before are not solved again.
    """
    from dealib.cli.calibrate import tell
    from dealib.tasks import fitting

    options = {"resume": resume, "overwrite": overwrite}
    tell(fitting.calibrate(fit, out, jobs, cache=cache, tell=typer.echo, **options))


@app.command()
def study(
    study: StudyFile,
    jobs: Jobs = None,
    out: StudyOut = None,
    cache: CacheFolder = FOLDER,
    retry: Retry = False,
) -> None:
    """Solve the missing cases of a study, draw and compare all, and write a gallery."""
    from dealib.cli.study import run_study

    run_study(study, out, cache, jobs, retry)


@app.command()
def sweep(
    study: StudyFile,
    jobs: Jobs = None,
    out: StudyOut = None,
    cache: CacheFolder = FOLDER,
    retry: Retry = False,
    mpi: Annotated[int, typer.Option(min=1, help="MPI ranks instead of processes")] = 1,
) -> None:
    """Solve all cases of a study, also after failures; each that ends is added to summary.csv.

    Under mpirun, also on several machines, the ranks solve the cases.
    """
    if mpi > 1:
        from dealib.cli.mpi import launch

        launch(mpi)
    from dealib.cli.study import run_sweep

    run_sweep(study, out, cache, jobs, retry)
