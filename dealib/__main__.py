"""Entry point of the command line: each error becomes one message and an exit code."""

from __future__ import annotations

import os
import signal
import sys
import time
from types import FrameType

import dealib.cli.clock  # noqa: F401 - the import starts the clock
from dealib.cli.launched import begin_quickly, rank
from dealib.errors import FAULT, ConfigError, DealibError, Interrupted

os.environ.setdefault("MPLBACKEND", "Agg")  # pictures go to files, with a screen or without
os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")  # looking for some takes 20 ms
_PATIENCE = 3.0  # seconds that other ranks wait for the message of the first one


def main() -> None:
    """Run the command line."""
    from dealib.cli.streams import flushed, guard

    guard()
    begin_quickly()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    sys.unraisablehook = _not_lost
    everywhere = False
    try:
        code, everywhere = _command(), True
    except (DealibError, Interrupted) as error:
        code, everywhere = error.exit_code, error.everywhere
        _say(str(error))
    except KeyboardInterrupt:  # raised by a library that handles the signal itself
        code = 130
        _say("interrupted")
    except Exception as error:
        code = _unexpected(error)
    if not everywhere:
        _abort_all_ranks(code)
    if code:
        _wait_for_first_rank()
    sys.exit(flushed(code))


def _stop(number: int, frame: FrameType | None) -> None:
    """Raise `Interrupted` at the first signal; a second one ends the process at once."""
    for again in (signal.SIGINT, signal.SIGTERM):
        signal.signal(again, signal.SIG_DFL)
    raise Interrupted(f"stopped by {signal.Signals(number).name}", number)


def _not_lost(lost: sys.UnraisableHookArgs) -> None:
    """Raise an interrupt a moment later that Python could not raise, as within a finaliser."""
    stop = lost.exc_value
    if not isinstance(stop, Interrupted):
        sys.__unraisablehook__(lost)
        return
    said, number, everywhere = str(stop), stop.signal, stop.everywhere

    def again(alarm: int, frame: FrameType | None) -> None:
        raise Interrupted(said, number, everywhere)

    signal.signal(signal.SIGALRM, again)
    signal.setitimer(signal.ITIMER_REAL, 0.01)


def _command() -> int:
    """Run the command that the arguments name.

    Returns:
        Its exit code.
    """
    import typer
    from typer.main import get_command

    from dealib.cli.app import app
    from dealib.cli.usage import UsageError, explain, refuse_long

    given = [_expand_home(a) for a in sys.argv[1:]]
    verbose = [a for a in given if a in ("-v", "--verbose")]  # allowed at any position
    arguments = [a for a in given if a not in verbose] or ["--help"]
    refuse_long(arguments)
    try:
        command = get_command(app)
        with command.make_context("dealib", [*verbose, *arguments]) as context:
            command.invoke(context)  # main() would swallow the message of an interrupt
    except typer.Exit as stop:
        return int(stop.exit_code)
    except UsageError as error:
        raise ConfigError(explain(error, arguments)) from None
    return 0


def _unexpected(error: Exception) -> int:
    """Report an error that is none of dealib's own kinds.

    Returns:
        The exit code.
    """
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


def _expand_home(argument: str) -> str:
    """Expand a leading '~', also that of a value as in `--out=~/x`, which shells leave."""
    option, sign, value = argument.partition("=")
    if argument.startswith("--") and value.startswith("~"):
        return f"{option}{sign}{os.path.expanduser(value)}"
    return os.path.expanduser(argument)


def _say(message: str, always: bool = False) -> None:
    """Print a message, on the first rank only unless `always`."""
    if always or rank() == 0:
        print(f"dealib: {message}", file=sys.stderr)


def _abort_all_ranks(code: int) -> None:
    """End the other ranks of a parallel run, which would wait for this one forever."""
    if "mpi4py.MPI" not in sys.modules:
        return
    from mpi4py import MPI

    if MPI.COMM_WORLD.size > 1:
        sys.stdout.flush()
        sys.stderr.flush()
        time.sleep(0.5)  # mpirun forwards the output; an abort ends its forwarding
        MPI.COMM_WORLD.Abort(code)


def _wait_for_first_rank() -> None:
    """Let the first rank print its message before this one ends.

    Open MPI 5 ends all ranks as soon as one has ended with an error. Once MPI is started, its own
    end waits for all ranks.
    """
    if rank() > 0 and "mpi4py.MPI" not in sys.modules:
        sys.stderr.flush()
        time.sleep(_PATIENCE)


if __name__ == "__main__":
    main()
