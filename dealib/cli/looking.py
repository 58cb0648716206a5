"""Commands that look at runs and materials. Each imports what it needs when it runs."""

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
    """Say what is installed and whether it works: solver, MPI, 3-D pictures, movies.

    Exit code 4 if something fails that dealib needs.
    """
    from dealib.tasks.doctor import doctor as examine

    examine(typer.echo)


@app.command()
def info(run: RunDirectory) -> None:
    """Print what a run directory holds: status, summary, versions, timings."""
    from dealib.cli.run import loud
    from dealib.results.reader import Run
    from dealib.tasks.info import describe

    typer.echo(describe(Run(run), loud))


@app.command()
def compare(
    run: RunDirectory,
    data: Annotated[list[Path], typer.Argument(metavar="DATA...", help="text, spreadsheet, MAT")],
    stage: Annotated[str | None, typer.Option(help="compare with this stage only")] = None,
    x: Annotated[
        str | None, typer.Option("-x", metavar="QUANTITY", help="abscissa; default first column")
    ] = None,
    column: Annotated[
        list[str] | None,
        typer.Option(metavar="QUANTITY=HEADER", help="such as force='Load [N]'; repeat for more"),
    ] = None,
    ignore: Annotated[
        list[str] | None, typer.Option(metavar="HEADER", help="leave this column out")
    ] = None,
    set: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="a key of a fit's data, such as prepare.force.sign=-1 or format.decimal=,",
        ),
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture: PNG, SVG or PDF")] = None,
    overwrite: Annotated[bool, typer.Option("--overwrite", help="replace the picture")] = False,
) -> None:
    """Compare a run with measured curves: RMSE, R2 and a picture.

    Headers such as force [mN] name the quantity and its unit. How a file was read is told in one
    line; `dealib data FILE` shows more. All keys of --set: configs/fits/REFERENCE.md, data.
    """
    from dealib.cli.compare import compare_run
    from dealib.errors import ConfigError
    from dealib.results.reader import Run

    columns = dict(c.partition("=")[::2] for c in column or [])
    if "" in columns.values():
        raise ConfigError("--column: expected QUANTITY=HEADER, such as force='Load [N]'")
    given = {"stage": stage, "x": x, "columns": columns or None, "ignore": ignore or ()}
    compare_run(Run(run), data, given, set or [], out, overwrite)


@app.command()
def data(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="text, spreadsheet or MAT file")],
    set: Annotated[
        list[str] | None,
        typer.Option(
            "--set",
            metavar="KEY=VALUE",
            help="such as format.decimal=, or format.encoding, delimiter, sheet, table",
        ),
    ] = None,
    x: Annotated[
        str | None, typer.Option("-x", metavar="HEADER", help="abscissa; default first column")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture; default NAME-data.png")] = None,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """Show how a measured file is read: format, columns and a picture of them."""
    from dealib.cli.data import show

    show(file, set or [], x, out, dark, overwrite)


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

    Without options: what the device does (of its first mount or chamber, else of its probes),
    the inputs in time, capacitance and field.

    Fields: u E D (lengths; u_R, E_Z, ... for components), phi, J, and the stresses S_RR (second
    Piola-Kirchhoff), sigma_RR (Cauchy), maxwell_RR, each with RR, ZZ, TT or RZ; in plane strain
    with XX, ZZ, YY or XZ, in three dimensions with XX to YZ; of the film, tension and the margins,
    such as wrinkling_use. D_n is the surface charge density on the electrodes' inner faces.

    A device in space is seen whole and cut in half; profiles are of laminates in a plane.
    Lines on the picture of wrinkling, of a tension field, run along the crests.

    A picture in RUN/plots/ replaces the one of the same name there; --out replaces nothing unless
    --overwrite is given.
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
        typer.Option(metavar="NAME", help="colours, see dealib plot; repeat for another picture"),
    ] = None,
    out: Annotated[Path | None, typer.Option(help=".mp4 or .gif; default in RUN/plots/")] = None,
    seconds: Annotated[float, typer.Option(min=0.5, max=120, help="length of the film")] = 8.0,
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

    A device in space, or of revolution, can be turned there, at each of its stored steps.

    Of a study: its gallery, as `dealib study` does; --out is then a folder.
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
        typer.Option(metavar="KEY", help="a number to move, or a section; repeat for more"),
    ] = None,
    set: Set = None,
    port: Port = 0,
    browser: Browser = True,
) -> None:
    """Show a config in the browser, with sliders for its numbers; curves and device follow.

    Laminates are solved as membranes, then the solid tells how far these are off; others as soon as
    they are solved. What is beyond a limit is red. A button saves the state as a YAML file here.
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
def materials(
    law: Annotated[
        str | None, typer.Argument(metavar="[LAW]", help="draw this law or material")
    ] = None,
    set: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="a parameter, such as c10='0.25 MPa'"),
    ] = None,
    config: Annotated[Path | None, typer.Option(help="take the law from this config")] = None,
    region: Annotated[str, typer.Option(help="region of the config")] = "film",
    out: Annotated[Path | None, typer.Option(help="picture; default LAW.png")] = None,
    stretch: Annotated[float, typer.Option(min=1.01, max=10, help="largest stretch")] = 2.0,
    library: Annotated[Path | None, typer.Option(help="YAML file of your own materials")] = None,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """List material laws and known materials, or draw one with its stability limit."""
    from dealib.cli import materials as command
    from dealib.config.library import known
    from dealib.errors import ConfigError

    if config is None:
        with known(library):
            if law is None:
                typer.echo(command.list_laws())
                return
            found = command.given_law(law, set or [])
    else:
        if law or set:
            raise ConfigError("--config gives the law and its parameters: drop LAW and --set")
        law, found = command.law_of_config(config, region)
    path = out or Path(f"{law}.png")
    command.plot_law(found, law or "", stretch, path, dark, overwrite)


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

    The bias is that of the last stage that loads the mount by bias, spring, mass or force. Two CSV
    files beside the picture hold the curves and the equilibria.
    """
    from dealib.cli.bias import draw_chart
    from dealib.config import load

    ends = None if reach is None else tuple(reach.split(","))
    draw_chart(load(config, set), voltage, ends, out, dark, overwrite)


@app.command()
def sense(
    runs: Annotated[list[Path], typer.Argument(metavar="RUN...", help="run directories")],
    at: Annotated[
        str | None, typer.Option(metavar="PF,KV", help="only find the displacement of this state")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="picture; default in RUN/plots/")] = None,
    dark: Dark = False,
    overwrite: Overwrite = False,
) -> None:
    """Map the capacitance over displacement and voltage; find displacements from it."""
    from dealib.cli.sense import sense as draw

    typer.echo(draw(runs, at, out, dark, overwrite))
