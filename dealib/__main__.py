"""Entry point of the command line: errors become one message and an exit code."""

from __future__ import annotations

import os
import sys
import time

import dealib.cli.clock  # noqa: F401 - starts it

for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):  # before numpy loads its BLAS
    os.environ.setdefault(_name, "1")
os.environ.setdefault("MPLBACKEND", "Agg")  # pictures go to files, with a screen or without


def _rank() -> int:
    """Rank under mpirun, without importing MPI."""
    for name in ("OMPI_COMM_WORLD_RANK", "PMI_RANK", "PMIX_RANK"):
        if name in os.environ:
            return int(os.environ[name])
    return 0


def main() -> None:
    """Run the command line."""
    from dealib.cli.streams import flushed, guard
    from dealib.errors import DealibError

    guard()
    try:
        code = _command()
        if code == 130:  # typer swallows Ctrl-C
            raise KeyboardInterrupt
    except DealibError as error:
        if _rank() == 0:
            print(f"dealib: {error}", file=sys.stderr)
        code = error.exit_code
        if not error.everywhere:
            _abort_all_ranks(code)
    except ModuleNotFoundError as error:
        if error.name and error.name.split(".")[0] == "dealib":
            raise
        print(
            f"dealib: the Python module {error.name!r} is missing; ./run --help sets up all that "
            "is needed, .venv/bin/dealib is then the program",
            file=sys.stderr,
        )
        code = 4
    except KeyboardInterrupt:
        print("dealib: interrupted", file=sys.stderr)
        code = 130
    except Exception:
        if _ranks() > 1:
            import traceback

            traceback.print_exc()
            _abort_all_ranks(1)
        raise
    sys.exit(flushed(code))


def _command() -> int:
    """Run the command that the arguments name; returns typer's exit code."""
    from dealib.cli.app import app
    from dealib.cli.usage import UsageError, explain, refuse_long
    from dealib.errors import ConfigError

    arguments = [_at_home(a) for a in sys.argv[1:]] or ["--help"]
    refuse_long(arguments)
    try:
        return int(app(arguments, prog_name="dealib", standalone_mode=False) or 0)
    except UsageError as error:
        raise ConfigError(explain(error, arguments)) from None


def _at_home(argument: str) -> str:
    """An argument, or the value in `--out=~/x`, with the user's home where the shell left a '~'."""
    option, sign, value = argument.partition("=")
    if argument.startswith("--") and value.startswith("~"):
        return f"{option}{sign}{os.path.expanduser(value)}"
    return os.path.expanduser(argument)


def _ranks() -> int:
    """Number of ranks, without importing MPI."""
    if "mpi4py.MPI" not in sys.modules:
        return 1
    from mpi4py import MPI

    return int(MPI.COMM_WORLD.size)


def _abort_all_ranks(code: int) -> None:
    """What stopped one rank must not leave the others waiting."""
    if _ranks() > 1:
        from mpi4py import MPI

        sys.stdout.flush()
        sys.stderr.flush()
        time.sleep(0.5)  # for mpirun to pass it on: an abort kills those that do
        MPI.COMM_WORLD.Abort(code)


if __name__ == "__main__":
    main()
