"""The root of the command line, and types of arguments that commands share."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dealib.cli.launched import rank
from dealib.errors import on_command_line
from dealib.log import to_terminal

if TYPE_CHECKING:
    from dealib.config import Case

app = typer.Typer(
    name="dealib",
    help="Simulate dielectric elastomer devices with finite elements, from a YAML file.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)


def _version(wanted: bool) -> None:
    if wanted:
        from dealib.versions import version_line

        typer.echo(version_line())
        raise typer.Exit


@app.callback()
def _before_each(
    context: typer.Context,
    verbose: Annotated[
        bool,
        typer.Option(
            "--verbose",
            "-v",
            envvar="DEALIB_VERBOSE",
            help="print more: steps, increments, tracebacks; also after the command",
        ),
    ] = False,
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="print versions")
    ] = False,
) -> None:
    context.with_resource(on_command_line())
    to_terminal(verbose, rank() == 0)


def load_on_ranks(config: Path, set: list[str] | None, ranks: int) -> Case:
    """Load a config; for several ranks, start the command again under mpirun instead.

    Raises:
        ConfigError: If the config is wrong.
    """
    from dealib.config import load

    case = load(config, set)
    if ranks > 1:
        from dealib.cli.mpi import launch

        launch(ranks)
    return case


ConfigFile = Annotated[Path, typer.Argument(metavar="CONFIG", help="YAML file", readable=False)]
RunDirectory = Annotated[Path, typer.Argument(metavar="RUN", help="run directory", readable=False)]
Set = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="change a key, such as mesh.columns=80"),
]
Ranks = Annotated[int, typer.Option("--mpi", min=1, help="number of MPI ranks")]
Overwrite = Annotated[bool, typer.Option("--overwrite", help="replace the file given by --out")]
Port = Annotated[int, typer.Option(min=0, max=65535, help="port of 127.0.0.1; default a free one")]
Browser = Annotated[bool, typer.Option(help="open the page in the browser")]
Dark = Annotated[bool, typer.Option("--dark", help="on a dark background")]
Step = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        help="step of history.csv; -1: the last stored one; default: that of the largest voltage",
    ),
]
StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="YAML file, or a folder of them")]
StudyOut = Annotated[Path | None, typer.Option(help="folder; default runs/studies/NAME")]
FOLDER = Path("runs/studies/cases")
CacheFolder = Annotated[Path, typer.Option(help="folder of solved cases")]
Jobs = Annotated[
    int | None, typer.Option("-j", "--jobs", min=1, help="processes; default all cores")
]
Retry = Annotated[bool, typer.Option("--retry", help="solve cases again that did not converge")]
