"""Entry point of the command line: whatever ends it becomes one message and an exit code."""

from __future__ import annotations

import os
import signal
import sys
import time
from types import FrameType

import dealib.cli.clock  # noqa: F401 - starts it
from dealib.cli.launched import begin_quickly, rank
from dealib.errors import FAULT, ConfigError, DealibError, Interrupted

os.environ.setdefault("MPLBACKEND", "Agg")  # pictures go to files, with a screen or without
_PATIENCE = 3.0  # seconds


def main() -> None:
    """Run the command line."""
    from dealib.cli.streams import flushed, guard

    guard()
    begin_quickly()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    everywhere = False
    try:
        code, everywhere = _command(), True
    except (DealibError, Interrupted) as error:
        code, everywhere = error.exit_code, error.everywhere
        _say(str(error))
    except KeyboardInterrupt:  # by a library that has taken the signal
        code = 130
        _say("interrupted")
    except Exception as error:
        code = _unforeseen(error)
    if not everywhere:
        _abort_all_ranks(code)
    if code:
        _let_the_first_rank_tell()
    sys.exit(flushed(code))


def _stop(number: int, frame: FrameType | None) -> None:
    """End in good order at a first signal, at once at a second one."""
    for again in (signal.SIGINT, signal.SIGTERM):
        signal.signal(again, signal.SIG_DFL)
    raise Interrupted(f"stopped by {signal.Signals(number).name}", number)


def _command() -> int:
    """Run the command that the arguments name; returns its exit code."""
    import typer
    from typer.main import get_command

    from dealib.cli.app import app
    from dealib.cli.usage import UsageError, explain, refuse_long

    given = [_at_home(a) for a in sys.argv[1:]]
    verbose = [a for a in given if a in ("-v", "--verbose")]  # it may stand anywhere
    arguments = [a for a in given if a not in verbose] or ["--help"]
    refuse_long(arguments)
    try:
        command = get_command(app)
        with command.make_context("dealib", [*verbose, *arguments]) as context:
            command.invoke(context)  # and not main(), which swallows interrupts
    except typer.Exit as stop:
        return int(stop.exit_code)
    except UsageError as error:
        raise ConfigError(explain(error, arguments)) from None
    return 0


def _unforeseen(error: Exception) -> int:
    """Tell what stopped the command; returns the exit code."""
    if isinstance(error, MemoryError):
        _say(": ".join(["not enough memory", *map(str, error.args)]))
        return 4
    name = error.name or "" if isinstance(error, ModuleNotFoundError) else ""
    if name and name.split(".")[0] != "dealib":
        _say(
            f"the Python module {name!r} is missing; ./run --help sets up all that is needed, "
            ".venv/bin/dealib is then the program"
        )
        return 4
    from dealib.cli.fault import told

    _say(told(error, sys.argv[1:]), always=True)
    return FAULT


def _at_home(argument: str) -> str:
    """An argument, or the value in `--out=~/x`, with the user's home where the shell left a '~'."""
    option, sign, value = argument.partition("=")
    if argument.startswith("--") and value.startswith("~"):
        return f"{option}{sign}{os.path.expanduser(value)}"
    return os.path.expanduser(argument)


def _say(message: str, always: bool = False) -> None:
    """Tell the user, once for all ranks unless each has something of its own to say."""
    if always or rank() == 0:
        print(f"dealib: {message}", file=sys.stderr)


def _abort_all_ranks(code: int) -> None:
    """What stopped one rank must not leave the others waiting."""
    if "mpi4py.MPI" not in sys.modules:
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        time.sleep(0.5)  # for mpirun to pass it on: an abort kills those that do
        MPI.COMM_WORLD.Abort(code)


def _let_the_first_rank_tell() -> None:
    """Whoever ends first with an error ends all others, on Open MPI 5 before they have spoken."""
    if rank() > 0 and "mpi4py.MPI" not in sys.modules:  # whose end waits for all
        sys.stderr.flush()
        time.sleep(_PATIENCE)


if __name__ == "__main__":
    main()
