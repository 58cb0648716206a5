"""Start the same command on several MPI ranks."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from types import FrameType
from typing import NoReturn

import psutil

from dealib.cli.launched import ALONE
from dealib.errors import PlatformError

# Open MPI refuses to run as root without both of the first two, and to run more ranks than there
# are cores without the next two (for its versions 4 and 5); other MPIs ignore these variables.
_OPEN_MPI = {
    "OMPI_ALLOW_RUN_AS_ROOT": "1",
    "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1",
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
    # waiting ranks give way to others: on a busy machine a run took 69 s instead of 243 s
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_orte_execute_quiet": "1",  # dealib prints its own message when it ends
}
# variables that a Python process with a running Open MPI, such as a notebook, passes to children
_LEFT_BEHIND = ("PMIX_", "PMI_", "ORTE_", "OMPI_MCA_ess", "OMPI_MCA_orte", "OMPI_MCA_pmix")


def launch(ranks: int) -> NoReturn:
    """Run the same command line without `--mpi` under mpirun, and exit with its exit code.

    mpirun answers SIGINT and SIGTERM by killing its ranks within seconds. Therefore the first
    signal goes directly to the ranks, which finish their step; the second one goes to mpirun.
    """
    arguments = without_option(sys.argv[1:], "--mpi")
    program = mpirun()
    command = [program, "-n", str(ranks), sys.executable, "-m", "dealib", *arguments]
    sys.stdout.flush()
    job = subprocess.Popen(
        command, env=environment(), stdin=subprocess.DEVNULL, start_new_session=True
    )
    stop: list[int] = []

    def forward(number: int, _frame: FrameType | None) -> None:
        ranks = [] if stop else _ranks(job.pid)
        for rank in ranks:
            with suppress(psutil.NoSuchProcess):
                rank.send_signal(number)
        if number == signal.SIGUSR1:
            return
        if not ranks:  # no rank has started yet, or this is the second signal
            job.send_signal(signal.SIGTERM)
        stop.append(number)

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGUSR1):
        signal.signal(number, forward)
    code = job.wait()
    sys.exit(128 + stop[0] if stop and code else abs(code))


def _ranks(mpirun: int) -> list[psutil.Process]:
    """The dealib processes below a process."""
    found = []
    with suppress(psutil.NoSuchProcess):
        for process in psutil.Process(mpirun).children(recursive=True):
            with suppress(psutil.NoSuchProcess):  # the process may have ended
                if process.cmdline()[1:3] == ["-m", "dealib"]:
                    found.append(process)
    return found


def environment() -> dict[str, str]:
    """Environment variables with which mpirun starts, also from a process that uses MPI."""
    kept = {k: v for k, v in os.environ.items() if not k.startswith(_LEFT_BEHIND)}
    kept = {k: v for k, v in kept.items() if ALONE.get(k) != v}
    if not sys.stdout.isatty():  # mpirun gives its ranks a pseudo-terminal
        kept["TTY_COMPATIBLE"] = "0"
    return kept | _OPEN_MPI


def mpirun() -> str:
    """The mpirun of the MPI that this Python's mpi4py uses.

    Raises:
        PlatformError: If there is none.
    """
    beside = Path(sys.executable).with_name("mpirun")  # of an MPI that pip has installed
    found = str(beside) if beside.exists() else shutil.which("mpirun")
    if found is None:
        raise PlatformError("--mpi needs mpirun (Debian: apt install openmpi-bin)")
    return found


def without_option(arguments: list[str], option: str) -> list[str]:
    """Arguments without an option and its value."""
    kept: list[str] = []
    skip = False
    for argument in arguments:
        if skip:
            skip = False
        elif argument == option:
            skip = True
        elif not argument.startswith(option + "="):
            kept.append(argument)
    return kept
