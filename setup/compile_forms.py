"""Compiles the forms of all shipped configs, so that no first run has to wait for the compiler."""

import pathlib
import sys

from dealib import DealibError, load
from dealib.fem.problem import build_problem

FORMS = ("residual", "tangent", "mesh_residual", "mesh_tangent", "elastic", "electric")


def main() -> int:
    """Compile once each kind of problem; returns an exit code."""
    from mpi4py import MPI

    root = pathlib.Path(__file__).parent.parent / "configs"
    for path in sorted((*root.glob("*.yaml"), *root.glob("devices/*.yaml"))):
        try:
            problem = build_problem(load(path).config, MPI.COMM_SELF)
        except DealibError as error:
            print(f"setup: {error}", file=sys.stderr)
            return error.exit_code
        of_ports = (f"{kind} {port}" for port in problem.values for kind in ("dual", "column"))
        for form in (*FORMS, *of_ports):
            problem.form(form)
    return 0


if __name__ == "__main__":
    sys.exit(main())
