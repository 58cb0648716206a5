"""Commands about measured data, materials and sensing; each imports its modules when it runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from dealib.cli import looking  # noqa: F401 - help lists its commands first
from dealib.cli.root import Dark, Overwrite, RunDirectory, app


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
        list[str] | None, typer.Option(metavar="HEADER", help="column to leave out")
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

    Headers such as force [mN] name the quantity and its unit. One line tells how a file was read;
    `dealib data FILE` shows more. All keys of --set: configs/fits/REFERENCE.md, data.
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
    """Show how a measured file is read: its format, its columns and a picture of them."""
    from dealib.cli.data import show

    show(file, set or [], x, out, dark, overwrite)


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
            raise ConfigError("--config gives the law and its parameters: leave out LAW and --set")
        law, found = command.law_of_config(config, region)
    path = out or Path(f"{law}.png")
    command.plot_law(found, law or "", stretch, path, dark, overwrite)


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
