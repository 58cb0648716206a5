"""Compiles the forms of all shipped configs, so that no first run has to wait for the compiler."""

import multiprocessing
import os
import pathlib
import sys

from dealib import DealibError, load

FORMS = ("residual", "tangent", "mesh_residual", "mesh_tangent", "elastic", "electric")


def compile_forms(path: pathlib.Path) -> tuple[int, str]:
    """Compile those of a config; an exit code, and what to say."""
    from mpi4py import MPI

    from dealib.fem.problem import build_problem

    try:
        problem = build_problem(load(path).config, MPI.COMM_SELF)
    except DealibError as error:
        return error.exit_code, f"setup: {error}"
    of_ports = (f"{kind} {port}" for port in problem.values for kind in ("dual", "column"))
    for form in (*FORMS, *of_ports):
        problem.form(form)
    return 0, ""


def main() -> int:
    """Compile once each kind of problem, on all processors; returns an exit code."""
    root = pathlib.Path(__file__).parent.parent / "configs"
    paths = sorted((*root.glob("*.yaml"), *root.glob("devices/*.yaml")))
    with multiprocessing.get_context("spawn").Pool(len(os.sched_getaffinity(0))) as pool:
        for code, problem in pool.imap(compile_forms, paths):
            if code:
                print(problem, file=sys.stderr)
                return code
    return 0


if __name__ == "__main__":
    sys.exit(main())
