"""Commands that show runs and configs; each imports its modules when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dealib.cli.root import (
    Browser,
    ConfigFile,
    Dark,
    Overwrite,
    Port,
    RunDirectory,
    Set,
    Step,
    app,
)
from dealib.cli.solving import study


@app.command()
def doctor() -> None:
    """Print what is installed and whether it works: solver, MPI, 3-D pictures, movies.

    Exit code 4: something that dealib needs does not work.
    """
    from dealib.tasks.doctor import doctor as examine

    examine(typer.echo)


@app.command()
def info(run: RunDirectory) -> None:
    """Print status, summary, versions and timings of a run directory."""
    from dealib.cli.run import loud
    from dealib.results.reader import Run
    from dealib.tasks.info import describe

    typer.echo(describe(Run(run), loud))


@app.command()
def plot(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="run directories")],
    x: Annotated[
        str | None, typer.Option("-x", metavar="COL", help="column to draw against; default time")
    ] = None,
    y: Annotated[
        list[str] | None, typer.Option("-y", metavar="COL", help="history column; repeat for more")
    ] = None,
    field: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="a field on the deformed device, such as E"),
    ] = None,
    profile: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="a field along a layer, or D_n; repeat for more"),
    ] = None,
    revolved: Annotated[
        bool, typer.Option("--revolved", help="body of revolution in 3-D, coloured by --field")
    ] = False,
    step: Step = None,
    out: Annotated[
        Path | None, typer.Option(help=".png, .svg or .pdf; default a name in RUN/plots/")
    ] = None,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """Draw one or several runs: an overview, history columns, fields or profiles.

    Without options: response of the first mount or chamber (otherwise of the probes), the inputs
    in time, capacitance and field.

    Fields: u E D (lengths; u_R, E_Z, ... for components), phi, J, and the stresses S_RR (second
    Piola-Kirchhoff), sigma_RR (Cauchy), maxwell_RR, each with RR, ZZ, TT or RZ; in plane strain
    with XX, ZZ, YY or XZ, in three dimensions with XX to YZ; of the film, tension and the margins,
    such as wrinkling_use. D_n is the surface charge density on the electrodes' inner faces.

    A three-dimensional device is drawn whole and cut in half; profiles need a laminate in a plane.
    Lines on the picture of wrinkling, of a tension field, run along the crests.

    Without --out the picture goes to RUN/plots/ and replaces an earlier one of the same name there;
    with --out a file is replaced only if --overwrite is given.
    """
    from dealib.plots import style
    from dealib.tasks.pictures import as_runs, default, drawn

    found = as_runs(runs)
    if out is not None:
        style.check_target(out, style.FORMATS, overwrite)
    given = (x, y or (), field, profile or (), revolved, step, dark)
    with drawn(found, *given) as (figure, name):
        target = out or default(found, name, dark)
        style.save(figure, target)
    typer.echo(str(target))


@app.command()
def animate(
    run: RunDirectory,
    field: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="field, see dealib plot; repeat for another picture"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help=".mp4 or .gif; default in RUN/plots/")] = None,
    seconds: Annotated[float, typer.Option(min=0.5, max=120, help="length of the movie")] = 8.0,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """Animate the deforming device beside its input curves."""
    from dealib.tasks.pictures import animate as draw

    typer.echo(draw(run, field or (), out, seconds=seconds, dark=dark, overwrite=overwrite))


@app.command()
def report(
    path: Annotated[
        Path, typer.Argument(metavar="RUN|STUDY", help="run directory, or a study's YAML file")
    ],
    out: Annotated[Path | None, typer.Option(help="HTML file; default RUN/report.html")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write one self-contained HTML page about a run: device, pictures, curves, margins.

    A three-dimensional or axisymmetric device can be turned on the page, at each stored step.

    For a study: write its gallery, as `dealib study` does; --out is then a folder.
    """
    if path.suffix in (".yaml", ".yml"):
        study(path, out=out)
        return
    from dealib.tasks.pictures import write_report

    typer.echo(write_report(path, out, overwrite=overwrite))


@app.command("app")
def sliders(
    config: ConfigFile,
    key: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY", help="number with a slider, or a section; repeat for more"),
    ] = None,
    set: Set = None,
    port: Port = 0,
    browser: Browser = True,
) -> None:
    """Show a config in the browser, with sliders for its numbers; curves and device follow.

    Laminates are solved as membranes first; a solution as a solid then shows the error of that.
    Other devices appear when they are solved. Values beyond a limit are red. A button saves the
    state as a YAML file in the present folder.
    """
    from dealib.config import load
    from dealib.tasks.pictures import show

    show(load(config, set), key or (), port=port, browser=browser)


@app.command()
def view(run: RunDirectory, port: Port = 0, browser: Browser = True) -> None:
    """Show a run in the browser: curves, margins, fields on the deformed device, cuts."""
    from dealib.results.reader import Run
    from dealib.tasks.pictures import show

    show(Run(run), port=port, browser=browser)


@app.command()
def bias(
    config: ConfigFile,
    set: Set = None,
    voltage: Annotated[
        str | None, typer.Option(help="full voltage, such as '2.5 kV'; default the program's")
    ] = None,
    reach: Annotated[
        str | None, typer.Option(help="displacements of the chart, such as '-4 mm, 0 mm'")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture; default NAME-bias.png")] = None,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """Draw the forces of film and bias over displacement, with equilibria, stability and stroke.

    The bias is that of the last stage with bias, spring, mass or force on the mount. Two CSV files
    beside the picture hold the curves and the equilibria.
    """
    from dealib.cli.bias import draw_chart
    from dealib.config import load

    ends = None if reach is None else tuple(reach.split(","))
    draw_chart(load(config, set), voltage, ends, out, dark, overwrite)
