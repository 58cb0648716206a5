"""Start the same command on several MPI ranks."""

from __future__ import annotations

import os
import shutil
import sys
from typing import NoReturn

from dealib.errors import PlatformError


def launch(ranks: int) -> NoReturn:
    """Replace this process by mpirun of the same command line, without its `--mpi`."""
    mpirun = shutil.which("mpirun")
    if mpirun is None:
        raise PlatformError("--mpi needs mpirun (Debian: apt install openmpi-bin)")
    arguments = without_option(sys.argv[1:], "--mpi")
    environment = dict(os.environ)
    if os.geteuid() == 0:  # Open MPI refuses to run as root unless told twice
        environment["OMPI_ALLOW_RUN_AS_ROOT"] = "1"
        environment["OMPI_ALLOW_RUN_AS_ROOT_CONFIRM"] = "1"
    command = [mpirun, "-n", str(ranks), "--oversubscribe"]
    command += [sys.executable, "-m", "dealib", *arguments]
    sys.stdout.flush()
    os.execve(mpirun, command, environment)


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
