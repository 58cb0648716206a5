"""What an iteration of Newton costs on solids in three dimensions: films, and thick blocks.

    python tests/benchmarks/solids.py film 70          # 70 x 70 cells, 2e5 unknowns
    python tests/benchmarks/solids.py film 70 --ranks 2
    python tests/benchmarks/solids.py block 16         # 16 x 16 x 16 cells, 1.3e5 unknowns
    python tests/benchmarks/solids.py film 158 --once  # 1e6 unknowns; takes some 10 GB

A square of rubber of 10 mm is held at two sides and actuated in two steps, or once and weakly, so
that two iterations suffice. Processor time of an
iteration is that of a whole solve, with tangents, residuals and factorisations, over its
iterations; of several ranks, which wait for each other by turning in circles, only the time by the
clock says something. Both are the least of the solves. Memory is the peak of a rank's process,
measuring each state included.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
THICKNESS = {"film": 0.05, "block": 10.0}  # mm
FIELD = 2.0  # kV/mm


def config(kind: str, cells: int, linear: str, once: bool) -> Any:
    """A film of one cell through its thickness, or a block of cubes."""
    from dealib.config import Config

    film, thickness = kind == "film", THICKNESS[kind]
    actuate = [f"{FIELD * thickness / k} kV" for k in ((20,) if once else (2, 1))]
    rubber = {"law": "neo_hookean", "youngs_modulus": "1 MPa", "relative_permittivity": 3.0}
    return Config.model_validate(
        {
            "name": kind,
            "geometry": {
                "shape": "laminate",
                "base": {"kind": "rectangle", "length": "10 mm", "width": "10 mm"},
                "space": "3d",
                "layers": [{"name": "film", "thickness": f"{thickness} mm"}],
            },
            "mesh": {
                "columns": cells,
                "sectors": cells // 2 + cells // 2 % 2,
                "film_rows": 1 if film else cells,
                "grading": "uniform",
            },
            "materials": {"film": rubber},
            "program": [
                {"stage": f"actuate_{k}", "terminal": {"voltage": volts}}
                for k, volts in enumerate(actuate)
            ],
            "solver": {"linear": linear},
        }
    )


def measure(kind: str, cells: int, linear: str, once: bool) -> dict[str, Any] | None:
    """Run it on all ranks; the figures on rank 0."""
    from mpi4py import MPI

    from dealib import Case, Simulation
    from dealib.config import resolved

    comm, given = MPI.COMM_WORLD, config(kind, cells, linear, once)
    run = Simulation(Case(given, resolved(given), Path()), comm)
    newton, solve, solves = run.engine.newton, run.engine.newton.solve, []

    def timed() -> int:
        comm.Barrier()
        wall, cpu = time.perf_counter(), time.process_time()
        count = solve()
        if count:
            each = ((time.perf_counter() - wall) / count, (time.process_time() - cpu) / count)
            solves.append((*each, newton.linear_iterations / newton.linear_solves))
        return count

    newton.solve = timed  # type: ignore[method-assign]
    rows = [state.row for state in run]
    peaks = comm.gather(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, root=0)
    if comm.rank > 0:
        return None
    return {
        "case": f"{kind} {cells}",
        "unknowns": run.unknowns,
        "ranks": comm.size,
        "linear_solver": newton.linear_solver,
        "wall_s": round(min(s[0] for s in solves), 2),
        "cpu_s": round(min(s[1] for s in solves), 2),
        "krylov": max(s[2] for s in solves),
        "setting_up_s": round(run.engine.timings["mesh"] + run.engine.timings["matrix"], 1),
        "memory_GB": [round(peak / 1e6, 2) for peak in peaks],
        "charge_uC": rows[-1]["charge_uC"],
    }


def main() -> None:
    """Measure one case and print its figures as JSON."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("kind", choices=THICKNESS)
    parser.add_argument("cells", type=int, help="along a side; even")
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--linear", default="auto", help="solver.linear")
    parser.add_argument("--once", action="store_true", help="in one small step")
    given = parser.parse_args()
    if given.ranks > 1:
        from dealib.cli.mpi import environment, mpirun

        again = [sys.executable, __file__, given.kind, str(given.cells), "--linear", given.linear]
        again += ["--once"] if given.once else []
        command = [mpirun(), "-n", str(given.ranks), *again]
        raise SystemExit(subprocess.run(command, env=environment(), check=False).returncode)
    found = measure(given.kind, given.cells, given.linear, given.once)
    if found is not None:
        print(json.dumps(found), flush=True)


if __name__ == "__main__":
    main()
