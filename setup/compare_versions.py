"""Runs the strip benchmark on the dolfinx at hand, and compares the histories of several.

compare_versions.py --describe           prints the versions
compare_versions.py --run DIRECTORY      runs the benchmark into DIRECTORY/benchmark_strip and
                                         DIRECTORY/coarse (large increments that are cut back)
compare_versions.py DIRECTORY...         compares what was run; exit code 1 if not equal
"""

import csv
import math
import shutil
import sys
from pathlib import Path

TOLERANCE = 1e-9
COARSE = {"mesh.columns": 20, "program.1.steps": 4, "program.2.steps": 2}
COUNTED = "newton_iterations"  # rounding may cost an iteration more
RUNS = {"benchmark_strip": {}, "coarse": COARSE}


def describe() -> str:
    """Versions of what results depend on."""
    from dealib.program.run import versions

    return ", ".join(f"{k} {v}" for k, v in versions().items() if k not in ("dealib", "gmsh"))


def run(directory: Path) -> None:
    """Run the benchmark into a directory."""
    import dealib

    shutil.rmtree(directory, ignore_errors=True)
    for name, changes in RUNS.items():
        case = dealib.load("configs/benchmark_strip.yaml", set=changes)
        dealib.simulate(case, directory / name)


def columns(directory: Path) -> dict[str, list[str]]:
    """The columns of a run's history."""
    with (directory / "history.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: [row[name] for row in rows] for name in rows[0]}


def difference(one: list[str], other: list[str]) -> float:
    """Largest difference of two columns, relative to the largest value; infinite if unlike."""
    if len(one) != len(other):
        return math.inf
    if one == other:
        return 0.0
    try:
        a, b = [float(x) for x in one], [float(x) for x in other]
    except ValueError:
        return math.inf
    gaps = [abs(x - y) for x, y in zip(a, b, strict=True)]
    if not all(math.isfinite(gap) for gap in gaps):
        return math.inf
    return max(gaps) / max(*map(abs, a), 1e-15)


def compare(directories: list[Path]) -> int:
    """Compare the runs of all with those of the first."""
    first, *others = directories
    code = 0
    for other in others:
        for name in RUNS:
            a, b = columns(first / name), columns(other / name)
            worst = {c: difference(a[c], b.get(c, [])) for c in a if c != COUNTED}
            column = max(worst, key=lambda c: worst[c])
            verdict = "equal" if worst[column] <= TOLERANCE else "NOT EQUAL"
            code |= verdict != "equal"
            print(
                f"versions: {first.name} and {other.name}, {name}: {verdict} within {TOLERANCE:g}, "
                f"largest relative difference {worst[column]:.1e} ({column})"
            )
    return int(code)


if __name__ == "__main__":
    option, *rest = sys.argv[1:]
    if option == "--describe":
        print(describe())
    elif option == "--run":
        run(Path(rest[0]))
    else:
        sys.exit(compare([Path(d) for d in (option, *rest)]))
