"""Prints the verification table; see `setup/verify --help`."""

from __future__ import annotations

import argparse
import fnmatch
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from dealib.errors import DealibError
from verification import mesh_convergence, space
from verification.cases import CASES
from verification.table import HEADER, Case, Row, markdown, write_into

README = Path(__file__).with_name("README.md")


def main() -> int:
    """Run the wanted cases; returns an exit code."""
    parser = argparse.ArgumentParser(
        prog="setup/verify",
        description="Checks dealib against known solutions; exit code 1 if a row fails.",
    )
    parser.add_argument("cases", nargs="*", help="names or patterns such as 'membrane-*'")
    parser.add_argument("--fast", action="store_true", help="only the cases of the default suite")
    parser.add_argument("--list", action="store_true", help="list the cases and stop")
    parser.add_argument(
        "--readme", action="store_true", help="write the table into tests/verification/README.md"
    )
    parser.add_argument(
        "--convergence", type=Path, metavar="PICTURE", help="only the mesh convergence, as a plot"
    )
    parser.add_argument(
        "--space", type=Path, metavar="PICTURE", help="only that of strips in space, as a plot"
    )
    given = parser.parse_args()
    for picture, study in ((given.convergence, mesh_convergence.study), (given.space, space.study)):
        if picture is not None:
            if picture.exists():
                parser.error(f"{picture} exists; it would be overwritten")
            print(study(picture))
            return 0
    patterns = given.cases or ["*"]
    chosen = [c for c in CASES if any(fnmatch.fnmatch(c.name, p) for p in patterns)]
    chosen = [c for c in chosen if not (given.fast and c.slow)]
    if not chosen:
        parser.error(f"no case is called {' or '.join(patterns)}; try --list")
    if given.list:
        print("\n".join(c.name + (" (slow)" if c.slow else "") for c in chosen))
        return 0
    if given.readme and len(chosen) < len(CASES):
        parser.error("--readme needs all cases")
    start = time.perf_counter()
    rows = [row for case in chosen for row in _rows(case)]
    _print(rows)
    failed = sum(not row.passed for row in rows)
    print(f"{len(rows)} rows, {failed} failed, {time.perf_counter() - start:.0f} s")
    if given.readme:
        write_into(README, markdown(rows))
    return 1 if failed else 0


def _rows(case: Case) -> list[Row]:
    """Rows of a case; one that fails if it stops."""
    print(f"{case.name} ...", file=sys.stderr, flush=True)
    rows = []
    try:
        rows.extend(case.rows())
    except DealibError as error:
        rows.append(Row(case.name, f"stopped: {error}", 0.0, float("nan"), 0.0, "", "absolute"))
    return rows


def _print(rows: list[Row]) -> None:
    table = Table(*HEADER)
    for row in rows:
        table.add_row(*row.cells, style=None if row.passed else "red")
    terminal = Console().is_terminal  # a file or a pipe has no width
    Console(width=None if terminal else 240).print(table)


if __name__ == "__main__":
    sys.exit(main())
